// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/gala_basketball.hpp>

#include "io/sample_files.hpp"

#include "support/gradient.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/vertex_samples.hpp>
#include <gsh/io/body_file.hpp>

#include <functional>
#include <sstream>
#include <string>
#include <vector>

using namespace gsh;

namespace {

using Matrix = std::array<std::array<double, 4>, 4>;

Matrix times(const Matrix& a, const Matrix& b) {
    Matrix c{};
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 4; ++j)
            for (std::size_t k = 0; k < 4; ++k) c[i][j] += a[i][k] * b[k][j];
    return c;
}
Matrix rigid(const mat3<double>& R, const vec3<double>& t) {
    Matrix m{};
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) m[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = R[j][i];
        m[static_cast<std::size_t>(i)][3] = t[i];
    }
    m[3][3] = 1;
    return m;
}
vec3<double> transformed(const Matrix& m, const vec3<double>& x) {
    vec3<double> y;
    for (std::size_t i = 0; i < 3; ++i)
        y[static_cast<int>(i)] = m[i][0] * x.x + m[i][1] * x.y + m[i][2] * x.z + m[i][3];
    return y;
}
/// Ry Rx Rz by its entries, angles in degrees.
mat3<double> unity_rotation(const vec3<double>& degrees) {
    const auto turn = [&](int axis, double d) {
        vec3<double> v(0);
        v[axis] = d * std::numbers::pi / 180;
        return rotation_from_axis_angle(v);
    };
    return turn(1, degrees.y) * turn(0, degrees.x) * turn(2, degrees.z);
}

/// The data set in small, in numbers as its files hold them: left-handed, y up. What its other reader computes from
/// them, matrix by matrix, is what ours must give.
struct Gala {
    test::Temporary folder;
    std::filesystem::path model = folder / "Gala/model", scene = folder / "Gala/small";
    cpu::Serial serial;
    std::vector<int> parents;
    std::vector<vec3<double>> vertices, local; // local: joints in their parents' frames
    std::vector<Matrix> bind;                  // joint_from_world
    std::vector<double> weights;               // [V, J]
    static constexpr std::size_t J = 27, V = 60;
    static constexpr int cameras = 3, frames = 4, people = 2;
    std::vector<vec3<double>> degrees, roots; // [frames, people, J], [frames, people]
    vec3<double> eye{0.4, 1.2, -4.5};
    vec3<double> gaze{3, -5, 0}; // degrees

    Gala() {
        test::Rng rng(21);
        for (const char* name : {"camera", "bg", "pose", "0", "1", "6"})
            std::filesystem::create_directories(scene / name);
        std::filesystem::create_directories(model);
        std::vector<Matrix> world;
        std::vector<vec3<double>> joints;
        std::string parent_text, tpose, matrices;
        for (std::size_t j = 0; j < J; ++j) {
            parents.push_back(j == 0 ? -1 : static_cast<int>((j - 1) / 2));
            const mat3<double> Q = j == 0 ? mat3<double>(1.0) : unity_rotation(rng.vec(-60, 60));
            local.push_back(j == 0 ? vec3<double>(0.02, 0.9, 0.01) : rng.vec(-0.15, 0.15));
            const Matrix here = rigid(Q, local.back());
            world.push_back(j == 0 ? here : times(world[static_cast<std::size_t>(parents[j])], here));
            joints.push_back({world[j][0][3], world[j][1][3], world[j][2][3]});
            mat3<double> R;
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c)
                    R[c][r] = world[j][static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
            bind.push_back(rigid(transpose(R), -(transpose(R) * joints[j])));
            parent_text += std::to_string(parents[j]) + "\n";
            tpose += text(local.back()) + "\n0,0,0\n1,1,1\n";
            for (const auto& row : bind[j])
                matrices += number(row[0]) + "," + number(row[1]) + "," + number(row[2]) + "," + number(row[3]) + "\n";
        }
        std::string mesh;
        weights.assign(V * J, 0);
        for (std::size_t v = 0; v < V; ++v) {
            vertices.push_back(joints[v % J] + rng.vec(-0.1, 0.1));
            const std::size_t a = v % J, b = (v + 5) % J;
            weights[v * J + a] = 0.75, weights[v * J + b] = 0.25;
            mesh += text(vertices[v]) + "\n0,0,1\n0.5,0.25\n0.75,0.25,0,0\n" + std::to_string(a) + "," +
                    std::to_string(b) + ",0,0\n";
        }
        test::write_text(model / "jointParent.txt", parent_text);
        test::write_text(model / "tpose.txt", tpose);
        test::write_text(model / "tpose_mat.txt", matrices);
        test::write_text(model / "mesh.txt", mesh);
        test::write_array<float>(model / "weights.npy", std::vector<float>(weights.begin(), weights.end()), {V, J});

        const quat<double> q = quat_from_rotation(unity_rotation(gaze));
        for (const char* id : {"0", "1", "6"}) {
            test::write_text(scene / "camera" / (std::string(id) + ".txt"),
                             "40,32,24\n" + text(eye) + "\n" + number(q.x) + "," + number(q.y) + "," + number(q.z) +
                                 "," + number(q.w) + "\n1,1,1\n");
            write_png(scene / "bg" / (std::string(id) + ".png"), test::numbered_image(32, 24, id[0] - '0', 200));
        }
        for (int f = 0; f < frames; ++f) {
            std::string pose;
            for (int p = 0; p < people; ++p) {
                roots.push_back(vec3<double>(p, 0.9, 0) + rng.vec(-0.1, 0.1));
                for (std::size_t j = 0; j < J; ++j) {
                    degrees.push_back(rng.vec(-50, 50));
                    pose += text(j == 0 ? roots.back() : rng.vec()) + "\n" + text(degrees.back()) + "\n1,1,1\n";
                }
            }
            test::write_text(scene / "pose" / (test::padded(f) + ".txt"), pose);
            for (const char* id : {"0", "1", "6"}) {
                write_png(photo(id, f), test::numbered_image(32, 24, id[0] - '0', f));
                if (id[0] == '6') write_png(scene / id / (test::padded(f) + "_mask.png"), PixelImage(1, 24, 32));
            }
        }
    }
    static std::string number(double x) {
        std::ostringstream out;
        out.precision(17);
        out << x;
        return out.str();
    }
    static std::string text(const vec3<double>& v) { return number(v.x) + "," + number(v.y) + "," + number(v.z); }
    [[nodiscard]] std::filesystem::path photo(const std::string& id, int f) const {
        return scene / id / (test::padded(f) + ".png");
    }

    /// Posed vertices in the files' frame.
    [[nodiscard]] std::vector<vec3<double>> posed(int frame, int person) const {
        const std::size_t at = static_cast<std::size_t>(frame * people + person);
        std::vector<Matrix> world, skin;
        for (std::size_t j = 0; j < J; ++j) {
            const Matrix here = rigid(unity_rotation(degrees[at * J + j]), j == 0 ? roots[at] : local[j]);
            world.push_back(j == 0 ? here : times(world[static_cast<std::size_t>(parents[j])], here));
            skin.push_back(times(world[j], bind[j]));
        }
        std::vector<vec3<double>> result(V, vec3<double>(0));
        for (std::size_t v = 0; v < V; ++v)
            for (std::size_t j = 0; j < J; ++j) result[v] += transformed(skin[j], vertices[v]) * weights[v * J + j];
        return result;
    }
    /// Where the files' camera sees a point: x right, y up, z forward.
    [[nodiscard]] vec2<double> pixel(const vec3<double>& x) const {
        const vec3<double> p = transpose(unity_rotation(gaze)) * (x - eye);
        const double f = 12 / std::tan(20 * std::numbers::pi / 180);
        return {16 + f * p.x / p.z, 12 - f * p.y / p.z};
    }
};

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
    for (const std::string& w : warnings) CHECK(w.find("differ") == std::string::npos);
    CHECK(loaded.rig.normals[0] == vec3<double>(0, 0, 1));
    CHECK(sample_vertices(body, body.v_template, loaded.rig.normals).size() == V);
    save_body_model(folder / "gala.npz", body); // a body without triangles is one
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

    // Unseen times for the test camera alone: what is not needed is not taken.
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
    CHECK_THROWS_AS(save_capture(folder / "copy", block.capture), ValueError);
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
        fails({"small/1", "frame 2 is missing"});
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
