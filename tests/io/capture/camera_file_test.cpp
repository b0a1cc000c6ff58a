// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/camera_file.hpp>

#include "io/temporary.hpp"

#include <string>

using namespace gsh;

namespace {

/// A valid entry as text. Tests replace parts of it.
std::string entry(const std::string& from = "", const std::string& to = "") {
    std::string text = R"({"name": "cam00", "role": "train", "width": 540, "height": 480,
        "K": [[770.0, 0, 266.5], [0, 771.0, 273.75], [0, 0, 1]],
        "R": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "t": [0.1, 0.2, 3.0]})";
    if (!from.empty()) {
        const std::size_t place = text.find(from);
        REQUIRE(place != std::string::npos);
        text.replace(place, from.size(), to);
    }
    return text;
}

} // namespace

TEST_CASE("a camera entry is read as it stands") {
    const test::Temporary folder;
    write_file(folder / "camera.json", entry());
    const NamedCamera read = read_camera(folder / "camera.json");
    CHECK(read.name == "cam00");
    CHECK(read.role == NamedCamera::Role::train);
    CHECK(read.camera.width == 540);
    CHECK(read.camera.height == 480);
    CHECK(read.camera.fx == 770.0);
    CHECK(read.camera.fy == 771.0);
    CHECK(read.camera.cx == 266.5);
    CHECK(read.camera.cy == 273.75);
    CHECK(read.camera.t.z == 3.0);
    const vec3<double> turned = read.camera.R * vec3<double>(1, 0, 0); // row-major in the file
    CHECK(turned.x == 0);
    CHECK(turned.y == 1);
    CHECK(!read.distortion);
    write_file(folder / "flat.json",
               entry("[[770.0, 0, 266.5], [0, 771.0, 273.75], [0, 0, 1]]",
                     "[770, 0, 266.5, 0, 771, 273.75, 0, 0, 1], \"distortion\": [0.1, 0, 0, 0, 0]"));
    CHECK(read_camera(folder / "flat.json").camera.fy == 771.0);
    CHECK(read_camera(folder / "flat.json").distortion->k1 == 0.1);
    write_file(folder / "zero.json", entry("\"t\"", "\"distortion\": [0, 0, 0, 0, 0], \"t\""));
    CHECK(!read_camera(folder / "zero.json").distortion);
}

TEST_CASE("lists come back as they were written") {
    const test::Temporary folder;
    CameraList list;
    for (int i = 0; i < 3; ++i) {
        NamedCamera camera;
        camera.name = "cam" + std::to_string(i);
        camera.role = i == 2 ? NamedCamera::Role::test : NamedCamera::Role::train;
        const double c = std::cos(0.3 * i), s = std::sin(0.3 * i);
        camera.camera = {mat3<double>(c, s, 0, -s, c, 0, 0, 0, 1),
                         {0.1 * i, 1.0 / 3, 3},
                         700.0 + i,
                         710.0,
                         320.25,
                         240.125,
                         640,
                         480};
        if (i == 1) camera.distortion = Distortion<double>{-0.1, 0.02, 0.001, -0.002, 0.003};
        list.cameras.push_back(camera);
    }
    list.fps = 12.5;
    list.floor_y = -0.95;
    list.test_frames = {1, 4};
    write_cameras(folder / "cameras.json", list);
    const CameraList read = read_cameras(folder / "cameras.json");
    REQUIRE(read.cameras.size() == 3);
    for (std::size_t i = 0; i < 3; ++i) {
        CHECK(read.cameras[i].name == list.cameras[i].name);
        CHECK(read.cameras[i].role == list.cameras[i].role);
        CHECK(read.cameras[i].camera.R == list.cameras[i].camera.R);
        CHECK(read.cameras[i].camera.t == list.cameras[i].camera.t);
        CHECK(read.cameras[i].camera.cx == 320.25);
        CHECK(read.cameras[i].distortion.has_value() == (i == 1));
    }
    CHECK(read.cameras[1].distortion->p2 == -0.002);
    CHECK(read.fps == 12.5);
    CHECK(read.floor_y == -0.95);
    CHECK(read.test_frames == std::vector<int>{1, 4});

    CHECK(read_camera(folder / "cameras.json", "cam2").camera.fx == 702.0);
    test::check_throws<IoError>([&] { (void)read_camera(folder / "cameras.json"); }, {"3 cameras", "cam0, cam1, cam2"});
    test::check_throws<IoError>([&] { (void)read_camera(folder / "cameras.json", "cam9"); }, {"cam9", "cam0"});

    write_camera(folder / "one.json", list.cameras[1]);
    CHECK(read_camera(folder / "one.json").camera.R == list.cameras[1].camera.R);
    test::check_throws<IoError>([&] { (void)read_camera(folder / "one.json", "cam9"); }, {"cam9", "cam1"});
    write_file(folder / "bare.json", "[" + entry() + "]");
    CHECK(read_cameras(folder / "bare.json").cameras.size() == 1);
    CHECK(read_camera(folder / "bare.json").name == "cam00");
}

TEST_CASE("bad entries name the file, the camera and the field") {
    const test::Temporary folder;
    const auto path = folder / "cameras.json";
    const auto expect = [&](const std::string& from, const std::string& to,
                            std::initializer_list<std::string_view> words) {
        write_file(path, "{\"cameras\": [" + entry(from, to) + "]}");
        INFO(from << " -> " << to);
        test::check_throws<Error>([&] { (void)read_cameras(path); }, {path.string(), "cameras[0]"});
        test::check_throws<Error>([&] { (void)read_cameras(path); }, words);
    };
    expect("\"K\"", "\"k\"", {"cam00", "K is missing"});
    expect("\"t\"", "\"T\"", {"cam00", "t is missing"});
    expect("\"width\"", "\"w\"", {"width is missing"});
    expect("\"name\": \"cam00\",", "", {"name is missing"});
    expect("\"name\"", "\"title\"", {"unknown field 'title'", "name, role, width"});
    expect("cam00", "../cam00", {"name", "folder"});
    expect("\"train\"", "\"training\"", {"role", "training"});
    expect("540", "0", {"width x height", "0 x 480"});
    expect("540", "540.5", {"width", "integer"});
    expect("540", "\"wide\"", {"width", "string"});
    expect("540", "99999999999", {"width"});
    expect("540", "null", {"width is missing"});
    expect("770.0", "0", {"K is singular"});
    expect("771.0", "0.0", {"K is singular"});
    expect("[0, 0, 1]]", "[0, 0, 0]]", {"K is singular"});
    expect("770.0", "-770.0", {"K", "positive"});
    expect("770.0, 0,", "770.0, 2.5,", {"K", "skew"});
    expect("[0, 0, 1]]", "[0, 0, 2]]", {"K", "0, 0, 1"});
    expect("266.5]", "266.5, 1]", {"K has 10 numbers, expected 9"});
    expect("266.5", "\"x\"", {"K is string"});
    expect("266.5", "null", {"K is null"});
    expect("266.5", "[[[266.5]]]", {"K is array"});
    expect("[[0, -1, 0]", "[[0, -1.1, 0]", {"R is not a rotation"});
    expect("[[0, -1, 0]", "[[0, 1, 0]", {"R mirrors"});
    expect("0.2, 3.0", "0.2", {"t has 2 numbers, expected 3"});
    expect("\"t\"", "\"distortion\": [1, 2], \"t\"", {"distortion has 2"});
    expect("\"t\"", "\"distortion\": [-5, 0, 0, 0, 0], \"t\"", {"distortion", "folds"});
}

TEST_CASE("bad files") {
    const test::Temporary folder;
    const auto path = folder / "cameras.json";
    const auto read = [&] { (void)read_cameras(path); };
    test::check_throws<IoError>(read, {path.string(), "No such file"});
    for (const std::string& text :
         {std::string(), std::string("{\"cameras\": ["), entry().substr(0, 100), entry("770.0", "NaN")}) {
        write_file(path, text);
        test::check_throws<IoError>(read, {path.string(), "not JSON"});
    }
    write_file(path, entry("770.0", "1e400"));
    test::check_throws<IoError>(read, {path.string(), "beyond the range of double"});
    write_file(path, "3");
    test::check_throws<IoError>(read, {path.string(), "expected an object"});
    write_file(path, "{}");
    test::check_throws<IoError>(read, {path.string(), "cameras is missing"});
    write_file(path, "{\"cameras\": []}");
    test::check_throws<IoError>(read, {path.string(), "at least one"});
    write_file(path, "{\"cameras\": [3]}");
    test::check_throws<IoError>(read, {path.string(), "cameras[0]"});
    write_file(path, "{\"cameras\": [" + entry() + "," + entry() + "]}");
    test::check_throws<ValueError>(read, {path.string(), "cameras[1]", "twice"});
    write_file(path, "{\"fps\": -1, \"cameras\": [" + entry() + "]}");
    test::check_throws<ValueError>(read, {path.string(), "fps"});
    write_file(path, "{\"test_frames\": [-1], \"cameras\": [" + entry() + "]}");
    test::check_throws<ValueError>(read, {path.string(), "test_frames"});
    write_file(path, "{\"test_frames\": [3, 3], \"cameras\": [" + entry() + "]}");
    test::check_throws<ValueError>(read, {path.string(), "test_frames holds 3 twice"});
}
