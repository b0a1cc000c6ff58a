// SPDX-License-Identifier: Apache-2.0
/// @file  BVH files of sample rigs, written independently of gsh's writer.
#pragma once

#include "support/sample_rig.hpp"

#include <cstddef>
#include <sstream>
#include <string>

namespace gsh::test {

/// `order` is that of the rotation channels, "ZXY". Positions come first for the root.
inline std::string bvh_text(const SampleRig& rig, const std::string& order = "ZXY", double step = 1.0 / 30) {
    std::ostringstream out;
    out.precision(12);
    std::vector<std::size_t> written;
    const auto write = [&](const auto& self, std::size_t j, const std::string& indent) -> void {
        const int p = rig.parents[j];
        const vec3<double> offset = p < 0 ? rig.rest[j] : rig.rest[j] - rig.rest[static_cast<std::size_t>(p)];
        out << indent << (p < 0 ? "ROOT " : "JOINT ") << rig.names[j] << "\n" << indent << "{\n";
        out << indent << "  OFFSET " << offset.x << " " << offset.y << " " << offset.z << "\n"
            << indent << "  CHANNELS ";
        out << (p < 0 ? "6 Xposition Yposition Zposition" : "3");
        for (const char axis : order) out << " " << axis << "rotation";
        out << "\n";
        written.push_back(j);
        bool leaf = true;
        for (std::size_t k = 0; k < rig.names.size(); ++k)
            if (rig.parents[k] == static_cast<int>(j)) self(self, k, indent + "  "), leaf = false;
        if (leaf)
            out << indent << "  End Site\n"
                << indent << "  {\n"
                << indent << "    OFFSET 0 0.1 0\n"
                << indent << "  }\n";
        out << indent << "}\n";
    };
    out << "HIERARCHY\n";
    write(write, 0, "");
    out << "MOTION\nFrames: " << rig.root.size() << "\nFrame Time: " << step << "\n";
    for (std::size_t t = 0; t < rig.root.size(); ++t) {
        for (const std::size_t j : written) {
            if (rig.parents[j] < 0) out << rig.root[t].x << " " << rig.root[t].y << " " << rig.root[t].z << " ";
            for (const char axis : order) out << rig.angles[t][j][axis - 'X'] * 57.295779513082323 << " ";
        }
        out << "\n";
    }
    return out.str();
}

} // namespace gsh::test
