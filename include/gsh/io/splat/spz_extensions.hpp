// SPDX-License-Identifier: Apache-2.0
/// @file  Extension records of SPZ files: which axes the Gaussians are stored in.
#pragma once

#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/splat_axes.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// What the extensions of an SPZ file state about its Gaussians.
struct SpzStatements {
    std::string_view axes = "RUB"; ///< as axes_of_letters takes them
    UpAxis up = UpAxis::y;         ///< of these axes
    std::vector<std::string> warnings = {};
};

/// Reads records of type, length and content, one after the other. SPZ_ADOBE_coordinate_system (0xADBE0003) holds the
/// number of one of 16 coordinate systems; the first such record counts, and an unknown number is read as RUB, the
/// system of files without the record. SPZ_ADOBE_safe_orbit_camera does not concern the Gaussians. Any other type is a
/// warning, because it may.
///
/// Numbers 9, 10, 15 and 16 are named LFD, RFD, LBU and RBU, but Niantic's library (July 2026) writes and reads them
/// with the names of 9 and 15, and of 10 and 16, exchanged. Files are of its making, so gsh reads them in the same way.
///
/// Errors  none: what cannot be read is a warning, beginning with `name`.
/// Source  Niantic's library "spz", its extensions/README.md and splat-types.h of July 2026.
[[nodiscard]] inline SpzStatements spz_statements(std::string_view records, const std::string& name) {
    constexpr std::array<std::string_view, 16> systems = {"LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF",
                                                          "LBU", "RBU", "LFU", "RFU", "LBD", "RBD", "LFD", "RFD"};
    constexpr std::uint32_t orbit_camera = 0xADBE0002, coordinate_system = 0xADBE0003;
    SpzStatements stated;
    bool has_system = false;
    while (!records.empty()) {
        std::uint32_t head[2] = {}; // type, length
        if (records.size() >= sizeof head) std::memcpy(head, records.data(), sizeof head);
        if (records.size() < sizeof head || head[1] > records.size() - sizeof head) {
            stated.warnings.push_back(name + ": its extensions are damaged; the rest of them is not read");
            break;
        }
        const std::string_view content = records.substr(sizeof head, head[1]);
        records.remove_prefix(sizeof head + head[1]);
        if (head[0] == coordinate_system && !has_system) {
            has_system = true;
            std::uint32_t number = 0;
            std::memcpy(&number, content.data(), content.size() >= sizeof number ? sizeof number : 0);
            if (number >= 1 && number <= systems.size())
                stated.axes = systems[number - 1];
            else
                stated.warnings.push_back(name + ": states the coordinate system " + std::to_string(number) +
                                          ", expected 1 to 16; it is read as RUB, with y up; --input-up states another "
                                          "vertical");
        } else if (head[0] != coordinate_system && head[0] != orbit_camera) {
            char type[16];
            std::snprintf(type, sizeof type, "0x%08X", static_cast<unsigned>(head[0]));
            stated.warnings.push_back(name + ": has an extension of unknown type " + type +
                                      ", which is skipped; Gaussians may mean something else with it");
        }
    }
    const std::size_t axis = stated.axes.find_first_of("UD");
    stated.up = static_cast<UpAxis>(2 * axis + (stated.axes[axis] == 'D'));
    return stated;
}

} // namespace gsh
