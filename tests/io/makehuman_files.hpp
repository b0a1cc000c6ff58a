// SPDX-License-Identifier: Apache-2.0
/// @file  A body in MakeHuman's formats that is made of small cubes, one for each bone.
#pragma once

#include "io/npz_files.hpp"

#include <gsh/core/span.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/makehuman_people.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <filesystem>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// The files by their names below the root. Tests may change them before they are written.
///
/// Each bone has a cube of skin, 4 cm wide, around its head, which is the mean of its corners. The left wrist also has a
/// cube of vertices of its own, joint-l-hand, which is no skin. Coordinates are in decimetres.
class MakeHumanSample {
public:
    std::map<std::string, std::string> files;

    MakeHumanSample() {
        add_bones();
        add_mesh();
        add_rig();
        add_targets();
        PixelImage face(1, 4, 4); // the upper half is the face
        for (int y = 0; y < 2; ++y)
            for (int x = 0; x < 4; ++x) *face.pixel(y, x) = 255;
        files["textures/mpfb_face.jpg"] = encode_png(face); // readers look at the bytes
    }

    /// Replaces text in a file.
    void replace(const std::string& file, const std::string& from, const std::string& to) {
        std::string& text = files.at(file);
        const std::size_t place = text.find(from);
        REQUIRE(place != std::string::npos);
        text.replace(place, from.size(), to);
    }

    void write_folder(const std::filesystem::path& folder) const {
        for (const auto& [name, text] : files) {
            std::filesystem::create_directories((folder / name).parent_path());
            write_file(folder / stored(name), packed(name, text), Sync::none);
        }
    }
    void write_zip(const std::filesystem::path& path, const std::string& root) const {
        ZipFile zip(path);
        for (const auto& [name, text] : files) zip.add(root + stored(name), packed(name, text), true);
    }

    /// The position of a bone's head.
    [[nodiscard]] vec3<double> bone(const std::string& name) const { return bones_.at(name).head / 10.0; }
    /// The first vertex of a bone's cube in the base mesh; seven more follow.
    [[nodiscard]] int cube(const std::string& name) const { return cubes_.at(name); }

private:
    struct Bone {
        std::string parent;
        vec3<double> head;
    };
    std::map<std::string, Bone> bones_;
    std::map<std::string, int> cubes_;
    std::vector<vec3<double>> vertices_;
    std::string faces_;

    static std::string stored(const std::string& name) { return name.ends_with(".target") ? name + ".gz" : name; }
    static std::string packed(const std::string& name, const std::string& text) {
        return name.ends_with(".target") ? gzip(text, 1) : text;
    }

    void add_sided(const std::string& name, const std::string& parent, const vec3<double>& left, bool sided_parent) {
        bones_[name + ".L"] = {parent + (sided_parent ? ".L" : ""), left};
        bones_[name + ".R"] = {parent + (sided_parent ? ".R" : ""), vec3<double>(-left.x, left.y, left.z)};
    }
    void add_bones() {
        bones_ = {{"root", {"", {0, -0.5, -1}}},
                  {"spine05", {"root", {0, 0, 0}}},
                  {"spine04", {"spine05", {0, 0.9, -0.4}}},
                  {"spine03", {"spine04", {0, 1.7, -0.2}}},
                  {"spine02", {"spine03", {0, 2.5, -0.1}}},
                  {"spine01", {"spine02", {0, 3.5, 0}}},
                  {"neck01", {"spine01", {0, 5.5, 0}}},
                  {"head", {"neck01", {0, 6.5, 0.3}}},
                  {"jaw", {"head", {0, 6.9, 0.8}}}};
        add_sided("pelvis", "root", {0.6, -0.1, -0.6}, false);
        add_sided("upperleg01", "pelvis", {1.1, -0.3, 0}, true);
        add_sided("lowerleg01", "upperleg01", {1.6, -4.3, 0.2}, true);
        add_sided("foot", "lowerleg01", {2.1, -8.3, -0.2}, true);
        for (int k = 1; k <= 5; ++k)
            add_sided("toe" + std::to_string(k) + "-1", "foot", {1.2 + 0.45 * k, -8.7, 1.2}, true);
        add_sided("clavicle", "spine01", {0.4, 5.0, 0.1}, false);
        add_sided("upperarm01", "clavicle", {1.8, 5.1, 0}, true);
        add_sided("upperarm02", "upperarm01", {2.4, 4.5, 0}, true);
        add_sided("lowerarm01", "upperarm02", {3.4, 3.4, 0}, true);
        add_sided("wrist", "lowerarm01", {4.9, 2.2, 1.4}, true);
        const vec3<double> along(0.35, -0.6, 0.72), across(-0.55, 0.3, 0.5); // from the wrist, and towards the thumb
        for (int finger = 1; finger <= 5; ++finger)
            for (int k = 1; k <= 3; ++k) {
                const vec3<double> knuckle = vec3<double>(4.9, 2.2, 1.4) + along * (finger == 1 ? 0.5 : 1.1) +
                                             across * (finger == 1 ? 1.0 : 0.75 * (3.5 - finger));
                const vec3<double> curl = vec3<double>(-0.02, -0.06, 0) * static_cast<double>(k * k);
                add_sided("finger" + std::to_string(finger) + "-" + std::to_string(k),
                          k == 1 ? "wrist" : "finger" + std::to_string(finger) + "-" + std::to_string(k - 1),
                          knuckle + (along + (finger == 1 ? across : vec3<double>(0))) * (0.45 * (k - 1)) + curl, true);
            }
        add_sided("special06", "head", {0.2, 8.0, 0.5}, false);
        add_sided("eye", "special06", {0.35, 7.3, 1.2}, true);
    }

    /// A cube around a point, as quads seen counter-clockwise from outside.
    int add_cube(const vec3<double>& center, double size) {
        const auto first = static_cast<int>(vertices_.size());
        for (int corner = 0; corner < 8; ++corner)
            vertices_.push_back(center + vec3<double>((corner & 1) ? size : -size, (corner & 2) ? size : -size,
                                                      (corner & 4) ? size : -size));
        for (const auto& quad :
             {std::array<int, 4>{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
            faces_ += "f";
            for (const int corner : quad) {
                const std::string v = std::to_string(first + corner + 1);
                faces_ += " " + v + "/" + v;
            }
            faces_ += "\n";
        }
        return first;
    }
    void add_mesh() {
        faces_ += "g body\n";
        for (const auto& [name, bone] : bones_) cubes_[name] = add_cube(bone.head, 0.2);
        const auto add_part = [&](const std::string& group, const vec3<double>& center) {
            faces_ += "g " + group + "\n";
            cubes_[group] = add_cube(center, 0.1);
        };
        add_part("helper-tongue", {0, 6.8, 1.0});
        add_part("helper-l-eye", bones_["eye.L"].head);
        add_part("helper-r-eye", bones_["eye.R"].head);
        add_part("helper-lower-teeth", {0, 6.7, 1.1});
        add_part("helper-upper-teeth", {0, 7.0, 1.1});
        add_part("joint-l-hand", bones_["wrist.L"].head);
        add_part("joint-r-hand", bones_["wrist.R"].head);
        add_part("helper-skirt", {0, -5, 0});
        std::ostringstream text;
        text << "# a sample\n";
        for (const auto& v : vertices_) text << "v " << v.x << " " << v.y << " " << v.z << "\n";
        for (const auto& v : vertices_) text << "vt " << v.x / 20 + 0.5 << " " << v.y / 20 + 0.5 << "\n";
        files["3dobjs/base.obj"] = text.str() + faces_;
    }

    [[nodiscard]] std::string ends_of(const std::string& name) const {
        const auto corners = [&](int first) {
            std::string list;
            for (int k = 0; k < 8; ++k) list += (k ? ", " : "") + std::to_string(first + k);
            return "{\"strategy\": \"MEAN\", \"vertex_indices\": [" + list + "]}";
        };
        std::string head = corners(cubes_.at(name));
        if (name.starts_with("wrist"))
            head = R"({"strategy": "CUBE", "cube_name": "joint-)" + std::string(name.ends_with("L") ? "l" : "r") +
                   "-hand\"}";
        // Fingers end at a corner of the last cube; other tails are not used.
        const std::string tail = R"({"strategy": "VERTEX", "vertex_index": )" +
                                 std::to_string(cubes_.at(name) + (name.ends_with("L") ? 5 : 4)) + "}";
        return "\"head\": " + head + ", \"tail\": " + tail;
    }
    void add_rig() {
        std::string rig, weights;
        for (const auto& [name, bone] : bones_) {
            rig += (rig.empty() ? "" : ",\n") +
                   ("\"" + name + "\": {" + ends_of(name) + ", \"parent\": \"" + bone.parent + "\"}");
            std::string rows;
            for (int k = 0; k < 8; ++k) rows += (k ? ", [" : "[") + std::to_string(cubes_.at(name) + k) + ", 1.0]";
            const auto add_part = [&](const std::string& group) {
                for (int k = 0; k < 8; ++k) rows += ", [" + std::to_string(cubes_.at(group) + k) + ", 1.0]";
            };
            if (name == "jaw") add_part("helper-tongue"), add_part("helper-lower-teeth");
            if (name == "head") add_part("helper-upper-teeth");
            if (name == "eye.L") add_part("helper-l-eye");
            if (name == "eye.R") add_part("helper-r-eye");
            weights += (weights.empty() ? "" : ",\n") + ("\"" + name + "\": [" + rows + "]");
        }
        files["rigs/standard/rig.default.json"] = "{" + rig + "}";
        files["rigs/standard/weights.default.json"] = R"({"license": "CC0", "weights": {)" + weights + "}}";
    }

    /// Lines of a target that moves each vertex at x by displacement(x).
    template <class Displacement>
    [[nodiscard]] std::string lines(const Displacement& displacement) const {
        std::ostringstream text;
        text << "# a target\n";
        for (std::size_t v = 0; v < vertices_.size(); ++v) {
            const vec3<double> d = displacement(vertices_[v]);
            if (d != vec3<double>(0)) text << v << " " << d.x << " " << d.y << " " << d.z << "\n";
        }
        return text.str();
    }
    void add_targets() {
        const auto target = [&](const std::string& name) -> std::string& {
            return files["targets/" + name + ".target"];
        };
        for (const std::string& name : macro_targets()) {
            target(name) = {};
            const double sign = name.find("max") != std::string::npos ? 1 : -1;
            if (name.ends_with("height"))
                target(name) = lines([&](const vec3<double>& p) { return vec3<double>(0, 0.2 * sign * p.y, 0); });
            else if (name.find("universal") != std::string::npos && name.ends_with("maxweight"))
                target(name) = lines([&](const vec3<double>& p) { return vec3<double>(0.15 * p.x, 0, 0.3 * p.z); });
        }
        const auto pair = [&](const std::string& name, const char* more, const char* less, const auto& displacement) {
            target(name + more) = lines(displacement);
            target(name + less) = lines([&](const vec3<double>& p) { return -displacement(p); });
        };
        pair("torso/torso-scale-depth", "-incr", "-decr", [](const vec3<double>& p) {
            return vec3<double>(0, 0, std::abs(p.x) < 1 && p.y > 0 && p.y < 5 ? 0.2 * p.z : 0);
        });
        for (const bool left : {true, false})
            pair(left ? "arms/l-lowerarm-fat" : "arms/r-lowerarm-fat", "-incr", "-decr", [&](const vec3<double>& p) {
                const bool here = (left ? p.x : -p.x) > 3;
                return vec3<double>(0, here ? 0.1 * (p.y - 3) : 0, 0);
            });
        pair("hip/hip-scale-vert", "-incr", "-decr",
             [](const vec3<double>& p) { return vec3<double>(0, std::abs(p.y) < 1 ? 0.1 : 0, 0); });
        pair("hip/hip-trans", "-forward", "-backward",
             [](const vec3<double>& p) { return vec3<double>(0, 0, std::abs(p.y) < 1 ? 1 : 0); });
        pair("nose/nose-trans", "-out", "-in",
             [](const vec3<double>& p) { return vec3<double>(p.y > 6 ? 1 : 0, 0, 0); });
        pair("chin/chin-width", "-incr", "-decr",
             [](const vec3<double>& p) { return vec3<double>(p.y > 6.6 ? 0.2 * p.x : 0, 0, 0); });
        pair("head/head-fat", "-incr", "-decr",
             [](const vec3<double>& p) { return vec3<double>(0, 0, p.y > 6.2 ? 0.1 * p.z : 0); });
        std::set<std::string> units;
        for (const auto expression : makehuman_expression_names)
            for (const std::string& unit : detail::units_of(expression)) units.insert(unit);
        for (const std::string& unit : units)
            for (const char* ancestry : {"african", "asian", "caucasian"})
                target("expression/units/" + std::string(ancestry) + "/" + unit) = lines([&](const vec3<double>& p) {
                    return vec3<double>(0, p.y > 6.6 ? 0.01 * static_cast<double>(unit.size()) : 0, 0);
                });
    }
};

} // namespace gsh::test
