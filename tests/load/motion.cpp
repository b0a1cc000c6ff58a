// SPDX-License-Identifier: Apache-2.0
/// A motion of very many frames through files, another rig and filters.
#include "load/load.hpp"

#include "io/temporary.hpp"

#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/gltf_export.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <string>

namespace gsh::load {

void long_motion(std::size_t frames, Verdict& verdict) {
    const BodyModel body = make_actor({.edge_scale = 1.5});
    const Motion motion = actor_motion(ActorMotion::stride, static_cast<int>(frames));
    const test::Temporary folder;
    const auto timed = [&](const std::string& what, const auto& deed) {
        const auto begin = std::chrono::steady_clock::now();
        const std::size_t found = deed();
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
        verdict.line(found == frames, what + ": " + std::to_string(found) + " frames in " +
                                          std::to_string(seconds.count()) + " s, " +
                                          megabytes(static_cast<double>(resident())) + " resident");
    };
    const auto through = [&](const char* name, const auto& save) {
        timed(name, [&] {
            save(folder / name);
            return load_any_motion(folder / name, body).frame_count();
        });
        std::filesystem::remove(folder / name);
    };
    through("motion.npz", [&](const auto& file) { save_motion(file, motion); });
    through("motion.bvh", [&](const auto& file) { save_bvh(file, rig_of_motion(body, motion)); });
    through("motion.glb", [&](const auto& file) { save_gltf_motion(file, rig_of_motion(body, motion)); });
}

} // namespace gsh::load
