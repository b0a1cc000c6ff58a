// SPDX-License-Identifier: Apache-2.0
/// @file  The fit of a motion: seconds of CPU a frame, from keypoints alone and with masks.
#include <gsh/fit/fit_motion.hpp>

#include <gsh/backend/serial.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/image/image.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <benchmark/benchmark.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

namespace {

using namespace gsh;

/// The actor in 60 frames before cameras of 540 x 540, as a detector with an error of 1 cm sees it.
struct Filmed {
    BodyModel body = make_actor();
    Motion motion = actor_motion(ActorMotion::stride, 60);
    std::vector<Camera<double>> cameras;
    std::vector<PersonPhoto> photos;
    std::vector<Image<std::uint8_t>> masks;

    Filmed(int count, bool with_masks) {
        const Landmarks marks = landmarks_of(body);
        const MotionLandmarks places(body, motion, marks);
        Rng rng(1);
        cpu::Serial backend;
        for (int c = 0; c < count; ++c) {
            const double angle = 2 * std::numbers::pi * c / count;
            cameras.push_back(look_at<double>({3 * std::sin(angle), 0.4, 3 * std::cos(angle)}, {0, -0.1, 0}, {0, 1, 0},
                                              0.75, 540, 540));
        }
        for (std::size_t c = 0; c < cameras.size(); ++c)
            for (std::size_t t = 0; t < motion.frame_count(); ++t) {
                PersonPhoto photo{c, t, {}, {}};
                for (int l = 0; l < static_cast<int>(marks.size()); ++l) {
                    if (l % 2 == 1 && mirrored_landmark(l) == l) continue;
                    const vec3<double> x = to_camera(cameras[c], places.at(t, l));
                    const vec2<double> off{0.01 * rng.normal(), 0.01 * rng.normal()};
                    photo.person.points.push_back({l, to_pixel(cameras[c], x) + off * (cameras[c].fx / x.z), 0.9});
                    if (l < 36) photo.person.metric.push_back({l, cameras[c].R * places.at(t, l)});
                }
                photos.push_back(std::move(photo));
                if (!with_masks) continue;
                const PosedBody posed = pose_body(body, motion.pose_at(t), motion.transl[t], motion.betas);
                masks.push_back(
                    rasterize_mesh(backend, Span<const vec3<double>>(posed.vertices), body.faces, cameras[c]).mask());
                for (std::uint8_t& pixel : masks.back().data) pixel = static_cast<std::uint8_t>(255 * pixel);
            }
        for (std::size_t i = 0; i < masks.size(); ++i)
            photos[i].mask = {masks[i].height, masks[i].width, masks[i].data.data()};
    }
};

void fit(benchmark::State& state) {
    const Filmed filmed(static_cast<int>(state.range(0)), state.range(1) != 0);
    for (auto _ : state)
        benchmark::DoNotOptimize(
            fit_motion(filmed.body, filmed.cameras, filmed.photos, filmed.motion.timestamps, {.betas = 10}));
    state.counters["ms_per_frame"] =
        benchmark::Counter(static_cast<double>(filmed.motion.frame_count()) * 1e-3,
                           benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(fit)
    ->ArgNames({"cameras", "masks"})
    ->Args({1, 0})
    ->Args({1, 1})
    ->Args({6, 0})
    ->Args({6, 1})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);

} // namespace
