// SPDX-License-Identifier: Apache-2.0
/// @file  A person made of boxes, captures of it that are right, and the usual faults.
#pragma once

#include <gsh/body/posed_body.hpp>
#include <gsh/check/capture_check.hpp>
#include <gsh/synthetic/actor_skeleton.hpp>

#include "support/chunks_alone.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test::boxes {

constexpr int photo_size = 96; // pixels, images are square

/// A person of 55 rigid boxes, one from each joint to its child. The pelvis is not at the origin, there is a mean hand,
/// and beta scales the whole body.
inline BodyModel box_person(double thickness = 1) {
    BodyModel body;
    const vec3<double> pelvis(0.01, -0.3, 0.04);
    const auto place = [&](std::size_t j) {
        const auto& p = actor_joints[j].position;
        return pelvis + vec3<double>(p[0], p[1], p[2]);
    };
    const auto add_box = [&](std::size_t joint, vec3<double> from, vec3<double> to, double width) {
        const vec3<double> along = normalize(to - from);
        const vec3<double> side =
            normalize(cross(along, std::abs(along.z) < 0.8 ? vec3<double>(0, 0, 1) : vec3<double>(1, 0, 0)));
        const vec3<double> up = cross(side, along);
        const int first = static_cast<int>(body.v_template.size());
        for (const vec3<double>& end : {from, to})
            for (const auto& [u, v] : {std::array{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}})
                body.v_template.push_back(end + (side * u + up * v) * (0.5 * width * thickness));
        for (int k = 0; k < 4; ++k) {
            const int a = first + k, b = first + (k + 1) % 4;
            body.faces.push_back({a, b, b + 4});
            body.faces.push_back({a, b + 4, a + 4});
        }
        for (const int end : {first, first + 4}) {
            body.faces.push_back({end, end + 1, end + 2});
            body.faces.push_back({end, end + 2, end + 3});
        }
        for (int k = 0; k < 8; ++k)
            for (std::size_t j = 0; j < actor_joints.size(); ++j) body.weights.push_back(j == joint);
        return first;
    };
    for (std::size_t j = 0; j < actor_joints.size(); ++j) {
        body.parents.push_back(actor_joints[j].parent);
        const bool finger = j >= 25;
        vec3<double> end = place(j) + (finger ? vec3<double>(actor_joints[j].position[0] > 0 ? 0.03 : -0.03, 0, 0)
                                       : j == smplx::head   ? vec3<double>(0, 0.2, 0)
                                       : j == 10 || j == 11 ? vec3<double>(0, 0, 0.1)
                                                            : vec3<double>(0, 0, 0.03));
        for (std::size_t k = j + 1; k < actor_joints.size(); ++k)
            if (actor_joints[k].parent == static_cast<int>(j) && (j != smplx::head)) {
                end = place(k);
                if (j == 0) end = place(smplx::spine1);
                break;
            }
        const double width = finger                                 ? 0.018
                             : j == smplx::head                     ? 0.17
                             : j == 0 || j == 3 || j == 6 || j == 9 ? 0.3
                                                                    : 0.09;
        const int first = add_box(j, place(j), end, width);
        body.J_regressor.push_back({{first, 0.25}, {first + 1, 0.25}, {first + 2, 0.25}, {first + 3, 0.25}});
    }
    body.shape_count = 1;
    for (const auto& v : body.v_template) body.shapedirs.push_back(v * 0.1);
    body.hands_mean_left.assign(15, {0, 0, -0.6});
    body.hands_mean_right.assign(15, {0, 0, 0.6});
    return body;
}

/// A dance that differs between left and right, and between forwards and backwards.
inline Motion dance(const BodyModel& body, std::size_t frames, std::uint64_t seed = 5) {
    Motion motion;
    motion.joint_count = body.joint_count();
    motion.betas = {0.8};
    test::Rng rng(seed);
    std::vector<vec3<double>> swing, phase;
    for (std::size_t j = 0; j < motion.joint_count; ++j) {
        const double most = j >= 25 ? 0.15 : j == 0 ? 0.1 : 0.45;
        swing.push_back(rng.vecs(1, -most, most)[0]);
        phase.push_back(rng.vecs(1, 0, 6)[0]);
    }
    for (std::size_t t = 0; t < frames; ++t) {
        const double time = 0.45 * static_cast<double>(t);
        for (std::size_t j = 0; j < motion.joint_count; ++j) {
            vec3<double> v(0);
            for (int axis = 0; axis < 3; ++axis) v[axis] = swing[j][axis] * std::sin(time + phase[j][axis]);
            if (j == 0) v.y += 0.5 * std::sin(0.7 * time) + 0.3;
            if (j == 16) v.z -= 0.9; // the left arm hangs
            if (j >= 25) v += j < 40 ? body.hands_mean_left[j - 25] : body.hands_mean_right[j - 40];
            motion.pose.push_back(v);
        }
        motion.transl.push_back({0.1 * std::sin(0.8 * time), 0.05 * std::sin(1.3 * time), 0.15 * std::cos(0.5 * time)});
        motion.timestamps.push_back(time);
    }
    return motion;
}

/// A correct capture, whose masks are the silhouettes of the posed bodies.
inline Capture film_boxes(const std::vector<CheckedPerson>& people, std::size_t cameras = 3, double distance = 3.3) {
    Capture capture;
    capture.name = "boxes";
    capture.motion = *people[0].motion;
    for (std::size_t c = 0; c < cameras; ++c) {
        const double angle = 0.3 + 2.2 * static_cast<double>(c);
        Camera<double> camera =
            look_at<double>({distance * std::sin(angle), 0.5 - 0.3 * double(c), distance * std::cos(angle)},
                            {0, -0.1, 0}, {0, 1, 0}, 0.75, photo_size, photo_size);
        camera.cx += 5 - 3.0 * double(c), camera.cy -= 4;
        capture.cameras.push_back({"cam0" + std::to_string(c), NamedCamera::Role::train, camera, {}});
    }
    for (const NamedCamera& named : capture.cameras)
        for (std::size_t t = 0; t < capture.frame_count(); ++t) {
            std::vector<Silhouette> bodies;
            for (const auto& [name, body, motion] : people) {
                const PosedBody posed = pose_body(*body, motion->pose_at(t), motion->transl[t], motion->betas);
                bodies.push_back(mesh_silhouette(posed.vertices, body->faces, named.camera));
            }
            const Silhouette seen = united(bodies);
            PixelImage image(4, photo_size, photo_size);
            for (std::size_t i = 0; i < seen.inside.size(); ++i)
                image.data[4 * i + 3] = static_cast<std::uint8_t>(255 * seen.inside[i]);
            capture.images.push_back(std::move(image));
        }
    return capture;
}

inline Capture film_boxes(const BodyModel& filmed, const Motion& motion, std::size_t cameras = 3) {
    return film_boxes({{"", &filmed, &motion}}, cameras);
}

struct Scene {
    BodyModel body = box_person();
    Capture capture = film_boxes(body, dance(body, 12));
};
inline const Scene& scene() {
    static const Scene instance;
    return instance;
}

template <class Who> // a body, or people
CaptureCheck check(const Capture& capture, const Who& who) {
    test::ChunksAlone executor; // the check needs no backend
    CaptureCheckParams params;
    params.search.views = 9; // enough here
    return check_capture(executor, capture, who, params);
}
inline CaptureCheck check(const Capture& capture) {
    return check(capture, scene().body);
}

inline std::string texts(const CaptureCheck& result) {
    std::string all;
    for (const auto& finding : result.findings) all += finding.text + "\n";
    return all;
}

/// A copy of the correct capture with a fault.
template <class Spoil>
Capture spoiled(const Spoil& spoil) {
    Capture capture = scene().capture;
    spoil(capture);
    return capture;
}
template <class Change>
Capture with_cameras(const Change& change) {
    return spoiled([&](Capture& capture) {
        for (std::size_t c = 0; c < capture.cameras.size(); ++c) change(capture.cameras[c].camera, c);
    });
}

inline void invert(PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        image.data[i] = static_cast<std::uint8_t>(255 - image.data[i]);
}
inline void mirror(PixelImage& image) {
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width / 2; ++x)
            std::swap_ranges(image.pixel(y, x), image.pixel(y, x) + 4, image.pixel(y, image.width - 1 - x));
}

// Usual mistakes in pose files. All motions here have the same skeleton at rest.
inline void exchange_sides(Motion& m, bool reflect) {
    const auto counterparts = joint_counterparts(scene().body);
    const auto given = m.pose;
    for (std::size_t t = 0; t < m.frame_count(); ++t)
        for (std::size_t j = 1; j < m.joint_count; ++j) {
            const vec3<double> v = given[t * m.joint_count + static_cast<std::size_t>(counterparts[j])];
            m.pose[t * m.joint_count + j] = reflect ? vec3<double>(v.x, -v.y, -v.z) : v;
        }
}
inline void write_degrees(Motion& m) {
    for (auto& v : m.pose) v *= 180 / std::numbers::pi;
}
inline void write_units(Motion& m, double per_metre) {
    for (auto& v : m.transl) v *= per_metre;
}
inline void displace(Motion& m, const vec3<double>& by) {
    for (auto& v : m.transl) v += by;
}
inline vec3<double> resting_root(const Motion& m) {
    return regress_joints(scene().body, shaped_vertices(scene().body, m.betas))[0];
}
inline void turn_z_up(Motion& m) {
    const mat3<double> turn(vec3<double>(1, 0, 0), vec3<double>(0, 0, 1), vec3<double>(0, -1, 0));
    const vec3<double> rest = resting_root(m);
    for (std::size_t t = 0; t < m.frame_count(); ++t) {
        vec3<double>& root = m.pose[t * m.joint_count];
        root = axis_angle_from_rotation(turn * rotation_from_axis_angle(root));
        m.transl[t] = turn * (m.transl[t] + rest) - rest;
    }
}
inline void add_mean_hands(Motion& m, double times) {
    for (std::size_t t = 0; t < m.frame_count(); ++t)
        for (std::size_t k = 0; k < 15; ++k) {
            m.pose[t * 55 + 25 + k] += scene().body.hands_mean_left[k] * times;
            m.pose[t * 55 + 40 + k] += scene().body.hands_mean_right[k] * times;
        }
}

} // namespace gsh::test::boxes
