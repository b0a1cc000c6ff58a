// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/gala_basketball.hpp>

#include "io/gala_files.hpp"
#include "io/sample_files.hpp"

#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/vertex_samples.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/input_file.hpp>

#include <functional>
#include <string>
#include <vector>

using namespace gsh;
using test::Gala;

namespace {

std::vector<vec3<double>> skinned(const BodyModel& body, const Motion& motion, std::size_t frame) {
    std::vector<mat3<double>> rotations;
    for (const auto& v : motion.pose_at(frame)) rotations.push_back(rotation_from_axis_angle(v));
    std::vector<Affine<double>> bones(body.joint_count());
    bone_transforms<double>(body.parents, rotations, regress_joints(body, body.v_template), motion.transl[frame],
                            bones);
    std::vector<vec3<double>> result(body.vertex_count(), vec3<double>(0));
    for (std::size_t v = 0; v < result.size(); ++v)
        for (std::size_t j = 0; j < bones.size(); ++j)
            result[v] += bones[j](body.v_template[v]) * body.weights[v * bones.size() + j];
    return result;
}

} // namespace

TEST_CASE_FIXTURE(Gala, "posed vertices and pixels are those of the data set's own matrices") {
    std::vector<std::string> warnings;
    const GalaScene loaded = load_gala_scene(serial, scene, {}, &warnings);
    const BodyModel& body = loaded.rig.body;
    REQUIRE(body.joint_count() == J);
    REQUIRE(body.vertex_count() == V);
    CHECK(body.parents == parents);
    REQUIRE(loaded.people.size() == 2);
    for (int person = 0; person < people; ++person)
        for (const int frame : {0, 3}) {
            const auto ours =
                skinned(body, loaded.people[static_cast<std::size_t>(person)], static_cast<std::size_t>(frame));
            const auto theirs = posed(frame, person);
            for (std::size_t v = 0; v < V; ++v) {
                CHECK(length(ours[v] - vec3<double>(-theirs[v].x, theirs[v].y, theirs[v].z)) <
                      1e-6); // weights are float
                const Camera<double>& camera = loaded.capture.cameras[1].camera;
                const vec2<double> at = to_pixel(camera, to_camera(camera, ours[v])), expected = pixel(theirs[v]);
                CHECK(std::abs(at.x - expected.x) + std::abs(at.y - expected.y) < 1e-4);
            }
        }
    for (const std::string& w : warnings) CHECK(w != test::contains("differ"));
    CHECK(loaded.rig.normals[0] == vec3<double>(0, 0, 1));
    CHECK(sample_vertices(body, body.v_template, loaded.rig.normals).size() == V);
    save_body_model(folder / "gala.npz", body); // a body may have no triangles
    CHECK(load_body_model(folder / "gala.npz").faces.empty());
}

TEST_CASE_FIXTURE(Gala, "a scene: plates, photographs used whole, the test camera, frames by the scene's name") {
    CaptureOptions every_second;
    every_second.train_frames = FrameRange{0, 2, 2}, every_second.test_frames = FrameRange{0, 2, 2};
    const Capture idle = load_gala_scene(serial, scene, every_second).capture;
    REQUIRE(idle.cameras.size() == 3);
    CHECK(idle.cameras[2].name == "6");
    CHECK(idle.cameras[2].role == NamedCamera::Role::test);
    CHECK(idle.motion.timestamps[1] == doctest::Approx(2 / 30.0));
    CHECK(idle.frame_count() == 2);
    CHECK(idle.views(false).size() == 4);
    CHECK(int(idle.image({1, 1}).pixel(3, 4)[2]) == 52);
    CHECK(int(idle.image({2, 1}).pixel(3, 4)[3]) == 255);
    REQUIRE(idle.backgrounds.size() == 3);
    CHECK(int(idle.background(1)->pixel(3, 4)[2]) == 250);

    // Only the test camera has times that training does not use. Images that are not needed are not read.
    std::filesystem::remove(photo("0", 1));
    CaptureOptions options;
    options.train_frames = FrameRange{0, 2, 2};
    options.test_frames = FrameRange{0, 3, 1};
    options.person = 1;
    options.downscale = 2;
    cpu::Threads threads(3);
    const GalaScene block = load_gala_scene(threads, scene, options);
    CHECK(block.capture.frame_count() == 4);
    CHECK(block.capture.views(false).size() == 4);
    CHECK(block.capture.views(true).size() == 4);
    CHECK(!block.capture.is_taken({0, 1}));
    CHECK(block.capture.is_taken({2, 1}));
    CHECK(block.capture.images[0].width == 16);
    CHECK(block.capture.cameras[0].camera.cx == 8);
    CHECK(block.capture.backgrounds[0].width == 16);
    CHECK(block.capture.motion.transl == block.people[1].transl);
    save_capture(folder / "copy", block.capture); // what was not taken becomes transparent
    const PixelImage nothing = read_image(folder / "copy/images" / block.capture.cameras[0].name / "0001.png");
    CHECK(std::all_of(nothing.data.begin(), nothing.data.end(), [](std::uint8_t byte) { return byte == 0; }));
    CaptureOptions other = options; // another motion of person 1
    other.poses = "other.npz";
    save_motion(scene / "other.npz", block.people[0]);
    const GalaScene moved = load_gala_scene(serial, scene, other);
    CHECK(moved.capture.motion.pose == block.people[0].pose);
    CHECK(moved.people[1].transl == block.people[0].transl);
    other.train_frames = other.test_frames = FrameRange{0, 2, 2};
    test::check_throws<ShapeError>([&] { (void)load_gala_scene(serial, scene, other); }, {"other.npz", "4", "2"});
    options.test_cameras = {"1"};
    options.train_frames = FrameRange{0, 2, 2}, options.test_frames = FrameRange{2, 3, 1};
    CHECK(load_gala_scene(serial, scene, options).capture.cameras[1].role == NamedCamera::Role::test);
}

TEST_CASE("the published scenes' frames") {
    using detail::known_gala_split;
    const auto count = [](const FrameRange& r) { return (r.last - r.first) / r.step + 1; };
    const std::tuple<const char*, int, int> scenes[] = {{"idle", 50, 50},  {"turn", 50, 50},  {"dribble", 30, 30},
                                                        {"shot", 40, 40},  {"block", 40, 80}, {"boxout", 71, 142},
                                                        {"match", 42, 250}};
    for (const auto& [name, train, test] : scenes) {
        CHECK(count(*known_gala_split(name).train) == train);
        CHECK(count(*known_gala_split(name).test) == test);
    }
    CHECK(!known_gala_split("small").train);
}

TEST_CASE_FIXTURE(Gala, "without weights.npy those of the mesh count") {
    const BodyModel dense = load_gala_rig(model).body;
    std::filesystem::remove(model / "weights.npy");
    const BodyModel sparse = load_gala_rig(model).body;
    for (std::size_t i = 0; i < dense.weights.size(); ++i)
        CHECK(sparse.weights[i] == doctest::Approx(dense.weights[i]));
    const auto joints = regress_joints(dense, dense.v_template);
    CHECK(length(joints[0] - vec3<double>(-0.02, 0.9, 0.01)) < 1e-9);
}

TEST_CASE_FIXTURE(Gala, "files that are wrong") {
    const auto expect = [&](const std::filesystem::path& file, const std::function<void(std::string&)>& change,
                            std::initializer_list<std::string_view> words) {
        const std::string kept = read_file(file);
        std::string spoilt = kept;
        change(spoilt);
        test::write_text(file, spoilt);
        test::check_throws<Error>([&] { (void)load_gala_scene(serial, scene); }, {file.filename().string()});
        test::check_throws<Error>([&] { (void)load_gala_scene(serial, scene); }, words);
        test::write_text(file, kept);
    };
    const auto first_line = [](const char* line) {
        return [line](std::string& s) { s.replace(0, s.find('\n'), line); };
    };
    expect(model / "mesh.txt", first_line("1,2"), {"mesh.txt:1", "2 numbers, expected 3", "position"});
    expect(model / "mesh.txt", first_line("1,2,x"), {"mesh.txt:1", "'x'"});
    expect(model / "mesh.txt", first_line("1,2,nan"), {"mesh.txt:1", "finite"});
    expect(model / "mesh.txt", [](std::string& s) { s += "1,2,3\n"; }, {"301 lines", "five a vertex"});
    expect(model / "mesh.txt", [](std::string& s) { s = "\n \n"; }, {"holds no numbers"});
    expect(model / "jointParent.txt", first_line("3"), {"jointParent.txt"});
    expect(model / "jointParent.txt", [](std::string& s) { s += "99\n"; }, {"holds 99"});
    expect(model / "tpose.txt", [](std::string& s) { s += "0,0,0\n"; }, {"82 lines, expected 81"});
    expect(model / "tpose_mat.txt", first_line("2,0,0,0"), {"joint 0 is not rigid"});
    expect(model / "tpose_mat.txt", [](std::string& s) { s += "0\n"; }, {"433 numbers, expected 432"});
    expect(scene / "camera/1.txt", first_line("40,32"), {"1.txt:1", "2 numbers", "field of view"});
    expect(scene / "camera/1.txt", first_line("190,32,24"), {"190", "degrees"});
    expect(scene / "camera/1.txt", [](std::string& t) { t.replace(t.find("1,1,1"), 5, "1,2,1"); }, {"scale differs"});
}

TEST_CASE_FIXTURE(Gala, "many joints times many vertices do not exhaust memory") {
    const int joints = 2000, points = 20000; // a table of 320 MB for 2 MB of text
    std::string parents, tpose, matrices, mesh;
    for (int j = 0; j < joints; ++j) {
        parents += std::to_string(j - 1) + "\n", tpose += "0,0,0\n0,0,0\n1,1,1\n";
        matrices += "1,0,0,0\n0,1,0,0\n0,0,1,0\n0,0,0,1\n";
    }
    for (int v = 0; v < points; ++v) mesh += "0,0,0\n0,0,1\n0,0\n1\n0\n";
    test::write_text(model / "jointParent.txt", parents), test::write_text(model / "tpose.txt", tpose);
    test::write_text(model / "tpose_mat.txt", matrices), test::write_text(model / "mesh.txt", mesh);
    test::check_throws<IoError>([&] { (void)load_gala_rig(model); }, {"mesh.txt: the table of weights", "320000000"});
}

TEST_CASE_FIXTURE(Gala, "files that are missing or do not belong together") {
    const auto fails = [&](std::initializer_list<std::string_view> words, const CaptureOptions& options = {}) {
        test::check_throws<Error>([&] { (void)load_gala_scene(serial, scene, options); }, words);
    };
    SUBCASE("no rig") {
        std::filesystem::remove_all(model);
        fails({"model/mesh.txt", "missing"});
    }
    SUBCASE("weights of another mesh") {
        test::write_array<float>(model / "weights.npy", std::vector<float>(J, 1.0f), {1, J});
        fails({"weights.npy", "(1, 27)", "(60, 27)"});
    }
    SUBCASE("weights that sum to 2") {
        test::write_array<float>(model / "weights.npy", std::vector<float>(V * J, 2.0f / J), {V, J});
        fails({"weights.npy", "vertex 0", "sum"});
    }
    SUBCASE("a pose is missing") {
        std::filesystem::remove(scene / "pose/0002.txt");
        CaptureOptions options;
        options.train_frames = options.test_frames = FrameRange{0, 3, 1};
        fails({"pose", "frame 2 is missing"}, options);
    }
    SUBCASE("a pose of fewer people") {
        std::string text = read_file(scene / "pose/0002.txt");
        std::size_t at = 0;
        for (std::size_t line = 0; line < 3 * J; ++line) at = text.find('\n', at) + 1;
        test::write_text(scene / "pose/0002.txt", text.substr(0, at));
        fails({"0002.txt", "1 people, expected 2"});
    }
    SUBCASE("a pose that ends early") {
        std::string text = read_file(scene / "pose/0002.txt");
        test::write_text(scene / "pose/0002.txt", text.substr(0, text.rfind("1,1,1")));
        fails({"0002.txt", "161 lines", "81"});
    }
    SUBCASE("a photograph is missing") {
        std::filesystem::remove(photo("1", 2));
        std::vector<std::string> warnings;
        const Capture read = load_gala_scene(serial, scene, {}, &warnings).capture;
        CHECK(!read.is_taken({1, 2}));
        CHECK(read.is_taken({1, 1}));
        CHECK(std::count(warnings.begin(), warnings.end(),
                         scene.string() + ": 1 photographs are missing and are left out: camera '1' frame 2") == 1);
    }
    SUBCASE("a plate is missing") {
        std::filesystem::remove(scene / "bg/1.png");
        fails({"bg/1.png"});
    }
    SUBCASE("a plate of another size") {
        write_png(scene / "bg/1.png", PixelImage(3, 32, 24));
        fails({"bg/1.png", "24 x 32"});
    }
    SUBCASE("a camera of another size") {
        std::string text = read_file(scene / "camera/1.txt");
        test::write_text(scene / "camera/1.txt", text.replace(0, 8, "40,31,24"));
        fails({"1.png", "32 x 24", "31 x 24"});
    }
    SUBCASE("no such person") {
        CaptureOptions options;
        options.person = 2;
        fails({"person 2", "2"}, options);
    }
    SUBCASE("no such camera") {
        CaptureOptions options;
        options.test_cameras = {"9"};
        fails({"camera '9'"}, options);
    }
}
