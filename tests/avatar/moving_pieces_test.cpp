// SPDX-License-Identifier: Apache-2.0
/// @file  The motion of an avatar in rigid pieces, as Gaussians and as a .glb file.
#include <gsh/avatar/moving_pieces.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/io/splat/gltf_pieces.hpp>
#include <gsh/io/splat/gltf_splats.hpp>

#include "io/glb_json.hpp"
#include "io/temporary.hpp"
#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

/// Gaussians on a tube that bends over three frames.
struct BendingTube {
    cpu::Threads backend{2};
    AvatarData avatar;
    Motion motion;

    BendingTube() {
        BodyModel body = test::tube(4, 12, 8);
        const auto samples =
            sample_surface(body, shaped_vertices(body, {}), std::vector<double>(body.vertex_count(), 6.0), 3);
        avatar.rig = make_rig(body, {}, samples);
        avatar.gaussians.resize(samples.size(), 1);
        test::Rng rng(6);
        for (std::size_t i = 0; i < samples.size(); ++i) {
            avatar.gaussians.means[i] = vec3<float>(samples.positions[i]);
            avatar.gaussians.log_scales[i] = vec3<float>(rng.vec(-5, -3));
            avatar.gaussians.opacity_logits[i] = static_cast<float>(rng.normal());
            for (std::size_t k = 0; k < 4; ++k) avatar.gaussians.sh[4 * i + k] = vec3<float>(rng.vec(-0.3, 0.3));
            avatar.ao.push_back(static_cast<float>(rng.uniform(0.5, 1)));
            avatar.mean_irradiance.push_back(1);
        }
        motion = rest_motion(avatar.rig);
        motion.pose.assign(12, vec3<double>(0));
        for (std::size_t j = 4; j < 12; ++j) motion.pose[j] = vec3<double>(0.3, 0, 0.1) * double(j / 4);
        motion.transl = {{0, 0, 0}, {0, 0.1, 0}, {0.2, 0.2, 0}};
        motion.timestamps = {0, 0.5, 1};
    }
    [[nodiscard]] std::size_t size() const { return avatar.gaussians.size(); }
};

} // namespace

TEST_CASE("pieces follow the motion, better if there are more, and a .glb file moves them") {
    BendingTube s;
    StillFrames<cpu::Threads> still(s.backend, s.avatar);
    const std::vector<std::size_t> frames{0, 1, 2};
    double before = HUGE_VAL;
    for (const std::size_t count : {1, 8, 64}) {
        const MovingPieces pieces =
            moving_pieces(s.backend, still, s.motion, Span<const std::size_t>(frames), {.pieces = count});
        REQUIRE(pieces.begins.size() <= count + 1);
        REQUIRE(pieces.begins.back() == s.size());
        REQUIRE(pieces.poses.size() == 3);

        const test::Temporary folder;
        write_gltf_pieces(folder / "a.glb", pieces, Span<const double>(s.motion.timestamps), PixelFilter{0.1, true});
        double sum = 0;
        for (std::size_t t = 0; t < 3; ++t) {
            // The file's Gaussians at the time of a frame are those of the pieces under their poses.
            const StillSplats shown = read_gltf_splats(folder / "a.glb", s.motion.timestamps[t]);
            REQUIRE(shown.cloud.size() == s.size());
            REQUIRE(shown.notes.filter.has_value());
            for (std::size_t k = 0; k + 1 < pieces.begins.size(); ++k)
                for (std::size_t i = pieces.begins[k]; i < pieces.begins[k + 1]; ++i)
                    CHECK(length(vec3<double>(shown.cloud.means[i]) -
                                 pieces.poses[t][k](vec3<double>(pieces.cloud.means[i]))) < 1e-5);
            // As a set they lie where the avatar's are. Sums over the set do not depend on its order.
            const auto truth = still.frame(s.motion, t);
            const NearestPoints grid{[&] {
                std::vector<vec3<double>> points;
                for (const auto& mean : truth.means) points.push_back(vec3<double>(mean));
                return points;
            }()};
            for (const auto& mean : shown.cloud.means) sum += grid.squared_distance(vec3<double>(mean));
        }
        const double error = std::sqrt(sum / (3 * static_cast<double>(s.size())));
        CHECK(error < 0.7 * before);
        before = error;
    }
    CHECK(before < 0.004);
    // At rest the file shows the first frame.
    const MovingPieces pieces =
        moving_pieces(s.backend, still, s.motion, Span<const std::size_t>(frames).subspan(0, 1), {.pieces = 3});
    const test::Temporary folder;
    write_gltf_pieces(folder / "a.glb", pieces, Span<const double>(s.motion.timestamps).subspan(0, 1));
    CHECK(!test::json_of_glb(folder / "a.glb").contains("animations"));
    CHECK(read_gltf_splats(folder / "a.glb").cloud.size() == s.size());
}

TEST_CASE("one piece of a motion that turns the whole body has the shapes and colours of each frame") {
    BendingTube s;
    const vec3<double> turns[] = {{0, 0, 0}, {0.3, 1.2, -0.5}, {-1, 2, 0.4}};
    for (std::size_t j = 0; j < 12; ++j) s.motion.pose[j] = j % 4 == 0 ? turns[j / 4] : vec3<double>(0);
    StillFrames<cpu::Threads> still(s.backend, s.avatar);
    const std::vector<std::size_t> frames{0, 1, 2};
    const MovingPieces pieces =
        moving_pieces(s.backend, still, s.motion, Span<const std::size_t>(frames), {.pieces = 1});
    REQUIRE(pieces.begins.size() == 2);
    const auto covariance = [](const GaussianCloud<float>& cloud, std::size_t i) {
        const mat3<float> F = covariance_factor(cloud.quats[i], cloud.log_scales[i]);
        return F * transpose(F);
    };
    AvatarData dark = s.avatar;
    dark.mean_irradiance.clear();
    const GaussianCloud<float> canonical = shaded_cloud(dark);
    for (const std::size_t t : frames) {
        GaussianCloud<float> moved = pieces.cloud;
        move_cloud(moved, pieces.poses[t][0]);
        const GaussianCloud<float> truth = still.frame(s.motion, t);
        double mean = 0, shape = 0, colour = 0;
        for (std::size_t i = 0; i < s.size(); ++i) {
            mean = std::max<double>(mean, length(moved.means[i] - truth.means[i]));
            const mat3<float> difference = covariance(moved, i) - covariance(truth, i);
            for (int c = 0; c < 3; ++c) shape = std::max<double>(shape, length(difference[c]));
            for (std::size_t k = 0; k < 4; ++k)
                colour = std::max<double>(colour, length(moved.sh[4 * i + k] - truth.sh[4 * i + k]));
        }
        // From R d the body looks as the canonical one does from d.
        const mat3<float> R(rotation_from_axis_angle(turns[t]));
        const vec3<float> dir = normalize(vec3<float>(0.3f, -0.5f, 0.8f));
        for (std::size_t i = 0; i < s.size(); ++i)
            CHECK(length(SHEval<1>::forward(&moved.sh[4 * i], R * dir) -
                         SHEval<1>::forward(&canonical.sh[4 * i], dir)) < 1e-5f);
        CHECK(mean < 1e-5);
        CHECK(shape < 1e-6); // of up to e^-6 = 0.0025
        CHECK(colour < 1e-5);
    }
}

TEST_CASE("what pieces cannot be made of") {
    BendingTube s;
    StillFrames<cpu::Threads> still(s.backend, s.avatar);
    CHECK_THROWS_AS((void)moving_pieces(s.backend, still, s.motion, Span<const std::size_t>()), ValueError);
    const std::vector<std::size_t> frames{0, 1};
    const auto stopped = moving_pieces(s.backend, still, s.motion, Span<const std::size_t>(frames), {.pieces = 2},
                                       [](double share) { return share < 0.5; });
    CHECK(stopped.poses.empty());
    const auto pieces = moving_pieces(s.backend, still, s.motion, Span<const std::size_t>(frames), {.pieces = 2});
    const test::Temporary folder;
    const std::vector<double> back{1, 0}, few{0}, good{0, 1}, one_float{1e9, 1e9 + 1};
    CHECK_THROWS_AS(write_gltf_pieces(folder / "a.glb", pieces, Span<const double>(back)), ValueError);
    CHECK_THROWS_AS(write_gltf_pieces(folder / "a.glb", pieces, Span<const double>(few)), ShapeError);
    CHECK_THROWS_AS(write_gltf_pieces(folder / "a.glb", pieces, Span<const double>(one_float)), ValueError);
    MovingPieces empty = pieces;
    empty.begins[1] = empty.begins[2]; // nothing is left for the second piece
    test::check_throws<ValueError>([&] { write_gltf_pieces(folder / "a.glb", empty, Span<const double>(good)); },
                                   {"piece 1 has no Gaussian"});
    CHECK(folder.file_count() == 0);
}

TEST_CASE("keys of a rotation stay on one side") {
    std::vector<mat3<double>> turns;
    for (int k = 0; k < 20; ++k) turns.push_back(rotation_from_axis_angle(vec3<double>(0, 0.4 * k, 0)));
    const auto keys = rotation_keys(turns);
    for (std::size_t k = 4; k < keys.size(); k += 4) {
        float cosine = 0;
        for (std::size_t c = 0; c < 4; ++c) cosine += keys[k + c] * keys[k - 4 + c];
        CHECK(cosine > 0.9f);
    }
}
