// SPDX-License-Identifier: Apache-2.0
/// What is written comes back: Gaussians in every format within its stated steps, motions, avatars.
#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "properties/properties.hpp"
#include "support/bodies.hpp"
#include "support/skeleton_body.hpp"

#include <gsh/body/rig_motion.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/bvh_file.hpp>
#include <gsh/io/motion/gltf_export.hpp>
#include <gsh/io/motion/gltf_motion.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/any_splats.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/quat.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

using namespace gsh;
using namespace gsh::test;

namespace {

/// Where thousands of files are written: in memory where Linux offers it, since a disk would be waited for each time.
std::filesystem::path quick_folder() {
    std::error_code ignored;
    const std::filesystem::path memory = "/dev/shm";
    return std::filesystem::is_directory(memory, ignored) ? memory : std::filesystem::temp_directory_path();
}

/// Gaussians of very different places, sizes, opacities and colours, some in one place.
GaussianCloud<float> any_splats(int most_degree) {
    const std::size_t count = 1 + up_to(20);
    GaussianCloud<float> cloud(count, int(below(std::size_t(most_degree) + 1)));
    const double reach = one_of({2.0, 0.0, 1e-6, 300.0, 1e5});
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = vec3<float>(around(vec3<double>(0), reach));
        cloud.log_scales[i] = vec3<float>(around(vec3<double>(-5), 4));
        if (rarely(6)) cloud.log_scales[i][int(below(3))] = one_of({-20.0f, 3.0f, -60.0f, -200.0f, 20.0f, 44.0f});
        const auto q = any_quat();
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        if (rarely(4)) cloud.quats[i] = one_of({quat<float>{1, 0, 0, 0}, {0, 0, 0, -1}, {-1, 1, -1, 1}, {0, 1, 1, 0}});
        cloud.opacity_logits[i] = float(around(0, 8));
        if (rarely(6)) cloud.opacity_logits[i] = one_of({20.0f, -20.0f, 90.0f, -90.0f});
    }
    gsh::test::Rng rng(below(1000));
    const double size = one_of({0.9, 1.7, 6.0});
    for (auto& v : cloud.sh) v = vec3<float>(rng.vec(-size, size));
    return cloud;
}

/// The steps and limits of a format: half a step is the largest difference.
struct FormatSteps {
    std::string ending;
    int degree = 3, version = 0;
    double mean = 0; ///< largest difference, beside rounding to a float
    double log_scale = 0, least_log_scale = -1e9, largest_log_scale = 1e9;
    double flat_below = -1e9;         ///< a log-scale from which on a length is rounded to 0, which is read as -20
    double rotation = 0, opacity = 0; ///< of a matrix entry; of the opacity
    double dc = 0, most_dc = 1e9;     ///< of the constant coefficient
    double first = 0, others = 0, most_sh = 1e9;             ///< of degree 1 and above
    double scale_share = 0, mean_share = 0, color_share = 0; ///< of the extent of all, in place of a fixed step
};

double extent_of(const std::vector<vec3<float>>& values, int axis, double low, double high) {
    double least = high, most = low;
    for (const auto& v : values) {
        const double x = std::clamp(double(v[axis]), low, high);
        least = std::min(least, x), most = std::max(most, x);
    }
    return std::max(0.0, most - least);
}

void require_within(double found, double expected, double tolerance, const std::string& what, std::size_t i) {
    require(std::abs(found - expected) <= tolerance, [&] { // false for NaN
        return what + " of Gaussian " + std::to_string(i) + " is " + digits(found) + ", expected " + digits(expected) +
               " within " + digits(tolerance);
    });
}

void require_back(const GaussianCloud<float>& found, const GaussianCloud<float>& cloud, const FormatSteps& f) {
    require(found.size() == cloud.size(), [&] {
        return f.ending + ": " + std::to_string(found.size()) + " Gaussians, expected " + std::to_string(cloud.size());
    });
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const auto own = static_cast<std::size_t>(sh_basis_count(found.sh_degree));
    require(found.sh_degree == std::min(cloud.sh_degree, f.degree), [&] { return f.ending + ": another degree"; });
    std::vector<vec3<float>> constants;
    for (std::size_t i = 0; i < cloud.size(); ++i) constants.push_back(cloud.sh[i * basis]);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const mat3<float> R = rotation_matrix(normalize(found.quats[i])),
                          E = rotation_matrix(normalize(cloud.quats[i]));
        for (int k = 0; k < 3; ++k) {
            const double mean = cloud.means[i][k];
            require_within(found.means[i][k], mean,
                           f.mean + f.mean_share * extent_of(cloud.means, k, -1e30, 1e30) +
                               2e-7 * extent_of(cloud.means, k, -1e30, 1e30) +
                               (f.mean + f.mean_share > 0 ? 1e-7 * std::abs(mean) : 0),
                           f.ending + ": a mean", i);
            const bool flat = cloud.log_scales[i][k] < f.flat_below;
            const double s =
                std::clamp(flat ? -20 : double(cloud.log_scales[i][k]), f.least_log_scale, f.largest_log_scale);
            if (!flat || found.log_scales[i][k] > -20)
                require_within(found.log_scales[i][k], s,
                               f.log_scale + f.scale_share *
                                                 extent_of(cloud.log_scales, k, f.least_log_scale, f.largest_log_scale),
                               f.ending + ": a log-scale", i);
            for (int r = 0; r < 3; ++r)
                require_within(R[k][r], E[k][r], f.rotation + 2e-6, f.ending + ": a rotation", i);
            const double dc = std::clamp(double(cloud.sh[i * basis][k]), -f.most_dc, f.most_dc);
            require_within(found.sh[i * own][k], dc,
                           f.dc + f.color_share * extent_of(constants, k, -f.most_dc, f.most_dc) + 1e-6 * std::abs(dc),
                           f.ending + ": a constant colour", i);
            for (std::size_t n = 1; n < own; ++n)
                require_within(found.sh[i * own + n][k],
                               std::clamp(double(cloud.sh[i * basis + n][k]), -f.most_sh, f.most_sh),
                               n < 4 ? f.first : f.others, f.ending + ": a coefficient", i);
        }
        require_within(sigmoid(double(found.opacity_logits[i])), sigmoid(double(cloud.opacity_logits[i])), f.opacity,
                       f.ending + ": an opacity", i);
    }
}

void check_format(const FormatSteps& steps, double most_reach = 1e30) {
    const gsh::test::Temporary folder(quick_folder());
    check_property([&] {
        GaussianCloud<float> cloud = any_splats(3);
        // In compressed PLY, a copy of the Gaussian before without opacity is a filler, which is left out.
        if (steps.ending == ".compressed.ply")
            for (float& o : cloud.opacity_logits) o = std::max(o, -6.0f);
        for (auto& m : cloud.means) m = glm::clamp(m, float(-most_reach), float(most_reach));
        const auto path = folder / ("cloud" + steps.ending);
        (void)save_splats(path, cloud, {.version = steps.version});
        StillSplats back = load_any_splats(path);
        if (steps.ending == ".splat") restate_up(back, UpAxis::minus_y); // it cannot state what save_splats wrote
        require_back(back.cloud, cloud, steps);
    });
}

constexpr double half_byte = 0.5 / 255 + 1e-6, to_dc = 3.5449077018110318; // a colour's step to its coefficient's

/// A motion of the built-in actor's joints with steady times.
Motion any_motion_of(const BodyModel& body) {
    Motion motion;
    motion.joint_count = body.joint_count();
    motion.betas = {around(0, 1)};
    const std::size_t frames = 2 + up_to(4);
    gsh::test::Rng rng(below(1000));
    const double angle = one_of({0.5, 0.0, 1.8, 3.1}), step = 1.0 / one_of({30.0, 24.0, 60.0, 120.0});
    motion.pose = rng.vecs(frames * motion.joint_count, -angle, angle);
    if (rarely(3)) motion.pose[below(motion.pose.size())] = {std::acos(-1.0) / 2, 0, 0};
    for (std::size_t t = 0; t < frames; ++t) {
        motion.transl.push_back(around(vec3<double>(0), one_of({1.0, 30.0})));
        motion.timestamps.push_back(double(t) * step);
    }
    return motion;
}

/// Compares joints, turns from the rest pose and times. `names` may have more joints, such as ends.
void require_same_motion(const RigMotion& found, const RigMotion& rig, double place, double turn, const char* what) {
    require(found.frame_count() == rig.frame_count(), [&] {
        return std::string(what) + ": " + std::to_string(found.frame_count()) + " frames of " +
               std::to_string(rig.frame_count());
    });
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        require(std::abs(found.timestamps[t] - found.timestamps[0] - rig.timestamps[t] + rig.timestamps[0]) <= 1e-5,
                [&] { return std::string(what) + ": a time"; });
    for (std::size_t j = 0; j < rig.joint_count(); ++j) {
        const auto at = std::ranges::find(found.names, rig.names[j]);
        require(at != found.names.end(), [&] { return std::string(what) + ": lost " + rig.names[j]; });
        const int k = int(at - found.names.begin()), i = int(j);
        for (std::size_t t = 0; t < rig.frame_count(); ++t) {
            const double away = length(found.joint(t, k) - rig.joint(t, i));
            require(away <= place,
                    [&] { return std::string(what) + ": " + rig.names[j] + " is off by " + digits(away); });
            const mat3<double> a = found.rotation(t, k) * transpose(found.rest_rotations[std::size_t(k)]),
                               b = rig.rotation(t, i) * transpose(rig.rest_rotations[j]);
            const double angle = length(axis_angle_from_rotation(transpose(a) * b));
            require(angle <= turn,
                    [&] { return std::string(what) + ": " + rig.names[j] + " turned by " + digits(angle); });
        }
    }
}

} // namespace

TEST_CASE("any Gaussians come back from PLY, bit for bit") {
    check_format({.ending = ".ply"});
}

TEST_CASE("any Gaussians come back from glTF within rounding") {
    check_format({.ending = ".glb", .log_scale = 1e-5, .flat_below = -20.7, .opacity = 1e-7});
}

TEST_CASE("any Gaussians come back from .splat within half a byte") {
    check_format({.ending = ".splat",
                  .degree = 0,
                  .log_scale = 1e-5,
                  .least_log_scale = -20,
                  .rotation = 0.05,
                  .opacity = half_byte,
                  .dc = to_dc * half_byte,
                  .most_dc = to_dc / 2});
}

TEST_CASE("any Gaussians come back from SPZ of versions 3 and 4 within half its steps") {
    for (const int version : {3, 4})
        check_format({.ending = ".spz",
                      .version = version,
                      .mean = std::ldexp(1.0, -13) + 1e-9,
                      .log_scale = 1.0 / 32 + 1e-6,
                      .least_log_scale = -10,
                      .largest_log_scale = 5.9375,
                      .rotation = 0.012,
                      .opacity = half_byte,
                      .dc = 0.5 / (0.15 * 255) + 1e-6,
                      .most_dc = 127.5 / (0.15 * 255),
                      .first = 4.51 / 128,
                      .others = 8.51 / 128,
                      .most_sh = 1},
                     2047); // beyond, steps are larger
}

TEST_CASE("any Gaussians come back from compressed PLY within half its steps") {
    check_format({.ending = ".compressed.ply",
                  .mean = 1e-30,
                  .log_scale = 4e-6,
                  .least_log_scale = -20,
                  .largest_log_scale = 20,
                  .rotation = 0.012,
                  .opacity = half_byte,
                  .dc = 2e-6,
                  .first = 4.001 / 256,
                  .others = 4.001 / 256,
                  .most_sh = 4 - 4.0 / 256,
                  .scale_share = 0.5001 / 1023,
                  .mean_share = 0.5001 / 1023,
                  .color_share = 0.5001 / 255});
}

TEST_CASE("any motion comes back from .npz, number by number") {
    const gsh::test::Temporary folder(quick_folder());
    check_property([&] {
        const BodyModel body = small_body(one_of<std::size_t>({55, 24, 52}), 3, 2, rarely(2));
        Motion motion;
        motion.joint_count = body.joint_count();
        motion.expression_count = below(3);
        const std::size_t frames = 1 + up_to(4);
        gsh::test::Rng rng(below(1000));
        const double size = one_of({1.0, 0.0, 3.1, 1e-300, 1e3, 1e30});
        motion.betas = rng.numbers(below(4), -size, size);
        motion.pose = rng.vecs(frames * motion.joint_count, -size, size);
        motion.expression = rng.numbers(frames * motion.expression_count, -size, size);
        motion.transl = rng.vecs(frames, -size, size);
        double time = around(0, 3); // readers take steps of 5 s and more for milliseconds
        for (std::size_t t = 0; t < frames; ++t) motion.timestamps.push_back(time), time += one_of({0.04, 1e-3, 1.0});
        save_motion(folder / "motion.npz", motion);
        const Motion back = load_motion(folder / "motion.npz", body);
        require(back.pose == motion.pose && back.transl == motion.transl, [] { return "poses or places differ"; });
        // Missing coefficients are zeros.
        motion.betas.resize(std::size_t(body.shape_count), 0.0);
        require(back.betas == motion.betas, [] { return "betas differ"; });
        for (std::size_t t = 0; t < frames; ++t)
            for (std::size_t k = 0; k < back.expression_count; ++k)
                require(back.expression_at(t)[k] == (k < motion.expression_count ? motion.expression_at(t)[k] : 0),
                        [] { return "expressions differ"; });
        require(back.timestamps == motion.timestamps, [] { return "times differ"; });
    });
}

TEST_CASE("any motion of a person comes back from BVH and from glTF within their digits") {
    const gsh::test::Temporary folder(quick_folder());
    check_property([&] {
        const RigMotion rig = rig_of_motion(skeleton_body(), any_motion_of(skeleton_body()));
        save_bvh(folder / "motion.bvh", rig);
        require_same_motion(load_bvh(folder / "motion.bvh"), rig, 2e-7, 2e-7, "BVH");
        save_gltf_motion(folder / "motion.glb", rig);
        // Each of up to a dozen joints from the hips to a finger adds the rounding of a quaternion.
        require_same_motion(load_gltf_motion(folder / "motion.glb"), rig, 1e-5, 5e-6, "glTF");
    });
}

TEST_CASE("any avatar comes back from its file, number by number, and is written again as the same bytes") {
    const gsh::test::Temporary folder(quick_folder());
    check_property([&] {
        const BodyModel body = tube(1 + below(4), 3, 4, 1 + below(50));
        const std::vector<double> betas = gsh::test::Rng(below(100)).numbers(below(4));
        const auto samples = sample_surface(body, shaped_vertices(body, betas),
                                            std::vector<double>(body.vertex_count(), double(below(12))), 3);
        const std::size_t N = samples.size();
        AvatarData avatar{make_rig(body, betas, samples), any_splats(4)};
        avatar.gaussians.resize(N, avatar.gaussians.sh_degree);
        avatar.clamping = one_of({ColorClamp::both, ColorClamp::below});
        avatar.filter = {one_of({0.3, 0.0, 1e5}), rarely(2)};
        avatar.deformation = one_of({Deformation::linear, Deformation::polar, Deformation::dual_quaternion});
        gsh::test::Rng rng(below(1000));
        const auto floats = [&](std::size_t count) {
            const auto numbers = rng.numbers(count, 0, 1);
            return std::vector<float>(numbers.begin(), numbers.end());
        };
        if (rarely(2)) avatar.ao = floats(N);
        if (rarely(2)) avatar.mean_irradiance = floats(N);
        if (rarely(2))
            for (const auto& v : rng.vecs(body.vertex_count())) avatar.normal_offsets.emplace_back(v);
        if (rarely(2)) avatar.light = even_light(2, 6, {0, 0.8, 0}, 2), avatar.light_place.low = rng.vec();
        const auto path = folder / "avatar.gsh", again = folder / "again.gsh";
        save_avatar(path, avatar);
        const AvatarData back = load_avatar(path);
        const GaussianCloud<float>&g = avatar.gaussians, &h = back.gaussians;
        require(h.means == g.means && h.log_scales == g.log_scales && h.sh == g.sh &&
                    h.opacity_logits == g.opacity_logits && h.sh_degree == g.sh_degree,
                [] { return "the Gaussians differ"; });
        for (std::size_t i = 0; i < N; ++i)
            require(h.quats[i].w == g.quats[i].w && h.quats[i].z == g.quats[i].z,
                    [] { return "a quaternion differs"; });
        require(back.rig.betas == avatar.rig.betas && back.rig.joints == avatar.rig.joints &&
                    back.rig.triangles == avatar.rig.triangles && back.rig.barycentric == avatar.rig.barycentric &&
                    back.rig.skin.weights == avatar.rig.skin.weights && back.rig.skin.joints == avatar.rig.skin.joints,
                [] { return "the rig differs"; });
        const BodyModel &b = avatar.rig.body, &c = back.rig.body;
        require(c.v_template == b.v_template && c.shapedirs == b.shapedirs && c.exprdirs == b.exprdirs &&
                    c.posedirs == b.posedirs && c.weights == b.weights && c.parents == b.parents && c.faces == b.faces,
                [] { return "the body differs"; });
        require(back.ao == avatar.ao && back.mean_irradiance == avatar.mean_irradiance &&
                    back.normal_offsets == avatar.normal_offsets && back.clamping == avatar.clamping &&
                    back.deformation == avatar.deformation && back.filter.dilation == avatar.filter.dilation &&
                    back.filter.compensate_opacity == avatar.filter.compensate_opacity,
                [] { return "what is beside Gaussians and rig differs"; });
        require(back.light.has_value() == avatar.light.has_value() &&
                    (!back.light || (back.light->log_intensities == avatar.light->log_intensities &&
                                     back.light_place.low == avatar.light_place.low)),
                [] { return "the light differs"; });
        save_avatar(folder / "compact.gsh", avatar, ArrayStorage::compact);
        const AvatarData compact = load_avatar(folder / "compact.gsh");
        require(compact.gaussians.size() == N && compact.gaussians.sh_degree == g.sh_degree,
                [] { return "the compact file has other Gaussians"; });
        for (std::size_t i = 0; i < N; ++i)
            for (int k = 0; k < 3; ++k) {
                require_within(compact.gaussians.means[i][k], g.means[i][k],
                               0.26 / 32767 * extent_of(g.means, k, -1e30, 1e30) + 1e-6 * std::abs(g.means[i][k]),
                               "compact: a mean", i);
                require_within(compact.gaussians.log_scales[i][k], g.log_scales[i][k],
                               0.26 / 127 * extent_of(g.log_scales, k, -1e30, 1e30) +
                                   1e-5 * std::abs(g.log_scales[i][k]),
                               "compact: a log-scale", i);
            }
        save_avatar(again, back);
        require(read_file(path) == read_file(again), [] { return "written again, it has other bytes"; });
    });
}
