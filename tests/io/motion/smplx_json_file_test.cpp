// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/motion/smplx_json_file.hpp>

#include "io/sample_files.hpp"
#include "io/small_body.hpp"

#include <functional>
#include <string>
#include <vector>

using namespace gsh;
using detail::Json;

namespace {

Json rows(test::Rng& rng, std::size_t count) {
    Json list = Json::array();
    for (std::size_t i = 0; i < count; ++i) list.push_back(rng.numbers(3, -0.3, 0.3));
    return list;
}

Json frame(test::Rng& rng) {
    Json json;
    for (const char* key : {"root_pose", "jaw_pose", "leye_pose", "reye_pose", "trans"})
        json[key] = rng.numbers(3, -0.3, 0.3);
    json["body_pose"] = rows(rng, 21);
    json["lhand_pose"] = rows(rng, 15);
    json["rhand_pose"] = rows(rng, 15);
    return json;
}

vec3<double> vector_of(const Json& json) {
    return {json[0].get<double>(), json[1].get<double>(), json[2].get<double>()};
}

/// ExAvatar's fits: file names are plain frame numbers.
struct ExAvatar {
    test::Temporary folder;
    std::filesystem::path root = folder / "subject", params = root / "smplx_optimized/smplx_params_smoothed";
    BodyModel body = test::small_body(55, 10, 10, true);
    std::vector<Json> frames;
    std::vector<int> numbers{2, 9, 10, 100};

    ExAvatar() {
        std::filesystem::create_directories(params);
        test::Rng rng(4);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            frames.push_back(frame(rng));
            frames.back()["expr"] = rng.numbers(50);
        }
        write();
        test::write_text(root / "smplx_optimized/shape_param.json", Json(rng.numbers(100)).dump());
        test::write_text(root / "smplx_optimized/joint_offset.json", "[]");
    }
    void write() const {
        for (std::size_t i = 0; i < frames.size(); ++i)
            test::write_text(params / (std::to_string(numbers[i]) + ".json"), frames[i].dump());
    }
    [[nodiscard]] Motion load(std::vector<std::string>* warnings = nullptr) const {
        return load_smplx_json_motion(root, body, {}, warnings);
    }
};

} // namespace

TEST_CASE_FIXTURE(ExAvatar,
                  "ExAvatar's fits: frames in order of their numbers, the mean hand added, the shape from beside") {
    std::vector<std::string> warnings;
    const Motion motion = load(&warnings);
    REQUIRE(motion.frame_count() == 4);
    for (std::size_t t = 0; t < 4; ++t) {
        const auto pose = motion.pose_at(t);
        CHECK(pose[0] == vector_of(frames[t]["root_pose"]));
        CHECK(pose[21] == vector_of(frames[t]["body_pose"][20]));
        CHECK(pose[22] == vector_of(frames[t]["jaw_pose"]));
        CHECK(pose[24] == vector_of(frames[t]["reye_pose"]));
        CHECK(length(pose[26] - vector_of(frames[t]["lhand_pose"][1]) - body.hands_mean_left[1]) < 1e-15);
        CHECK(length(pose[54] - vector_of(frames[t]["rhand_pose"][14]) - body.hands_mean_right[14]) < 1e-15);
        CHECK(motion.expression_at(t)[9] == frames[t]["expr"][9].get<double>());
        CHECK(motion.transl[t] == vector_of(frames[t]["trans"]));
        CHECK(motion.timestamps[t] == doctest::Approx(numbers[t] / 30.0));
    }
    const auto said = [&](const char* words) {
        return std::any_of(warnings.begin(), warnings.end(),
                           [&](const std::string& w) { return w.find(words) != std::string::npos; });
    };
    CHECK(said("joint_offset.json: is not applied"));
    CHECK(said("betas hold 100"));
    CHECK(load_smplx_json_motion(params, body).pose == motion.pose);
}

TEST_CASE("LHM's motions: whole hands, a shape in every file, no expression") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 10, 10, true);
    test::Rng rng(6);
    std::vector<Json> frames;
    std::filesystem::create_directories(folder / "dance/smplx_params");
    for (int i = 0; i < 3; ++i) {
        Json json = frame(rng);
        json["betas"] = std::vector<double>(10, 0.25);
        json["focal"] = {1000.0, 1000.0};
        json["princpt"] = {320.0, 240.0};
        json["img_size_wh"] = {640, 480};
        json["pad_ratio"] = 0.2;
        frames.push_back(json);
        test::write_text(folder / "dance/smplx_params" / (test::padded(i + 1, 5) + ".json"), json.dump());
    }
    const Motion motion = load_smplx_json_motion(folder / "dance", body);
    REQUIRE(motion.frame_count() == 3);
    CHECK(motion.pose_at(2)[25] == vector_of(frames[2]["lhand_pose"][0]));
    CHECK(motion.betas == std::vector<double>(10, 0.25));
    CHECK(motion.expression == std::vector<double>(30, 0.0));
    MotionFileOptions options;
    options.fps = 6;
    CHECK(load_smplx_json_motion(folder / "dance", body, options).timestamps[0] == doctest::Approx(1.0 / 6));
}

TEST_CASE_FIXTURE(ExAvatar, "a camera's frame, y down, is turned upright") {
    for (Json& json : frames) json["root_pose"] = {3.1, 0.05, 0};
    write();
    MotionFileOptions options;
    options.world = MotionFileOptions::World::upright;
    const Motion stored = load(), upright = load_smplx_json_motion(root, body, options);
    auto points = test::posed_points(body, stored, 3);
    for (auto& p : points) p = {p.x, -p.y, -p.z};
    CHECK(test::largest_distance(test::posed_points(body, upright, 3), points) < 1e-12);
}

TEST_CASE_FIXTURE(ExAvatar, "bad files name the file and the field") {
    const auto expect = [&](std::size_t i, const std::function<void(Json&)>& change,
                            std::initializer_list<std::string_view> words) {
        const Json kept = frames[i];
        change(frames[i]);
        write();
        test::check_throws<Error>([&] { (void)load(); }, {std::to_string(numbers[i]) + ".json"});
        test::check_throws<Error>([&] { (void)load(); }, words);
        frames[i] = kept;
        write();
    };
    expect(0, [](Json& j) { j.erase("trans"); }, {"trans is missing"});
    expect(2, [](Json& j) { j.erase("lhand_pose"); }, {"lhand_pose is missing"});
    expect(1, [](Json& j) { j["body_pose"].erase(3); }, {"body_pose has 60 numbers, expected 63"});
    expect(1, [](Json& j) { j["expr"].erase(3); }, {"expr has 49", "50"});
    expect(1, [](Json& j) { j["jaw_pose"] = "open"; }, {"jaw_pose is string"});
    expect(1, [](Json& j) { j["jaw_pose"] = {1, 2, nullptr}; }, {"jaw_pose"});
    expect(3, [](Json& j) { j = Json::array(); }, {"array", "object"});
    test::write_text(params / "9.json", "{\"root_pose\": [0, 0");
    test::check_throws<IoError>([&] { (void)load(); }, {"9.json", "not JSON"});
    write();
    test::write_text(params / "09.json", frames[1].dump());
    test::check_throws<IoError>([&] { (void)load(); }, {"its number is that of", "each frame once"});
    std::filesystem::remove(params / "09.json");
    std::filesystem::remove(root / "smplx_optimized/shape_param.json");
    test::check_throws<IoError>([&] { (void)load(); }, {"shape_param.json is missing"});
    test::check_throws<IoError>([&] { (void)load_smplx_json_motion(folder / "none", body); }, {"none", "NUMBER.json"});
}
