// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <gsh/body/posed_body.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include "support/bodies.hpp"
#include "support/closed_mesh.hpp"

#include <algorithm>
#include <numbers>
#include <set>

using namespace gsh;

namespace {

const BodyModel& default_actor() {
    static const BodyModel body = make_actor();
    return body;
}
double weight(std::size_t v, int joint) {
    return default_actor().weights[v * actor_joint_count + static_cast<std::size_t>(joint)];
}
const vec3<double>& vertex(std::size_t v) {
    return default_actor().v_template[v];
}

Motion still() {
    Motion motion = actor_motion(ActorMotion::talk, 1);
    std::fill(motion.pose.begin(), motion.pose.end(), vec3<double>(0));
    std::fill(motion.expression.begin(), motion.expression.end(), 0.0);
    motion.transl[0] = vec3<double>(0);
    return motion;
}

} // namespace

TEST_CASE("the actor is a valid body model with SMPL-X's tree") {
    CHECK_NOTHROW(validate(default_actor(), "actor"));
    CHECK(default_actor().joint_count() == 55);
    CHECK(default_actor().vertex_count() >= 8000);
    CHECK(default_actor().vertex_count() <= 25000);
    const int parents[] = {-1, 0,  0,  0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  9,  9,  12, 13, 14, 16,
                           17, 18, 19, 15, 15, 15, 20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 20,
                           37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53};
    CHECK(std::equal(default_actor().parents.begin(), default_actor().parents.end(), std::begin(parents),
                     std::end(parents)));
    CHECK(default_actor().shape_count == 10);
    CHECK(default_actor().expression_count == 10);
    CHECK_THROWS_AS((void)make_actor({.edge_scale = 0.1}), ValueError);
}

TEST_CASE("its skin is one closed connected surface facing outward") {
    const auto& body = default_actor();
    CHECK(test::open_edges(body.faces) == 0);
    CHECK(test::euler_characteristic(body.vertex_count(), body.faces) == 2);
    CHECK(test::pieces(body.vertex_count(), body.faces, [](std::size_t) { return true; }) == 1);
    const double litres = 1000 * test::volume(body.v_template, body.faces);
    CHECK(litres > 50);
    CHECK(litres < 90);
    std::set<std::array<int, 3>> seen;
    for (auto f : body.faces) {
        const auto at = [&](std::size_t k) { return vertex(static_cast<std::size_t>(f[k])); };
        CHECK(length(cross(at(1) - at(0), at(2) - at(0))) > 1e-9);
        std::sort(f.begin(), f.end());
        CHECK(seen.insert(f).second);
    }
    for (std::size_t v = 0; v < body.vertex_count(); ++v) CHECK(std::abs(actor_distance(vertex(v))) < 2e-3);
}

TEST_CASE("a coarser mesh is closed, too") {
    const TriangleMesh mesh = actor_mesh(1.2);
    CHECK(test::open_edges(mesh.faces) == 0);
    CHECK(test::euler_characteristic(mesh.vertices.size(), mesh.faces) == 2);
}

TEST_CASE("it stands 1.7 m tall in T-pose, facing +z, its left at +x") {
    vec3<double> low(9), high(-9);
    for (const auto& p : default_actor().v_template) low = glm::min(low, p), high = glm::max(high, p);
    CHECK(high.y - low.y == doctest::Approx(1.71).epsilon(0.02));
    CHECK(low.y == doctest::Approx(ActorOutfit::sole_y).epsilon(0.01));
    CHECK(high.x - low.x == doctest::Approx(1.71).epsilon(0.02));
    const auto joints = regress_joints(default_actor(), default_actor().v_template);
    CHECK(length(joints[smplx::pelvis]) < 1e-9);
    CHECK(joints[smplx::left_wrist].x > 0.5);
    CHECK(joints[smplx::left_foot].z > joints[smplx::left_ankle].z);
}

TEST_CASE("the regressor gives the joints, from positive weights near each") {
    const auto joints = regress_joints(default_actor(), default_actor().v_template);
    for (int j = 0; j < actor_joint_count; ++j) {
        INFO(actor_joints[static_cast<std::size_t>(j)].name);
        CHECK(length(joints[static_cast<std::size_t>(j)] - actor_joint(j)) < 1e-9);
        double sum = 0;
        for (const auto& entry : default_actor().J_regressor[static_cast<std::size_t>(j)]) {
            CHECK(entry.weight > 0);
            CHECK(length(vertex(static_cast<std::size_t>(entry.vertex)) - actor_joint(j)) < 0.35);
            sum += entry.weight;
        }
        CHECK(sum == doctest::Approx(1).epsilon(1e-12));
    }
}

TEST_CASE("left and right joints mirror each other") {
    for (int j = 0; j < actor_joint_count; ++j) {
        const auto& left = actor_joints[static_cast<std::size_t>(j)];
        if (!left.name.starts_with("left_")) continue;
        const std::string twin = "right_" + std::string(left.name.substr(5));
        const auto right = std::find_if(actor_joints.begin(), actor_joints.end(),
                                        [&](const auto& joint) { return joint.name == twin; });
        REQUIRE(right != actor_joints.end());
        CHECK(right->position == std::array<double, 3>{-left.position[0], left.position[1], left.position[2]});
    }
}

TEST_CASE("skinning weights are few, sum to one, and never join distant limbs") {
    for (std::size_t v = 0; v < default_actor().vertex_count(); ++v) {
        std::vector<int> joints;
        double sum = 0;
        for (int j = 0; j < actor_joint_count; ++j)
            if (const double w = weight(v, j); w > 0) joints.push_back(j), sum += w;
        CHECK(sum == doctest::Approx(1).epsilon(1e-12));
        CHECK(joints.size() <= 6);
        for (const int a : joints)
            for (const int b :
                 joints) { // at most three bones apart, as spine and shoulder; small weights between fingers
                int steps = 0;
                for (int i = a, k = b; i != k; ++steps)
                    (i > k ? i : k) = actor_joints[static_cast<std::size_t>(std::max(i, k))].parent;
                CHECK((steps <= 3 ||
                       (steps == 4 && a >= smplx::left_index1 && std::min(weight(v, a), weight(v, b)) < 0.05)));
                const bool arm_a =
                    a >= smplx::left_shoulder && a != smplx::jaw && a != smplx::left_eye && a != smplx::right_eye;
                const bool leg_b = b == 1 || b == 2 || (b >= 4 && b <= 11 && b != smplx::spine2 && b != smplx::spine3);
                CHECK_FALSE((arm_a && leg_b));
            }
        if (std::abs(vertex(v).x) > 0.026) // vertices on the left have no weight of a limb on the right
            for (const int j : joints) CHECK(actor_joints[static_cast<std::size_t>(j)].position[0] * vertex(v).x >= 0);
    }
}

TEST_CASE("weights are smooth: neighbours differ little, but for lips and lids") {
    double roughest = 0;
    for (const auto& f : default_actor().faces)
        for (std::size_t k = 0; k < 3; ++k) {
            const auto a = static_cast<std::size_t>(f[k]), b = static_cast<std::size_t>(f[(k + 1) % 3]);
            const vec3<double> p = (vertex(a) + vertex(b)) * 0.5;
            if (p.z > 0.08 && p.y > 0.55) continue;
            double change = 0;
            for (int j = 0; j < actor_joint_count; ++j) change += 0.5 * std::abs(weight(a, j) - weight(b, j));
            roughest = std::max(roughest, change);
        }
    CHECK(roughest < 0.85); // the skin between fingers
}

TEST_CASE("each hand has five separate fingers") {
    for (const int first : {int(smplx::left_index1), int(smplx::right_index1)}) {
        // Cut every finger half-way along its middle bone. The part beyond the cuts consists of five pieces.
        const auto beyond_cut = [&](std::size_t v) {
            for (int finger = 0; finger < 5; ++finger) {
                const int joint = first + 3 * finger + 1;
                if (weight(v, joint) + weight(v, joint + 1) > 0.5) return true;
            }
            return false;
        };
        CHECK(test::pieces(default_actor().vertex_count(), default_actor().faces, beyond_cut) == 5);
        // There is a gap between neighbouring fingers.
        for (int finger = 0; finger < 3; ++finger) {
            const int neighbours[] = {0, 1, 3, 2}; // from the index to the pinky
            const auto middle = [&](int f) {
                return (actor_joint(first + 3 * f + 1) + actor_joint(first + 3 * f + 2)) * 0.5;
            };
            CHECK(actor_distance((middle(neighbours[finger]) + middle(neighbours[finger + 1])) * 0.5) > 0.002);
        }
    }
}

TEST_CASE("region lists name the hands and the face") {
    for (const int v : default_actor().left_hand_vertices) CHECK(vertex(static_cast<std::size_t>(v)).x > 0.64);
    for (const int v : default_actor().right_hand_vertices) CHECK(vertex(static_cast<std::size_t>(v)).x < -0.64);
    for (const int v : default_actor().face_vertices) CHECK(vertex(static_cast<std::size_t>(v)).z > 0.02);
    CHECK(default_actor().left_hand_vertices.size() > 1000);
    CHECK(default_actor().face_vertices.size() > 1500);
}

TEST_CASE("expressions move the face and nothing else, each in its own way") {
    const std::set<int> face(default_actor().face_vertices.begin(), default_actor().face_vertices.end());
    std::vector<double> largest(10, 0);
    for (std::size_t v = 0; v < default_actor().vertex_count(); ++v)
        for (std::size_t k = 0; k < 10; ++k) {
            const double moved = length(default_actor().exprdirs[v * 10 + k]);
            if (moved > 0) CHECK(face.count(static_cast<int>(v)) == 1);
            largest[k] = std::max(largest[k], moved);
        }
    for (const double d : largest) {
        CHECK(d > 0.002);
        CHECK(d < 0.02);
    }
    // smile lifts the corners, brows_up the brows, mouth_open lowers the lower lip only
    const auto at = [](const vec3<double>& p, std::size_t k) { return actor_expression_directions(p)[k]; };
    CHECK(at({0.023, 0.6045, 0.1225}, 0).y > 0.005);
    CHECK(at({-0.023, 0.6045, 0.1225}, 0).x < -0.005);
    CHECK(at({0.028, 0.690, 0.120}, 4).y > 0.005);
    CHECK(at({0, 0.600, 0.138}, 1).y < -0.006);
    CHECK(at({0, 0.612, 0.138}, 1).y > 0);
}

TEST_CASE("a blink covers the eye") {
    Motion motion = still();
    motion.expression[6] = 1;
    const auto closed = test::posed_vertices(default_actor(), motion, 0);
    const vec3<double> eye = actor_joint(smplx::left_eye);
    double lowest = 1; // of the upper lid's edge, in the middle
    for (std::size_t v = 0; v < closed.size(); ++v) {
        const vec3<double> p = vertex(v) - eye;
        if (p.z > 0 && std::abs(p.x) < 0.003 && p.y > 0.004 && p.y < 0.008 && length(p) > 0.0147)
            lowest = std::min(lowest, closed[v].y - eye.y);
    }
    CHECK(lowest < -0.002);
}

TEST_CASE("the zero pose is the template; jaw, finger and knee move what they should") {
    Motion motion = still();
    const auto rest = test::posed_vertices(default_actor(), motion, 0);
    for (std::size_t v = 0; v < rest.size(); ++v) CHECK(length(rest[v] - vertex(v)) < 1e-9);

    motion.pose[smplx::jaw] = {0.3, 0, 0};
    motion.pose[smplx::left_middle1] = {0, 0, -1};
    motion.pose[smplx::left_knee] = {0.8, 0, 0};
    const auto moved = test::posed_vertices(default_actor(), motion, 0);
    for (std::size_t v = 0; v < rest.size(); ++v) {
        const vec3<double> move = moved[v] - rest[v], p = vertex(v);
        if (weight(v, smplx::jaw) > 0.9) CHECK(move.y < -0.001);
        if (weight(v, smplx::left_middle1 + 1) > 0.9) CHECK(move.y < -0.01); // curls down
        if (weight(v, smplx::left_ankle) > 0.9) CHECK(move.z < -0.2);        // heel goes back
        if (p.y > 0 && p.y < 0.5 && p.x < 0.6) CHECK(length(move) == 0);     // the rest stays
    }
}

TEST_CASE("motions loop, stay on the floor, and move what they promise") {
    for (const auto kind : {ActorMotion::talk, ActorMotion::stride, ActorMotion::reach}) {
        const Motion motion = actor_motion(kind, 12);
        CHECK(motion.frame_count() == 12);
        CHECK(motion.timestamps[11] == doctest::Approx(1.1));
        for (const int joint : {int(smplx::left_shoulder), int(smplx::left_elbow), int(smplx::left_elbow) + 1,
                                int(smplx::left_index1), int(smplx::right_index1) + 12, int(smplx::jaw),
                                int(smplx::head), int(smplx::spine2), int(smplx::left_knee)}) {
            double span = 0;
            for (std::size_t t = 1; t < 12; ++t)
                span = std::max(span, length(motion.pose_at(t)[static_cast<std::size_t>(joint)] -
                                             motion.pose_at(0)[static_cast<std::size_t>(joint)]));
            const bool pointing = kind == ActorMotion::stride && joint >= smplx::right_index1;
            if (!pointing) CHECK(span > 0.1);
        }
        double step = 0, around = 0;
        for (std::size_t j = 0; j < 55; ++j) {
            around = std::max(around, length(motion.pose_at(11)[j] - motion.pose_at(0)[j]));
            for (std::size_t t = 1; t < 12; ++t)
                step = std::max(step, length(motion.pose_at(t)[j] - motion.pose_at(t - 1)[j]));
        }
        CHECK(around <= 1.2 * step); // the step from the last frame to the first is not larger than the others
        for (std::size_t t = 0; t < 12; t += 3) {
            double lowest = 9;
            for (const auto& p : test::posed_vertices(default_actor(), motion, t)) lowest = std::min(lowest, p.y);
            CHECK(std::abs(lowest - ActorOutfit::sole_y) < 0.03);
        }
    }
    const Motion reach = actor_motion(ActorMotion::reach, 24);
    for (const int joint : {int(smplx::left_elbow), int(smplx::left_elbow) + 1, int(smplx::left_knee),
                            int(smplx::left_knee) + 1}) {
        double bend = 0;
        for (std::size_t t = 0; t < 24; ++t)
            bend = std::max(bend, length(reach.pose_at(t)[static_cast<std::size_t>(joint)]));
        CHECK(bend == doctest::Approx(120 * std::numbers::pi / 180).epsilon(0.01));
    }
    CHECK_THROWS_AS((void)actor_motion(ActorMotion::talk, 0), ValueError);
    CHECK_THROWS_AS((void)actor_motion(ActorMotion::talk, 3, 0), ValueError);
}
