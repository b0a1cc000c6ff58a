// SPDX-License-Identifier: Apache-2.0
/// @file  Shared by the stories about parts of one's own: photographs of the built-in actor, and points on its surface.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/model/avatar_model.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/trainer.hpp>

#include <memory>
#include <vector>

namespace gsh::examples {

/// Four frames of the actor who talks, filmed by seven cameras of 128 pixels, and `count` points on the actor's skin.
struct FilmedActor {
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion motion = actor_motion(ActorMotion::talk, 4);
    Capture capture;
    SurfaceSamples skin;
    RigData rig;
    std::shared_ptr<const CanonicalPoints<cpu::Threads>> points;

    explicit FilmedActor(cpu::Threads& backend, std::size_t count = 4000)
        : capture(film(backend, body, motion, {.image_size = 128, .samples = 4, .light = {}})) {
        const auto vertices = shaped_vertices(body, motion.betas);
        skin = sample_surface(body, vertices, std::vector(vertices.size(), 1.0), 1, {.total = count});
        rig = make_rig(body, motion.betas, skin);
        points = std::make_shared<const CanonicalPoints<cpu::Threads>>(backend, skin.positions);
    }
};

} // namespace gsh::examples
