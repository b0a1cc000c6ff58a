// SPDX-License-Identifier: Apache-2.0
/// @file  The option of programs for coarser avatars, which are faster to pose and to draw.
#pragma once

#include <gsh/backend/threads.hpp>
#include <gsh/camera/pinhole.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace gsh {
struct AvatarData;
} // namespace gsh

namespace gsh::programs {

struct ShownPeople;

struct DetailOption {
    std::string detail = "full"; ///< "full", "auto" (as many Gaussians as the picture needs), or a number

    [[nodiscard]] bool is_full() const { return detail == "full"; }
    [[nodiscard]] bool is_auto() const { return detail == "auto"; }
    /// The number.
    /// Errors  ValueError for a text that is neither a number above 0 nor a word of the option.
    [[nodiscard]] std::size_t count() const;
};

/// Merges Gaussians of avatars that have more than `count` of them (coarser_avatar).
void coarsen(cpu::Threads& backend, std::vector<AvatarData>& avatars, std::size_t count);

/// Merges Gaussians of people as the option says, for pictures of the frames `first` to `last` by a camera.
void coarsen(cpu::Threads& backend, ShownPeople& people, const DetailOption& option, const Camera<double>& camera,
             std::size_t first, std::size_t last);

/// The option --detail. CLI11 must be included before it is called.
template <class App = CLI::App>
void add_detail(App& app, DetailOption& option) {
    app.add_option("--detail", option.detail,
                   "Gaussians of each avatar at most: full, auto (as many as the picture needs, which is faster), or a "
                   "number (default " +
                       option.detail + ")")
        ->check([](const std::string& text) {
            const bool number = !text.empty() && text.size() < 10 && text[0] != '0' &&
                                text.find_first_not_of("0123456789") == std::string::npos;
            return number || text == "full" || text == "auto" ? std::string()
                                                              : "'" + text + "' is not full, auto or a number above 0";
        });
}

} // namespace gsh::programs
