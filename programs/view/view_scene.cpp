// SPDX-License-Identifier: Apache-2.0
#include "view/view_scene.hpp"

#include "common/input_files.hpp"
#include "export/export_format.hpp"
#include "show/light_option.hpp"
#include "view/shown_names.hpp"

#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <nlohmann/json.hpp>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <limits>
#include <new>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace gsh::programs {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

std::vector<vec3<double>> posed_vertices(const RigData& rig, const Motion& motion, std::size_t frame) {
    return pose_body(rig.body, motion.pose_at(frame), motion.transl[frame],
                     motion.betas.empty() ? rig.betas : motion.betas, motion.expression_at(frame), rig.joints)
        .vertices;
}

/// Bounds of points.
struct Bounds {
    vec3<double> low{std::numeric_limits<double>::infinity()}, high{-std::numeric_limits<double>::infinity()};

    void add(const std::vector<vec3<double>>& points) {
        for (const vec3<double>& p : points) low = glm::min(low, p), high = glm::max(high, p);
    }
    [[nodiscard]] ViewBox box() const { return {(low + high) * 0.5, (high - low) * 0.5}; }
};

ViewBox box_of(const ShownPeople& people) {
    constexpr std::size_t most = 24; // frames that are looked at
    Bounds bounds;
    for (std::size_t p = 0; p < people.data.size(); ++p) {
        const Motion& motion = people.motions[p];
        const std::size_t frames = motion.frame_count(), count = std::min(frames, most);
        for (std::size_t k = 0; k < count; ++k)
            bounds.add(posed_vertices(people.data[p].rig, motion, k * frames / count));
    }
    return bounds.box();
}

/// The box of a scene without its outermost Gaussians, which are often far away.
ViewBox box_of(const GaussianCloud<float>& cloud) {
    constexpr double left_out = 0.02;
    ViewBox box;
    if (cloud.size() == 0) return box;
    std::vector<double> values(cloud.size());
    for (int axis = 0; axis < 3; ++axis) {
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(cloud.means[i][axis]);
        std::sort(values.begin(), values.end());
        const auto skip = static_cast<std::size_t>(left_out * static_cast<double>(values.size()));
        const double low = values[skip], high = values[values.size() - 1 - skip];
        box.centre[axis] = (low + high) / 2, box.half[axis] = std::max((high - low) / 2, 1e-3);
    }
    return box;
}

/// Whether poses for SMPL-X's joints fit a body.
bool has_smplx_joints(const BodyModel& body) {
    if (body.joint_count() != static_cast<std::size_t>(actor_joint_count)) return false;
    for (std::size_t j = 0; j < body.joint_names.size(); ++j)
        if (body.joint_names[j] != actor_joints[j].name || body.parents[j] != actor_joints[j].parent) return false;
    return true;
}

/// Motions of the built-in actor for an avatar that was given none, and its canonical pose as the last one.
std::vector<ViewMotion> built_in_motions(const RigData& rig, const Motion& canonical) {
    constexpr int frames = 80;
    constexpr double fps = 20;
    std::vector<ViewMotion> motions;
    const bool is_actor = rig.body.expression_count == static_cast<int>(actor_expression_names.size()) &&
                          rig.betas.size() == actor_shape_names.size();
    for (const auto& [name, kind] :
         {std::pair{"stride", ActorMotion::stride}, {"reach", ActorMotion::reach}, {"talk", ActorMotion::talk}}) {
        Motion motion = actor_motion(kind, frames, fps);
        motion.betas.clear(); // the avatar's own shape
        if (!is_actor) motion.expression.clear(), motion.expression_count = 0;
        place_like(rig, canonical, motion);
        motions.push_back({std::string("built-in: ") + name, std::move(motion)});
    }
    motions.push_back({"canonical pose", canonical});
    return motions;
}

template <class Vectors>
Json json_of(const Vectors& vectors) {
    Json list = Json::array();
    for (const auto& v : vectors)
        for (int axis = 0; axis < 3; ++axis) list.push_back(v[axis]);
    return list;
}

/// The name of a sent file as it may appear in messages and on the page: short, printable, without folders. A long name
/// keeps its ending, which can choose the layout.
std::string shown_name(const std::string& name) {
    constexpr std::size_t longest = 80, longest_ending = 16; // bytes
    std::string result = name.substr(std::min(name.size(), name.find_last_of("/\\") + 1));
    for (char& c : result)
        if (std::iscntrl(static_cast<unsigned char>(c))) c = '?';
    if (result.size() > longest) {
        std::string ending = fs::path(result).extension().string();
        if (ending.size() > longest_ending) ending.clear();
        std::size_t end = longest - ending.size();
        while (end > 0 && (static_cast<unsigned char>(result[end]) & 0xC0) == 0x80) --end; // whole characters of UTF-8
        result = result.substr(0, end) + ending;
    }
    return result.empty() ? "motion" : result;
}

/// A folder for one file, which the destructor removes.
class SentFile {
public:
    SentFile(const std::string& name, const std::string& bytes) {
        std::string pattern = (fs::temp_directory_path() / "gsh-view-XXXXXX").string();
        if (mkdtemp(pattern.data()) == nullptr) throw IoError(pattern + ": cannot be created for the sent motion");
        try {
            folder_ = pattern;
            std::string ending;
            for (const char c : fs::path(name).extension().string())
                if (ending.size() < 8 && (c == '.' || std::isalnum(static_cast<unsigned char>(c))))
                    ending += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
            path_ = folder_ / ("motion" + ending);
            write_file(path_, bytes, Sync::none);
        } catch (...) {
            ::rmdir(pattern.c_str()); // write_file has removed its own
            throw;
        }
    }
    SentFile(const SentFile&) = delete;
    SentFile& operator=(const SentFile&) = delete;
    ~SentFile() { remove(); }

    [[nodiscard]] const fs::path& path() const { return path_; }
    /// A message with the file's own name in place of the path.
    [[nodiscard]] std::string renamed(std::string message, const std::string& name) const {
        const std::string path = path_.string();
        for (std::size_t at; (at = message.find(path)) != std::string::npos;) message.replace(at, path.size(), name);
        return message;
    }

private:
    void remove() const {
        std::error_code ignored;
        fs::remove_all(folder_, ignored);
    }
    fs::path folder_, path_;
};

Json describe_person(const ViewScene& scene, std::size_t p) {
    const AvatarData& data = scene.people->data[p];
    const BodyModel& body = data.rig.body;
    Json person{{"name", scene.names[p]},
                {"gaussians", data.rig.point_count()},
                {"joint_names", body.joint_names},
                {"parents", body.parents},
                {"rest_joints", json_of(data.rig.joints)},
                {"betas", data.rig.betas},
                {"expressions", body.expression_count},
                {"shape_directions", json_of(joint_directions(body, body.shapedirs))},
                {"expression_directions", json_of(joint_directions(body, body.exprdirs))},
                {"lit", data.light.has_value()},
                {"shadows", data.light ? data.light->shadows : !data.ao.empty() || data.occlusion_field.has_value()},
                {"motions", Json::array()}};
    for (const ViewMotion& m : scene.motions[p])
        person["motions"].push_back({{"name", m.name}, {"frames", m.motion.frame_count()}});
    return person;
}

} // namespace

std::vector<PersonSize> ViewScene::sizes() const {
    std::vector<PersonSize> result;
    if (people)
        for (const AvatarData& data : people->data)
            result.push_back({data.rig.joint_count(), data.rig.betas.size(),
                              static_cast<std::size_t>(data.rig.body.expression_count)});
    return result;
}

vec3<double> ViewScene::light_centre(std::size_t person) const {
    const MotionPlace place = place_of(people->motions[person], people->data[person].rig.joints[0]);
    return (place.low + place.high) * 0.5;
}

void place_like(const RigData& rig, const Motion& other, Motion& motion) {
    Bounds there, here;
    there.add(posed_vertices(rig, other, 0)), here.add(posed_vertices(rig, motion, 0));
    vec3<double> shift = other.transl[0] - motion.transl[0];
    shift.y = there.low.y - here.low.y;
    for (vec3<double>& t : motion.transl) t += shift;
}

ViewScene load_view_scene(const std::vector<fs::path>& files, const std::vector<fs::path>& poses,
                          const LightOption& light, const RigOption& rig, std::vector<std::string>& warnings,
                          const std::string& input_up) {
    const auto is_avatar = [](const fs::path& file) { return file.extension() == ".gsh"; };
    ViewScene scene;
    scene.rig = rig;
    scene.names = names_of_files(files);
    if (files.size() == 1 && !is_avatar(files[0])) {
        check_value(poses.empty() && light.is_default() && rig.is_default(), files[0].string(),
                    "is a static scene; --poses, --joint-map, --animation, --input-fps, --light, --light-turn and "
                    "--exposure need avatars (.gsh)");
        StillSplats splats = splats_of_file(files[0], input_up);
        warnings.insert(warnings.end(), splats.warnings.begin(), splats.warnings.end());
        scene.y_down = !splats.notes.up && is_y_down(files[0]);
        scene.cloud = std::move(splats.cloud), scene.filter = splats.notes.filter.value_or(PixelFilter{});
        scene.box = box_of(scene.cloud);
        return scene;
    }
    check_value(input_up.empty(), files[0].string(), "--input-up is for a scene, not for avatars (.gsh)");
    for (const fs::path& file : files)
        check_value(is_avatar(file), file.string(), "is not an avatar (.gsh); only avatars can be shown together");
    check_value(files.size() == 1 || poses.empty() || poses.size() == files.size(), "--poses",
                "has " + std::to_string(poses.size()) + " motions for " + std::to_string(files.size()) +
                    " avatars; give one for each, in the same order");
    const std::size_t first_ones = std::min(poses.size(), files.size());
    rig.check_rates(poses.size());
    RigOption of_first = rig;
    if (of_first.input_fps.size() > 1) of_first.input_fps.resize(first_ones);
    scene.people.emplace(files, std::vector<fs::path>(poses.begin(), poses.begin() + static_cast<long>(first_ones)),
                         light, true, of_first);
    ShownPeople& people = *scene.people;
    scene.filter = people.filter();
    const std::vector<std::string> motion_names = names_of_files(poses);
    for (std::size_t p = 0; p < people.data.size(); ++p) {
        const RigData& body_rig = people.data[p].rig;
        if (!poses.empty())
            scene.motions.push_back({{motion_names[p], people.motions[p]}});
        else if (has_smplx_joints(body_rig.body))
            scene.motions.push_back(built_in_motions(body_rig, people.motions[p]));
        else
            scene.motions.push_back({{"canonical pose", people.motions[p]}});
        people.motions[p] = scene.motions[p][0].motion;
    }
    for (std::size_t m = first_ones; m < poses.size(); ++m) {
        const RigData& first = people.data[0].rig;
        Motion motion = motion_of_file(poses[m], first.body, warnings, true, first.betas, rig, m);
        place_like(first, people.motions[0], motion);
        scene.motions[0].push_back({motion_names[m], std::move(motion)});
    }
    scene.box = box_of(people);
    return scene;
}

ViewMotion read_sent_motion(const ViewScene& scene, std::size_t person, const std::string& name,
                            const std::string& bytes, std::vector<std::string>& warnings, double input_fps) {
    check_value(scene.people && person < scene.people->data.size(), "motion",
                "there is no person " + std::to_string(person));
    const RigData& rig = scene.people->data[person].rig;
    const std::string shown = shown_name(name);
    const SentFile file(shown, bytes);
    RigOption option = scene.rig;
    if (input_fps > 0) option.input_fps.assign(1, input_fps);
    if (option.input_fps.size() > 1) option.input_fps.clear(); // those are of the motions of --poses
    try {
        ViewMotion result{shown, motion_of_file(file.path(), rig.body, warnings, true, rig.betas, option)};
        validate(result.motion, rig.body, shown);
        place_like(rig, scene.people->motions[person], result.motion);
        for (std::string& warning : warnings) warning = page_words(file.renamed(warning, shown));
        return result;
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::length_error&) { // of a container
        throw std::bad_alloc();
    } catch (const std::exception& error) {
        throw IoError(page_error(file.renamed(error.what(), shown), shown));
    }
}

std::string describe(const ViewScene& scene) {
    Json json{{"names", scene.names},
              {"people", Json::array()},
              {"gaussians", scene.cloud.size()},
              {"size", scene.size},
              {"y_down", scene.y_down},
              {"centre", {scene.box.centre.x, scene.box.centre.y, scene.box.centre.z}},
              {"half", {scene.box.half.x, scene.box.half.y, scene.box.half.z}}};
    for (std::size_t p = 0; scene.people && p < scene.people->data.size(); ++p)
        json["people"].push_back(describe_person(scene, p));
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

} // namespace gsh::programs
