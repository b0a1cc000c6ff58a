// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/prior_views_file.hpp>

#include "io/npz_files.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <nlohmann/json.hpp>

#include <cstdint>
#include <cstring>
#include <functional>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

using namespace gsh;
using test::check_throws;

namespace {

using Words = std::initializer_list<std::string_view>;

constexpr int map_width = 8, map_height = 6;

/// Two cameras, three frames, two people; a normal map that leans to the left, a depth of two metres, a mask of the
/// left half.
struct PriorFiles {
    test::Temporary folder;
    std::vector<NamedCamera> cameras;
    std::vector<std::string> people{"ann", "bob"};

    PriorFiles() {
        for (const char* name : {"front", "side"}) {
            NamedCamera camera{name, NamedCamera::Role::train, {}, {}};
            camera.camera.width = map_width, camera.camera.height = map_height;
            camera.camera.fx = camera.camera.fy = cameras.empty() ? 10 : 20;
            camera.camera.cx = 4, camera.camera.cy = 3;
            cameras.push_back(camera);
        }
        PixelImage normals(3, map_height, map_width), mask(1, map_height, map_width);
        for (int y = 0; y < map_height; ++y)
            for (int x = 0; x < map_width; ++x) {
                const std::uint8_t colour[3] = {51, 128, 230}; // (-0.6, 0, 0.8) towards the viewer
                std::memcpy(normals.pixel(y, x), colour, 3);
                *mask.pixel(y, x) = x < map_width / 2 ? 255 : 0;
            }
        write_png(folder / "normals.png", normals);
        write_png(folder / "mask.png", mask);
        write_png(folder / "black.png", PixelImage(1, map_height, map_width));
        write_png(folder / "small.png", PixelImage(1, map_height, map_width - 1));
        std::vector<float> depth(map_width * map_height, 2);
        depth[0] = std::numeric_limits<float>::quiet_NaN(), depth[1] = 0, depth[2] = -1;
        const std::string bytes(reinterpret_cast<const char*>(depth.data()), depth.size() * sizeof(float));
        write_file(folder / "depth.npy", test::npy_bytes("<f4", "(6, 8)", bytes));
        write_file(folder / "row.npy", test::npy_bytes("<f4", "(48,)", bytes));
        write_file(folder / "whole.npy", test::npy_bytes("<i4", "(6, 8)", bytes));
    }
    [[nodiscard]] std::vector<EstimatedPriors> read(const std::string& text) const {
        write_file(folder / "priors.json", text);
        return read_prior_views(folder / "priors.json", cameras, 3, people);
    }
    /// One view: of the front camera's normals, with changes.
    [[nodiscard]] std::vector<EstimatedPriors> view(const std::string& changes) const {
        auto json = nlohmann::json::parse(R"({"normals": "normals.png", "camera": "front", "frame": 1})");
        json.merge_patch(nlohmann::json::parse(changes));
        return read(nlohmann::json{{"views", {json}}}.dump());
    }
};
PriorFiles& prior_files() {
    static PriorFiles instance;
    return instance;
}

const Camera<double>& pinhole(const EstimatedView& view) {
    return std::get<Camera<double>>(view.view.camera);
}

} // namespace

TEST_CASE("a map that many views name, and a crop without pixels, are refused") {
    const PriorFiles& files = prior_files();
    std::string views;
    for (int k = 0; k < 17; ++k)
        views += std::string(k ? ", " : "") + R"({"normals": "normals.png", "camera": "front", "frame": 1})";
    check_throws<ValueError>([&] { (void)files.read("[" + views + "]"); },
                             {"priors.json: views[16]", "normals is a map that 16 views before it name"});
    check_throws<ValueError>([&] { (void)files.view(R"({"crop": [0, 0, 1e-320, 1e-320]})"); },
                             {"priors.json: views[0]", "the camera of the crop"});
}

TEST_CASE("a view is its map, camera, frame and person") {
    const PriorFiles& files = prior_files();
    const auto people = files.read(R"({"views": [
        {"normals": "normals.png", "camera": "side", "frame": 2, "person": "bob", "integrate": true},
        {"depth": "depth.npy", "camera": "front", "frame": "canonical", "person": 0},
        {"normals": "normals.png", "encoding": "y_down", "facing": "viewer", "depth": "depth.npy", "mask": "mask.png",
         "camera": "front"}]})");
    REQUIRE(people.size() == 2);
    REQUIRE(people[1].normals.size() == 1);
    CHECK(people[1].depths.empty());
    const EstimatedView& bob = people[1].normals[0];
    CHECK(*bob.frame == 2);
    CHECK(bob.integrate);
    CHECK(bob.view.bones.empty());
    CHECK(bob.name.ends_with("priors.json: views[0]"));
    CHECK(pinhole(bob).fx == 20);
    CHECK(bob.view.map.values.at(0, 3, 3) == doctest::Approx(-0.6).epsilon(0.01));
    CHECK(bob.view.map.values.at(2, 3, 3) == doctest::Approx(-0.8).epsilon(0.01)); // towards our camera

    REQUIRE(people[0].normals.size() == 1);
    REQUIRE(people[0].depths.size() == 2);
    const PriorMap& depth = people[0].depths[0].view.map;
    CHECK(!people[0].depths[0].frame);
    for (int x = 0; x < 3; ++x) CHECK(depth.mask.at(0, 0, x) == 0); // NaN, 0, behind the camera
    CHECK(depth.mask.at(0, 0, 3) == 1);
    CHECK(depth.values.at(0, 5, 7) == 2);
    for (const EstimatedView* masked : {&people[0].normals[0], &people[0].depths[1]}) {
        CHECK(!masked->integrate);
        CHECK(masked->view.map.mask.at(0, 2, 3) == 1);
        CHECK(masked->view.map.mask.at(0, 2, 4) == 0);
        CHECK(masked->view.map.values.at(0, 2, 4) == 0);
    }
    // A bare list, without a name of a person, and with null for missing entries.
    write_file(files.folder / "priors.json", R"([{"normals": "normals.png", "camera": "front", "mask": null}])");
    const auto one = read_prior_views(files.folder / "priors.json", files.cameras, 3);
    REQUIRE(one.size() == 1);
    CHECK(one[0].normals.size() == 1);
}

TEST_CASE("cameras of their own, and crops") {
    const PriorFiles& files = prior_files();
    const std::string turn = R"("R": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "t": [0.5, 1, 2])";
    const auto own =
        files.view(R"({"camera": {"width": 8, "height": 6, "K": [[9, 0, 4], [0, 9, 3], [0, 0, 1]], )" + turn + "}}");
    CHECK(pinhole(own[0].normals[0]).fx == 9);
    CHECK(pinhole(own[0].normals[0]).R[1].y == -1);
    const std::string parallel = R"({"width": 8, "height": 6, "scale": 3, "cx": 4, "cy": 3, )" + turn + "}";
    const auto ortho = files.view(R"({"camera": )" + parallel + "}");
    const auto& camera = std::get<OrthographicCamera>(ortho[0].normals[0].view.camera);
    CHECK(camera.scale == 3);
    CHECK(camera.t.z == 2);

    // The map shows the 4 x 2 pixels from (1, 2) on: twice and three times their size.
    const Camera<double> crop = pinhole(files.view(R"({"crop": [1, 2, 4, 2]})")[0].normals[0]);
    CHECK(crop.width == 8);
    CHECK(crop.fx == 20);
    CHECK(crop.fy == 30);
    const vec3<double> p(0.3, -0.2, 1.5);
    const auto whole = to_pixel(files.cameras[0].camera, p), in_crop = to_pixel(crop, p);
    CHECK(in_crop.x == doctest::Approx((whole.x - 1) * 2));
    CHECK(in_crop.y == doctest::Approx((whole.y - 2) * 3));
    const auto cropped = files.view(R"({"crop": [-4, 0, 16, 12], "camera": )" + parallel + "}");
    CHECK(std::get<OrthographicCamera>(cropped[0].normals[0].view.camera).scale == 1.5);
    check_throws<ValueError>([&] { (void)files.view(R"({"crop": [0, 0, 4, 2], "camera": )" + parallel + "}"); },
                             {"views[0]", "crop", "one scale"});
}

TEST_CASE("what cannot be meant is refused, with the file, the view and the field") {
    const PriorFiles& files = prior_files();
    const auto refuse = [&](const std::string& changes, Words words) {
        CAPTURE(changes);
        check_throws<Error>([&] { (void)files.view(changes); }, words);
    };
    check_throws<IoError>([&] { (void)read_prior_views(files.folder / "none.json", files.cameras, 3); }, {"none.json"});
    check_throws<IoError>([&] { (void)files.read("{\"views\": ["); }, {"priors.json", "JSON"});
    check_throws<IoError>([&] { (void)files.read("{}"); }, {"priors.json", "views is missing"});
    check_throws<IoError>([&] { (void)files.read("[]"); }, {"priors.json", "at least one"});
    check_throws<IoError>([&] { (void)files.read(R"({"views": [], "view": 1})"); }, {"unknown field 'view'"});
    check_throws<IoError>([&] { (void)files.read("[3]"); }, {"views[0]", "object"});

    refuse(R"({"normal": "a.png"})", {"priors.json: views[0]", "unknown field 'normal'", "normals, encoding"});
    refuse(R"({"normals": null})", {"views[0]", "neither normals nor depth"});
    refuse(R"({"normals": null, "depth": "depth.npy", "encoding": "y_up"})", {"encoding belongs to normals"});
    refuse(R"({"normals": "none.png"})", {"none.png"});
    refuse(R"({"normals": "../normals.png"})", {"priors.json: views[0]", "'../normals.png' leads out"});
    refuse(R"({"mask": "/normals.png"})", {"priors.json: views[0]", "'/normals.png' leads out"});
    refuse(R"({"normals": 3})", {"normals is number", "text"});
    refuse(R"({"encoding": "yup"})", {"encoding is 'yup'", "y_up, y_down, opencv, x_left"});
    refuse(R"({"encoding": "opencv"})", {"normals.png", "away from the viewer"});
    refuse(R"({"facing": "back"})", {"facing is 'back'", "viewer, away"});
    refuse(R"({"facing": "away"})", {"normals.png", "face the viewer"});
    refuse(R"({"frame": 3})", {"frame is 3", "3 frames"});
    refuse(R"({"frame": -1})", {"frame is -1"});
    refuse(R"({"frame": "last"})", {"frame is 'last'", "canonical"});
    refuse(R"({"frame": 1.5})", {"frame", "integer"});
    refuse(R"({"person": "eve"})", {"person is 'eve'", "ann, bob"});
    refuse(R"({"person": 2})", {"person is 2", "2 people"});
    refuse(R"({"camera": null})", {"camera is missing"});
    refuse(R"({"camera": "back"})", {"camera is 'back'", "front, side"});
    refuse(R"({"camera": 3})", {"camera", "object"});
    refuse(R"({"camera": {"width": 8, "height": 6}})", {"views[0]: camera", "K is missing"});
    refuse(R"({"camera": {"width": 8, "height": 6, "scale": 2, "f": 3}})", {"camera", "unknown field 'f'"});
    const std::string level = R"("R": [1, 0, 0, 0, 1, 0, 0, 0, 1], "t": [0, 0, 0])";
    refuse(R"({"camera": {"width": 8, "height": 6, "scale": 0, "cx": 4, "cy": 3, )" + level + "}}",
           {"views[0]", "scale"});
    refuse(R"({"camera": {"width": 9, "height": 6, "scale": 1, "cx": 4, "cy": 3, )" + level + "}}",
           {"normals.png is 8 x 6 pixels", "9 x 6", "crop"});
    refuse(
        R"({"camera": {"width": 8, "height": 6, "K": [9, 0, 4, 0, 9, 3, 0, 0, 1], "distortion": [0.1, 0, 0, 0, 0], )" +
            level + "}}",
        {"distortion", "undistort"});
    refuse(R"({"crop": [0, 0, 4]})", {"crop has 3 numbers", "expected 4"});
    refuse(R"({"crop": [0, 0, 0, 4]})", {"crop", "no extent"});
    refuse(R"({"mask": "none.png"})", {"none.png"});
    refuse(R"({"mask": "small.png"})", {"small.png is 7 x 6 pixels", "8 x 6"});
    refuse(R"({"mask": "black.png"})", {"no pixel counts", "normals.png within", "black.png"});
    refuse(R"({"integrate": 1})", {"integrate is number", "true or false"});
    refuse(R"({"integrate": true, "depth": "depth.npy"})", {"integrate", "leave out depth"});
    refuse(R"({"depth": "normals.png"})", {"normals.png", ".npy"});
    refuse(R"({"depth": "none.npy"})", {"none.npy"});
    refuse(R"({"depth": "row.npy"})", {"row.npy", "(48,)", "(height, width)"});
    refuse(R"({"depth": "whole.npy"})", {"whole.npy", "<i4"});
}

TEST_CASE("the checksum is of the list and of the files that it names") {
    const PriorFiles files; // a copy, because the test changes it
    (void)files.view(R"({"mask": "mask.png"})");
    const auto list = files.folder / "priors.json";
    const std::uint32_t before = prior_views_checksum(list);
    CHECK(prior_views_checksum(list) == before);
    write_png(files.folder / "mask.png", PixelImage(1, map_height, map_width));
    const std::uint32_t after = prior_views_checksum(list);
    CHECK(after != before);
    write_file(list, read_file(list) + "\n");
    CHECK(prior_views_checksum(list) != after);
    check_throws<IoError>([&] { (void)prior_views_checksum(files.folder / "none.json"); }, {"none.json"});
}
