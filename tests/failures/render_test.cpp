// SPDX-License-Identifier: Apache-2.0
/// Each allocation fails in turn while an avatar is posed and drawn; threads are refused; chunks throw.
#include <gsh/avatar/avatar.hpp>
#include <gsh/cpu.hpp>
#include <gsh/render/rasterizer.hpp>

#include "failures/failing_allocations.hpp"
#include "support/posed_scene.hpp"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// An avatar and what a frame of it needs, with empty caches.
template <class B>
struct DrawnAvatar {
    B backend;
    Avatar<B> avatar;
    Rasterizer<B> rasterizer;
    Camera<float> camera;
    typename Avatar<B>::Cache cache;
    typename Rasterizer<B>::Cache raster;
    RigPose<B, float> pose;

    DrawnAvatar(const test::PosedScene& scene, std::size_t threads)
        : backend([&] {
              if constexpr (std::is_same_v<B, cpu::Threads>)
                  return B(threads);
              else
                  return B();
          }()),
          avatar(backend, scene.avatar), rasterizer(backend), camera(scene.cameras[0].cast<float>()) {}

    /// Poses and draws a frame, and carries a gradient back to the pose.
    std::vector<float> frame(const test::PosedScene& scene) {
        constexpr int size = test::PosedScene::size;
        Splats<B> splats, dL_dsplats;
        splats.resize(avatar.size()), dL_dsplats.resize(avatar.size());
        Image<float> color(3, size, size), dL_dcolor(3, size, size, 0.01f);
        std::vector<vec3<float>> dL_dpose(scene.body.joint_count(), vec3<float>(0));
        fill_zero(backend, dL_dsplats.view());
        avatar.rig().upload_pose(scene.truth, 3, pose);
        avatar.pose(pose, camera.center(), splats.view(), cache);
        rasterizer.forward(camera, std::as_const(splats).view(), {}, {.color = color.view()}, raster);
        rasterizer.backward(camera, std::as_const(splats).view(), {}, {.color = std::as_const(dL_dcolor).view()},
                            raster, dL_dsplats.view());
        avatar.backward_to_pose(pose, camera.center(), std::as_const(dL_dsplats).view(), cache,
                                {.pose = Span<vec3<float>>(dL_dpose), .coefficients = {}, .transl = {}});
        for (const vec3<float>& v : dL_dpose) color.data.insert(color.data.end(), {v.x, v.y, v.z});
        return color.data;
    }
};

template <class B>
void exhaust_frame(const std::string& name, std::size_t threads) {
    const test::PosedScene scene;
    const auto prepare = [&] { return std::make_unique<DrawnAvatar<B>>(scene, threads); };
    const auto sum = test::exhaust(name, prepare, [&](const auto& drawn) { return drawn->frame(scene); });
    test::report(name, sum);
}

} // namespace

TEST_CASE("memory runs out while an avatar is made, posed and drawn, forwards and backwards") {
    exhaust_frame<cpu::Serial>("a frame on one thread", 1);
    exhaust_frame<cpu::Threads>("a frame of Threads", 1);
    const test::PosedScene scene;
    test::report("making an avatar", test::exhaust("making an avatar", [&] {
                     cpu::Serial backend;
                     const Avatar<cpu::Serial> avatar(backend, scene.avatar);
                     return avatar.size();
                 }));
}

TEST_CASE("an exception in each chunk of a loop arrives once, and the backend goes on") {
    for (const std::size_t threads : {1, 2, 7}) {
        cpu::Threads backend(threads);
        constexpr std::size_t chunks = 40, grain = 3, n = chunks * grain - 1;
        for (std::size_t bad = 0; bad < chunks; ++bad) {
            std::atomic<std::size_t> thrown = 0;
            std::size_t caught = 0;
            try {
                backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t, std::size_t) {
                    if (chunk != bad) return;
                    ++thrown;
                    throw std::out_of_range(std::to_string(chunk));
                });
            } catch (const std::out_of_range& error) {
                ++caught;
                CHECK(error.what() == std::to_string(bad));
            }
            CHECK(caught == 1);
            CHECK(thrown == 1);
            std::atomic<std::size_t> sum = 0;
            backend.for_chunks(n, grain, [&](std::size_t, std::size_t begin, std::size_t end) { sum += end - begin; });
            CHECK(sum == n);
        }
        // All chunks throw: one exception arrives.
        std::size_t caught = 0;
        try {
            backend.for_each(5000, [](std::size_t) { throw std::bad_alloc(); });
        } catch (const std::bad_alloc&) {
            ++caught;
        }
        CHECK(caught == 1);
        // A loop within a loop.
        CHECK_THROWS_AS(backend.for_chunks(8, 1,
                                           [&](std::size_t, std::size_t, std::size_t) {
                                               backend.for_chunks(8, 1,
                                                                  [](std::size_t chunk, std::size_t, std::size_t) {
                                                                      if (chunk == 5) throw std::runtime_error("inner");
                                                                  });
                                           }),
                        std::runtime_error);
    }
}
