// SPDX-License-Identifier: Apache-2.0
/// @file  The built-in actor's skeleton as a body with one vertex per joint, which is posed in no time.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/synthetic/actor_skeleton.hpp>

#include <cstddef>

namespace gsh::test {

inline const BodyModel& skeleton_body() {
    static const BodyModel body = [] {
        BodyModel model;
        const std::size_t J = actor_joint_count;
        model.weights.assign(J * J, 0.0);
        for (std::size_t j = 0; j < J; ++j) {
            model.v_template.push_back(actor_joint(static_cast<int>(j)));
            model.parents.push_back(actor_joints[j].parent);
            model.J_regressor.push_back({{static_cast<int>(j), 1.0}});
            model.weights[j * J + j] = 1;
        }
        model.shape_count = 1;
        for (std::size_t j = 0; j < J; ++j) model.shapedirs.push_back(model.v_template[j] * 0.05); // taller
        return model;
    }();
    return body;
}

} // namespace gsh::test
