// SPDX-License-Identifier: Apache-2.0
#include "view/view_package.hpp"

#include "view/view_scene.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/coarse_mesh.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/low_rank.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::programs {

namespace {

using Json = nlohmann::json;

/// The components of vectors, one after the other.
template <class Vectors>
std::vector<float> flat(const Vectors& vectors) {
    std::vector<float> result;
    result.reserve(3 * vectors.size());
    for (const auto& v : vectors)
        for (int axis = 0; axis < 3; ++axis) result.push_back(static_cast<float>(v[axis]));
    return result;
}

std::vector<std::uint32_t> flat(const std::vector<std::array<int, 3>>& triangles) {
    std::vector<std::uint32_t> result;
    for (const auto& t : triangles)
        for (const int v : t) result.push_back(static_cast<std::uint32_t>(v));
    return result;
}

/// Adds arrays under a person's prefix.
class Writer {
public:
    Writer(Package& package, std::string prefix, ScenePacking packing)
        : package_(&package), prefix_(std::move(prefix)), packing_(packing) {}

    void add(const char* name, const std::vector<float>& numbers, std::size_t columns, Stored compact) const {
        package_->add(prefix_ + name, numbers, columns, packing_ == ScenePacking::exact ? Stored::exact : compact);
    }
    void add(const char* name, const std::vector<std::uint32_t>& numbers, std::size_t columns) const {
        package_->add_indices(prefix_ + name, numbers, columns);
    }
    void add_skin(const char* joints, const char* weights, const SkinWeightTable<float>& skin) const {
        add(joints, std::vector<std::uint32_t>(skin.joints.begin(), skin.joints.end()), skin.influences);
        add(weights, skin.weights, skin.influences, Stored::eight);
    }

private:
    Package* package_;
    std::string prefix_;
    ScenePacking packing_;
};

/// Sixteen bits, unless the largest step of a column would be seen, because outliers widen it.
Stored sixteen_if_fine(const std::vector<float>& numbers, std::size_t columns, double seen) {
    for (std::size_t c = 0; c < columns && c < numbers.size(); ++c) {
        double low = numbers[c], high = low;
        for (std::size_t i = c; i < numbers.size(); i += columns)
            low = std::min<double>(low, numbers[i]), high = std::max<double>(high, numbers[i]);
        if ((high - low) / 65535 > seen) return Stored::exact;
    }
    return Stored::sixteen;
}

/// The size that most Gaussians exceed.
double typical_size(const GaussianCloud<float>& cloud) {
    std::vector<double> sizes;
    for (const vec3<float>& log_scale : cloud.log_scales) sizes.push_back(size_of(log_scale));
    return sizes.empty() ? 1 : gsh::detail::middle_of(sizes);
}

void add_cloud(const Writer& to, const GaussianCloud<float>& cloud) {
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    std::vector<float> quats, opacities, constant, bands;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const quat<float>& q = cloud.quats[i];
        const float scale = 1 / std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
        quats.insert(quats.end(), {q.w * scale, q.x * scale, q.y * scale, q.z * scale});
        opacities.push_back(sigmoid(cloud.opacity_logits[i]));
        for (std::size_t k = 0; k < basis; ++k)
            for (int c = 0; c < 3; ++c) (k == 0 ? constant : bands).push_back(cloud.sh[i * basis + k][c]);
    }
    const std::vector<float> means = flat(cloud.means);
    to.add("means", means, 3, sixteen_if_fine(means, 3, typical_size(cloud) / 2));
    to.add("quats", quats, 4, Stored::eight);
    to.add("log_scales", flat(cloud.log_scales), 3, Stored::sixteen);
    to.add("opacities", opacities, 1, Stored::eight);
    to.add("sh_constant", constant, 3, sixteen_if_fine(constant, 3, 0.02));
    if (basis > 1) to.add("sh_bands", bands, 3 * (basis - 1), Stored::eight);
}

void add_body(const Writer& to, const RigData& rig) {
    const BodyModel& body = rig.body;
    to.add("rest", flat(shaped_vertices(body, rig.betas)), 3, Stored::sixteen);
    const auto add_directions = [&](const char* name, const std::vector<vec3<double>>& directions) {
        if (!directions.empty())
            to.add(name, flat(directions), directions.size() / body.vertex_count() * 3, Stored::eight);
    };
    add_directions("shape_directions", body.shapedirs);
    add_directions("expression_directions", body.exprdirs);
    add_directions("pose_directions", body.posedirs);
    to.add("triangles", flat(rig.triangles), 3);
    to.add("barycentric", flat(rig.barycentric), 3, Stored::sixteen);
    to.add_skin("skin_joints", "skin_weights", rig.skin.cast<float>());
    to.add_skin("vertex_joints", "vertex_weights", sparse_weights(body.weights, body.joint_count()).cast<float>());
}

/// The basis of an ambient occlusion that follows motions, by Gaussian.
void add_occlusion(const Writer& to, const LowRank& occlusion) {
    const std::size_t rank = occlusion.rank, count = occlusion.basis.size() / rank;
    std::vector<float> by_gaussian(occlusion.basis.size());
    for (std::size_t k = 0; k < rank; ++k)
        for (std::size_t i = 0; i < count; ++i) by_gaussian[i * rank + k] = occlusion.basis[k * count + i];
    to.add("occlusion_basis", by_gaussian, rank, Stored::eight);
}

/// Adds what the light needs, and returns its numbers.
Json add_light(const Writer& to, const AvatarData& data, const vec3<double>& centre) {
    const LightData& light = *data.light;
    const BodyModel& body = data.rig.body;
    const CoarseMesh caster =
        coarse_mesh(shaped_vertices(body, data.rig.betas), body.faces, AvatarParams().caster_spacing);
    to.add("faces", flat(body.faces), 3);
    to.add("caster_vertices", caster.picked, 1);
    to.add("caster_triangles", flat(caster.faces), 3);
    if (!data.normal_offsets.empty()) to.add("normal_offsets", flat(data.normal_offsets), 3, Stored::eight);
    const ShadowMapParams maps;
    return {{"points", flat(light.points)},
            {"directions", flat(light.directions)},
            {"log_intensities", light.log_intensities},
            {"gloss", light.gloss},
            {"shadows", light.shadows},
            {"centre", {centre.x, centre.y, centre.z}},
            {"resolutions", {maps.point_resolution, maps.direction_resolution}},
            {"softness", {maps.point_softness, maps.direction_softness}},
            {"lift", maps.normal_offset}};
}

const char* name_of(Deformation deformation) {
    switch (deformation) {
    case Deformation::linear:
        return "linear";
    case Deformation::polar:
        return "polar";
    case Deformation::dual_quaternion:
        break;
    }
    return "dual_quaternion";
}

} // namespace

std::string package_scene(const ViewScene& scene, ScenePacking packing, const LowRank* occlusion) {
    Package package;
    package.header = {{"dilation", scene.filter.dilation},
                      {"compensate", scene.filter.compensate_opacity},
                      {"people", Json::array()}};
    if (!scene.people) {
        add_cloud(Writer(package, "0/", packing), scene.cloud);
        package.header["people"].push_back({{"degree", scene.cloud.sh_degree}, {"clamp_above", false}});
    }
    for (std::size_t p = 0; scene.people && p < scene.people->data.size(); ++p) {
        const AvatarData& data = scene.people->data[p];
        const Writer to(package, std::to_string(p) + '/', packing);
        Json person{{"degree", data.gaussians.sh_degree},
                    {"clamp_above", data.clamping == ColorClamp::both},
                    {"deformation", name_of(data.deformation)},
                    {"ao_is_mean", data.occlusion_field.has_value()}};
        add_cloud(to, data.gaussians);
        if (!data.ao.empty()) to.add("ao", data.ao, 1, Stored::eight);
        if (p == 0 && occlusion && occlusion->rank > 0) add_occlusion(to, *occlusion);
        add_body(to, data.rig);
        if (data.light) person["light"] = add_light(to, data, scene.light_centre(p));
        package.header["people"].push_back(person);
    }
    return package.bytes();
}

std::string package_motion(const ViewMotion& motion, const std::vector<std::string>& warnings, const LowRank* occlusion,
                           std::size_t first_row) {
    const Motion& m = motion.motion;
    Package package;
    package.header = {{"name", motion.name}, {"betas", m.betas}, {"warnings", warnings}};
    package.add("pose", flat(m.pose), 3 * m.joint_count);
    package.add("transl", flat(m.transl), 3);
    if (m.expression_count > 0)
        package.add("expression", std::vector<float>(m.expression.begin(), m.expression.end()), m.expression_count);
    std::vector<float> seconds;
    for (const double t : m.timestamps) seconds.push_back(static_cast<float>(t - m.timestamps[0]));
    package.add("seconds", seconds, 1);
    if (occlusion && occlusion->rank > 0) {
        const auto begin = occlusion->coefficients.begin() + static_cast<std::ptrdiff_t>(first_row * occlusion->rank);
        const auto end = begin + static_cast<std::ptrdiff_t>(m.frame_count() * occlusion->rank);
        package.add("occlusion", std::vector<float>(begin, end), occlusion->rank);
    }
    return package.bytes();
}

} // namespace gsh::programs
