// SPDX-License-Identifier: Apache-2.0
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/body/moved_motion.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/image/image_file.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
using test::same_file;
using test::studio;
namespace fs = std::filesystem;

namespace {

/// An avatar of one step, and a motion that it was not trained on.
struct TrainedOnce {
    test::Temporary folder;
    fs::path out = folder / "out", avatar = out / "avatar.gsh";
    Motion dance;

    TrainedOnce() {
        check_done(run(studio().reconstruct(out, {"--steps", "1"})));
        dance = load_motion(studio().dance, studio().body);
    }
};
const TrainedOnce& trained_once() {
    static const TrainedOnce instance;
    return instance;
}

/// Transforms all frames to another world frame.
Motion moved(Motion motion, const mat3<double>& A) {
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        move_frame(studio().body, motion, t, {A, vec3<double>(0)});
    return motion;
}
const mat3<double> z_up(vec3<double>(1, 0, 0), vec3<double>(0, 0, 1), vec3<double>(0, -1, 0));
const mat3<double> y_down(vec3<double>(1, 0, 0), vec3<double>(0, -1, 0), vec3<double>(0, 0, -1));

std::vector<double> numbers_of(Span<const vec3<double>> vectors) {
    std::vector<double> numbers;
    for (const vec3<double>& v : vectors) numbers.insert(numbers.end(), {v.x, v.y, v.z});
    return numbers;
}

/// Writes a motion in AMASS's form: z up, whole poses.
void write_amass(const fs::path& path, const Motion& motion) {
    const Motion stored = moved(motion, z_up);
    const std::size_t T = stored.frame_count();
    NpzWriter file(path);
    file.add("poses", numbers_of(stored.pose), {T, 3 * stored.joint_count});
    file.add("trans", numbers_of(stored.transl), {T, 3});
    file.add("expression", stored.expression, {T, stored.expression_count});
    file.add("betas", stored.betas);
    file.add("mocap_frame_rate", 30.0);
    file.commit();
}

/// A frame of ExAvatar's fits or, with betas, of LHM's motions.
nlohmann::json frame_json(const Motion& motion, std::size_t t) {
    const auto pose = motion.pose_at(t);
    const auto part = [&](std::size_t first, std::size_t count) {
        nlohmann::json rows = nlohmann::json::array();
        for (std::size_t j = first; j < first + count; ++j) rows.push_back({pose[j].x, pose[j].y, pose[j].z});
        return rows;
    };
    const auto expression = motion.expression_at(t);
    return {{"root_pose", part(0, 1)[0]},
            {"body_pose", part(1, 21)},
            {"jaw_pose", part(22, 1)[0]},
            {"leye_pose", part(23, 1)[0]},
            {"reye_pose", part(24, 1)[0]},
            {"lhand_pose", part(25, 15)},
            {"rhand_pose", part(40, 15)},
            {"expr", std::vector<double>(expression.begin(), expression.end())},
            {"trans", numbers_of({&motion.transl[t], 1})}};
}
void write_text_of(const fs::path& path, const nlohmann::json& json) { std::ofstream(path) << json.dump(); }

/// Writes a motion in the form of ExAvatar's fits: in a camera's frame, y down, hands without their mean, the shape in
/// a separate file.
void write_exavatar(const fs::path& folder, Motion motion) {
    const BodyModel& body = studio().body;
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        for (std::size_t k = 0; k < 15; ++k) {
            vec3<double>* pose = &motion.pose[t * motion.joint_count];
            if (!body.hands_mean_left.empty()) pose[25 + k] -= body.hands_mean_left[k];
            if (!body.hands_mean_right.empty()) pose[40 + k] -= body.hands_mean_right[k];
        }
    motion = moved(motion, y_down);
    fs::create_directories(folder / "smplx_optimized/smplx_params_smoothed");
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        write_text_of(folder / "smplx_optimized/smplx_params_smoothed" / (std::to_string(3 * t) + ".json"),
                   frame_json(motion, t));
    write_text_of(folder / "smplx_optimized/shape_param.json", motion.betas);
}

/// Writes a motion in LHM's form, in its own frame: whole hands, the shape in every file.
void write_lhm(const fs::path& folder, const Motion& motion) {
    fs::create_directories(folder);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        nlohmann::json json = frame_json(motion, t);
        json["betas"] = motion.betas;
        write_text_of(folder / (std::to_string(10000 + t) + ".json"), json);
    }
}

/// Frames of a motion, from a camera that is placed automatically or from a given one.
fs::path animated(const test::Temporary& folder, const char* name, const fs::path& poses,
                 const std::vector<std::string>& more = {"--size", "96"}) {
    const fs::path out = folder / name;
    std::vector<std::string> words{"gsh-animate", trained_once().avatar.string(), "--poses", poses.string(), "--out",
                                   out.string()};
    words.insert(words.end(), more.begin(), more.end());
    const test::Outcome outcome = run(words); // a world that is turned, and a rate that is not stated, are warned about
    INFO(outcome.err);
    CHECK(outcome.code == 0);
    const bool is_own = poses.extension() == ".npz" && poses.stem() != "amass";
    CHECK((outcome.err.find("so the world is turned to y up") != std::string::npos) ==
          (!is_own && std::find(more.begin(), more.end(), "--as-stored") == more.end() &&
           (std::find(more.begin(), more.end(), "--camera") == more.end() ||
            std::find(more.begin(), more.end(), "--upright") != more.end())));
    return out;
}

/// The largest difference of a byte between the frames in two folders.
int largest_difference(const fs::path& a, const fs::path& b) {
    CHECK(test::files_below(a) == test::files_below(b));
    int most = 0;
    for (const auto& entry : fs::directory_iterator(a)) {
        const PixelImage one = read_image(entry.path()), other = read_image(b / entry.path().filename());
        REQUIRE(one.data.size() == other.data.size());
        for (std::size_t i = 0; i < one.data.size(); ++i) most = std::max(most, std::abs(one.data[i] - other.data[i]));
    }
    return most;
}

/// Height and width of the part that is not white.
std::pair<int, int> person_size(const PixelImage& image) {
    int low[2] = {1 << 20, 1 << 20}, high[2] = {-1, -1};
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            if (image.pixel(y, x)[1] < 240)
                for (const auto& [axis, at] : {std::pair(0, y), std::pair(1, x)})
                    low[axis] = std::min(low[axis], at), high[axis] = std::max(high[axis], at);
    return {high[0] - low[0] + 1, high[1] - low[1] + 1};
}

} // namespace

TEST_CASE("motions of AMASS and ExAvatar are animated standing, as the same motion in our own file") {
    const TrainedOnce& s = trained_once();
    const test::Temporary folder;
    const fs::path amass = folder / "amass.npz", exavatar = folder / "subject";
    write_amass(amass, s.dance);
    write_exavatar(exavatar, s.dance);

    const fs::path ours = animated(folder, "ours", studio().dance);
    const auto [height, width] = person_size(read_image(ours / "0000.png"));
    CHECK(height > 60);
    CHECK(height > width);
    // Rotations were converted and converted back.
    CHECK(largest_difference(ours, animated(folder, "of_amass", amass)) <= 2);
    CHECK(largest_difference(ours, animated(folder, "of_exavatar", exavatar)) <= 2);
    const std::vector<std::string> as_stored{"--size", "96", "--as-stored"};
    CHECK(largest_difference(ours, animated(folder, "ours_as_stored", studio().dance, as_stored)) == 0);
    // The person lies on the ground.
    CHECK(largest_difference(ours, animated(folder, "amass_as_stored", amass, as_stored)) > 50);

    // With a camera of the user, the motion is not turned unless the user asks for it.
    const std::string camera = studio().camera.string();
    const fs::path seen = animated(folder, "seen", studio().dance, {"--camera", camera});
    CHECK(largest_difference(seen, animated(folder, "amass_seen", amass, {"--camera", camera})) > 50);
    CHECK(largest_difference(seen, animated(folder, "amass_upright", amass, {"--camera", camera, "--upright"})) <= 2);

    check_refused(run({"gsh-animate", s.avatar.string(), "--poses", amass.string(), "--out", (folder / "both").string(),
                       "--upright", "--as-stored"}),
                  "gsh-animate", {"--upright", "--as-stored"});
    check_refused(run({"gsh-animate", s.avatar.string(), "--poses", (folder / "seen").string(), "--out",
                       (folder / "none").string()}),
                  "gsh-animate", {"seen", "holds no motion"});
}

TEST_CASE("BVH and GLB are animated as the same motion in our own file, on the avatar's own shape") {
    const TrainedOnce& s = trained_once();
    const test::Temporary folder;
    Motion dance = s.dance; // bones have no expressions
    std::fill(dance.expression.begin(), dance.expression.end(), 0.0);
    dance.betas.assign(static_cast<std::size_t>(studio().body.shape_count), 0.0);
    std::copy(studio().capture.motion.betas.begin(), studio().capture.motion.betas.end(), dance.betas.begin());
    save_motion(folder / "dance.npz", dance);
    const fs::path ours = animated(folder, "ours", folder / "dance.npz");
    for (const char* file : {"dance.bvh", "dance.glb"}) {
        check_done(run({"gsh-motion", (folder / "dance.npz").string(), "--body", studio().body_file.string(), "--out",
                        (folder / file).string()}));
        const auto outcome = run({"gsh-animate", s.avatar.string(), "--poses", (folder / file).string(), "--size", "96",
                                  "--out", (folder / "frames").string()});
        INFO(outcome.err);
        CHECK(outcome.code == 0); // with a warning that the unit of BVH is a guess
        CHECK(largest_difference(ours, folder / "frames") <= 2);
    }
    CHECK(run({"gsh-render", s.avatar.string(), "--poses", (folder / "dance.bvh").string(), "--frame", "1", "--camera",
               studio().camera.string(), "--out", (folder / "render.png").string()})
              .code == 0);
    test::truncate_file(folder / "dance.glb", 100);
    check_refused(run({"gsh-animate", s.avatar.string(), "--poses", (folder / "dance.glb").string(), "--out",
                       (folder / "none").string()}),
                  "gsh-animate", {"dance.glb", "bytes, but holds"});
    CHECK(!fs::exists(folder / "none"));
}

TEST_CASE("a reconstruction takes a folder of JSON for poses, and comes to the same avatar") {
    const TrainedOnce& s = trained_once();
    const test::Temporary folder;
    write_lhm(folder / "lhm", studio().capture.motion);
    const fs::path out = folder / "out";
    check_done(run(studio().reconstruct(out, {"--steps", "1", "--poses", (folder / "lhm").string()})));
    CHECK(same_file(out / "avatar.gsh", s.avatar));
    CHECK(test::json_of(out / "metrics.json").at("protocol").get<std::string>() == test::contains("lhm"));

    check_done(run({"gsh-check", studio().path.string(), "--body", studio().body_file.string(), "--poses",
                    (folder / "lhm").string(), "--frames", "1", "--out", (folder / "check").string()}));
    const test::Outcome rendered =
        run({"gsh-render", s.avatar.string(), "--poses", (folder / "lhm").string(), "--frame", "1", "--camera",
             studio().camera.string(), "--out", (folder / "render.png").string()});
    CHECK(rendered.code == 0);
    CHECK(rendered.err == test::contains("states no frame rate, 30 frames per second are taken"));

    fs::create_directories(folder / "empty");
    check_refused(run(studio().reconstruct(folder / "no", {"--poses", (folder / "empty").string()})), "gsh-reconstruct",
                  {"empty", "holds no motion", "NUMBER.json"});
}
