// SPDX-License-Identifier: Apache-2.0
/// @file  The people of a detector's folder: how many, their names, and which detections are theirs.
#pragma once

#include <gsh/fit/motion_fit.hpp>
#include <gsh/io/capture/detections.hpp>

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

/// Who is to be fitted: the option --people.
class WantedPeople {
public:
    /// Reads a number, "auto", or names with commas between them; nothing is one person.
    ///
    /// Errors  ValueError for a number of 0, names that are no plain names of files, and names that occur twice.
    explicit WantedPeople(const std::string& option);

    [[nodiscard]] std::optional<std::size_t> count() const { return count_; } ///< none: as many as are found
    [[nodiscard]] bool chosen() const { return chosen_; }                     ///< whether there was an option
    /// The names of `count` people; that of a single person who has none is empty.
    [[nodiscard]] std::vector<std::string> names(std::size_t count) const;

private:
    std::optional<std::size_t> count_ = 1;
    bool chosen_ = false;
    std::vector<std::string> names_;
};

/// One of them.
struct FilmedPerson {
    std::string name; ///< empty for a single person without a name
    std::vector<PersonPhoto> photos;
    std::vector<bool> seen; // [T] in any photograph

    [[nodiscard]] std::string poses() const { return (name.empty() ? "poses" : name) + ".npz"; }
};

struct FilmedPeople {
    std::vector<FilmedPerson> people;
    std::size_t in_view = 0; ///< people who are seen nearly as long and as large
};

/// Tells the people apart, and gives each photograph its mask, but where another one of them is near: there, the mask's
/// outline is not the person's.
///
/// Errors  ValueError if fewer people are found than are wanted, but nobody at all is no error.
FilmedPeople people_of(const Detections& detections, const WantedPeople& wanted,
                       const std::function<MaskView(std::size_t camera, std::size_t frame)>& mask);

} // namespace gsh::examples
