// SPDX-License-Identifier: Apache-2.0
/// @file  Two people in one scene, filmed by the studio, and their files.
#pragma once

#include <gsh/backend/threads.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// How much is filmed.
struct FilmSize {
    int image_size = 64, frames = 2, cameras = 2, samples = 4;
};

/// Two actors who pass each other: "ann" walks to her left in front, "bob", of another build and in other colours, to
/// his right behind her. In the first and the last frame they stand side by side.
struct CrossingActors {
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion ann, bob;
    cpu::Threads backend;
    StudioParams studio;

    explicit CrossingActors(const FilmSize& size) {
        ann = crossing(actor_motion(ActorMotion::talk, size.frames), -1, 0.4);
        Motion other = actor_motion(ActorMotion::stride, size.frames);
        for (std::size_t k = 0; k < other.betas.size(); ++k) other.betas[k] = k % 2 ? -0.8 : 0.8;
        bob = crossing(std::move(other), 1, -0.4);
        studio.train_cameras = size.cameras, studio.image_size = size.image_size, studio.samples = size.samples;
        studio.distance = 4;
    }
    /// Walks along x from one side to the other, at a distance of the middle.
    [[nodiscard]] Motion crossing(Motion motion, double from, double z) const {
        const std::size_t frames = motion.frame_count();
        for (std::size_t t = 0; t < frames; ++t)
            motion.transl[t] +=
                vec3<double>(from * (0.55 - 1.1 * static_cast<double>(t) / static_cast<double>(frames - 1)), 0, z);
        return motion;
    }
    static SurfaceColor other_colors(const vec3<double>& p) {
        SurfaceColor color = actor_color(p);
        std::swap(color.albedo.x, color.albedo.z);
        return color;
    }
    [[nodiscard]] StudioActor first() const { return {&body, &ann}; }
    [[nodiscard]] StudioActor second() const { return {&body, &bob, other_colors}; }
    [[nodiscard]] Capture together() { return film(backend, {first(), second()}, studio); }
    /// One of them alone, seen by given cameras.
    [[nodiscard]] Capture alone(const StudioActor& actor, const std::vector<NamedCamera>& cameras) {
        StudioParams same = studio;
        same.cameras = cameras;
        return film(backend, {actor}, same);
    }
    /// The person at each pixel of the test views, by camera and frame: 0 ann, 1 bob, -1 nobody. Pure colours under
    /// the same light identify them, without a rasterizer.
    [[nodiscard]] std::map<std::string, std::vector<int>> owners(const std::vector<NamedCamera>& cameras) {
        StudioParams painted = studio;
        for (const NamedCamera& camera : cameras)
            if (camera.role == NamedCamera::Role::test) painted.cameras.push_back(camera);
        const auto pure = [](double r, double b) {
            return [=](const vec3<double>&) { return SurfaceColor{.albedo = {r, 0, b}, .gloss = 0}; };
        };
        const Capture capture = film(backend, {{&body, &ann, pure(0.9, 0)}, {&body, &bob, pure(0, 0.9)}}, painted);
        std::map<std::string, std::vector<int>> result;
        for (std::size_t c = 0; c < capture.cameras.size(); ++c)
            for (std::size_t f = 0; f < capture.frame_count(); ++f) {
                char name[64];
                std::snprintf(name, sizeof name, "%s_%04zu", capture.cameras[c].name.c_str(), f);
                const PixelImage& image = capture.image({c, f});
                auto& owner = result[name];
                for (std::size_t i = 0; i < image.data.size(); i += 4)
                    owner.push_back(image.data[i + 3] <= 127 ? -1 : image.data[i + 2] > image.data[i] ? 1 : 0);
            }
        return result;
    }
};

/// A capture's folder with a pose file for each of the people in it.
inline void save_people(const std::filesystem::path& folder, const Capture& capture,
                        const std::vector<std::pair<std::string, const Motion*>>& people) {
    save_capture(folder, capture);
    std::filesystem::remove(folder / "poses.npz");
    for (const auto& [name, motion] : people) save_motion(folder / (name + ".npz"), *motion);
}

} // namespace gsh::test
