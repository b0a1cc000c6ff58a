// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars, motions and pictures of them: gsh's own classes behind the handles of posing_interface.hpp.

#include "posing_interface.hpp"
#include "library/errors.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace gsh_python {

using namespace gsh;

namespace {

/// Splats outlive the Python object of their avatar, so both share this.
struct LoadedAvatar {
    cpu::Threads backend;
    AvatarData data;
    Avatar<cpu::Threads> avatar;
    std::mutex mutex; ///< of the backend and of all splats: calls of several Python threads take turns

    LoadedAvatar(const std::filesystem::path& path, int threads)
        : backend(static_cast<std::size_t>(threads)), data(gsh::load_avatar(path)), avatar(backend, data) {}
};

/// As guarded, with a status of its own for files.
template <class Work>
int guarded_with_files(const Work& work) {
    bool file = false;
    const int status = guarded([&] {
        try {
            work();
        } catch (const IoError&) {
            file = true;
            throw;
        }
    });
    return file ? file_failed : status;
}

[[nodiscard]] Camera<double> camera_of(const CameraNumbers& numbers) {
    mat3<double> R;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) R[column][row] = numbers.R[3 * row + column];
    return camera_from_K<double>(Span<const double>(numbers.K, 9), R, {numbers.t[0], numbers.t[1], numbers.t[2]},
                                 numbers.width, numbers.height, "camera");
}

[[nodiscard]] CameraNumbers numbers_of(const Camera<double>& camera) {
    CameraNumbers numbers{{camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1},
                          {},
                          {camera.t.x, camera.t.y, camera.t.z},
                          camera.width,
                          camera.height};
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) numbers.R[3 * row + column] = camera.R[column][row];
    return numbers;
}

} // namespace

struct AvatarHandle {
    std::shared_ptr<LoadedAvatar> loaded;
    std::vector<std::int32_t> parents;
};

struct MotionHandle {
    Motion motion;
};

struct SplatsHandle {
    std::shared_ptr<LoadedAvatar> loaded;
    Splats<cpu::Threads> splats;
    RigPose<cpu::Threads> pose;
    Avatar<cpu::Threads>::Cache cache;
    bool posed = false;
    Splats<cpu::Threads> together; ///< with those of other avatars, for a picture of several
    Rasterizer<cpu::Threads>::Cache raster;
    std::vector<float> planes;
};

namespace {

int load_avatar(const char* path, int threads, AvatarHandle** avatar) {
    return guarded_with_files([&] {
        auto handle = std::make_unique<AvatarHandle>();
        handle->loaded = std::make_shared<LoadedAvatar>(path, threads);
        for (const auto parent : handle->loaded->data.rig.body.parents)
            handle->parents.push_back(static_cast<std::int32_t>(parent));
        *avatar = handle.release();
    });
}

void release_avatar(AvatarHandle* avatar) { delete avatar; }

AvatarInfo avatar_info(const AvatarHandle& avatar) {
    const AvatarData& data = avatar.loaded->data;
    const GaussianCloud<float>& g = data.gaussians;
    const auto numbers = [](const auto& rows) { return rows.empty() ? nullptr : &rows[0].x; };
    return {static_cast<std::int64_t>(g.size()),
            static_cast<std::int64_t>(data.rig.joint_count()),
            static_cast<std::int64_t>(data.rig.betas.size()),
            data.rig.body.expression_count,
            g.sh_degree,
            data.light.has_value(),
            numbers(g.means),
            g.quats.empty() ? nullptr : &g.quats[0].w,
            numbers(g.log_scales),
            g.opacity_logits.data(),
            numbers(g.sh),
            data.rig.betas.data(),
            numbers(data.rig.joints),
            avatar.parents.data()};
}

void joint_names(const AvatarHandle& avatar, const Texts& names) {
    for (const std::string& name : avatar.loaded->data.rig.body.joint_names) names.add(names.list, name.c_str());
}

int load_motion(const AvatarHandle& avatar, const char* path, int upright, double input_fps, const char* animation,
                const Texts& warnings, MotionHandle** motion) {
    return guarded_with_files([&] {
        const RigData& rig = avatar.loaded->data.rig;
        MotionFileOptions options;
        if (upright) options.world = MotionFileOptions::World::upright;
        options.betas = rig.betas, options.input_fps = input_fps, options.animation = animation;
        std::vector<std::string> texts;
        auto handle = std::make_unique<MotionHandle>(MotionHandle{load_any_motion(path, rig.body, options, &texts)});
        for (const std::string& text : texts) warnings.add(warnings.list, text.c_str());
        *motion = handle.release();
    });
}

void release_motion(MotionHandle* motion) { delete motion; }

MotionInfo motion_info(const MotionHandle& handle) {
    const Motion& m = handle.motion;
    return {static_cast<std::int64_t>(m.frame_count()),
            static_cast<std::int64_t>(m.joint_count),
            static_cast<std::int64_t>(m.betas.size()),
            static_cast<std::int64_t>(m.expression_count),
            m.pose.empty() ? nullptr : &m.pose[0].x,
            m.transl.empty() ? nullptr : &m.transl[0].x,
            m.expression.data(),
            m.betas.data(),
            m.timestamps.data()};
}

int make_splats(const AvatarHandle& avatar, SplatsHandle** splats) {
    return guarded([&] {
        auto handle = std::make_unique<SplatsHandle>();
        handle->loaded = avatar.loaded;
        handle->splats.resize(avatar.loaded->avatar.size());
        *splats = handle.release();
    });
}

void release_splats(SplatsHandle* splats) { delete splats; }

SplatsInfo splats_info(SplatsHandle& handle) {
    const SplatView<float> view = handle.splats.view();
    const auto first = [](const auto& rows) -> float* { return rows.empty() ? nullptr : &rows[0].x; };
    return {static_cast<std::int64_t>(view.size()), first(view.means),
            view.covariances.empty() ? nullptr : &view.covariances[0].xx, view.opacities.data(), first(view.colors)};
}

/// The motion of one frame that numbers describe.
[[nodiscard]] Motion motion_of(const PoseNumbers& numbers, const RigData& rig) {
    Motion motion = rest_motion(rig);
    const auto rows = [](const double* from, std::int64_t count, std::vector<vec3<double>>& to) {
        to.clear();
        for (std::int64_t i = 0; i < count; ++i) to.push_back({from[3 * i], from[3 * i + 1], from[3 * i + 2]});
    };
    if (numbers.pose != nullptr) {
        motion.joint_count = static_cast<std::size_t>(numbers.joints);
        rows(numbers.pose, numbers.joints, motion.pose);
    }
    if (numbers.transl != nullptr) rows(numbers.transl, 1, motion.transl);
    if (numbers.expression != nullptr) {
        motion.expression_count = static_cast<std::size_t>(numbers.expressions);
        motion.expression.assign(numbers.expression, numbers.expression + numbers.expressions);
    }
    if (numbers.shape != nullptr) motion.betas.assign(numbers.shape, numbers.shape + numbers.betas);
    validate(motion, rig.body, "Avatar.pose");
    return motion;
}

int pose(SplatsHandle& splats, const MotionHandle* motion, std::int64_t frame, const PoseNumbers& numbers,
         const CameraNumbers* camera, const double* center) {
    return guarded([&] {
        LoadedAvatar& loaded = *splats.loaded;
        const std::lock_guard lock(loaded.mutex);
        const Motion own = motion != nullptr ? Motion{} : motion_of(numbers, loaded.data.rig);
        const Motion& moves = motion != nullptr ? motion->motion : own;
        const vec3<float> seen_from = camera != nullptr ? camera_of(*camera).cast<float>().center()
                                                        : vec3<float>(vec3<double>(center[0], center[1], center[2]));
        loaded.avatar.rig().upload_pose(moves, static_cast<std::size_t>(frame), splats.pose);
        splats.posed = false; // should the rest fail
        loaded.avatar.pose(splats.pose, seen_from, splats.splats.view(), splats.cache);
        splats.posed = true;
    });
}

/// The splats of all handles in the first one's `together`; of a single one, its own.
[[nodiscard]] SplatView<const float> joined(SplatsHandle* const* handles, std::int64_t count) {
    SplatsHandle& first = *handles[0];
    if (count == 1) return std::as_const(first.splats).view();
    std::size_t size = 0, begin = 0;
    for (std::int64_t i = 0; i < count; ++i) size += handles[i]->splats.means.size();
    first.together.resize(size);
    for (std::int64_t i = 0; i < count; ++i) {
        const SplatView<const float> from = std::as_const(handles[i]->splats).view();
        const SplatView<float> to = first.together.view().subview(begin, from.size());
        std::copy(from.means.begin(), from.means.end(), to.means.begin());
        std::copy(from.covariances.begin(), from.covariances.end(), to.covariances.begin());
        std::copy(from.opacities.begin(), from.opacities.end(), to.opacities.begin());
        std::copy(from.colors.begin(), from.colors.end(), to.colors.begin());
        begin += from.size();
    }
    return std::as_const(first.together).view();
}

int render(SplatsHandle* const* handles, std::int64_t count, const CameraNumbers& numbers, const float* background,
           const Images& images) {
    return guarded([&] {
        std::vector<LoadedAvatar*> avatars; // each once, and always locked in the same order
        for (std::int64_t i = 0; i < count; ++i) avatars.push_back(handles[i]->loaded.get());
        std::sort(avatars.begin(), avatars.end());
        avatars.erase(std::unique(avatars.begin(), avatars.end()), avatars.end());
        std::vector<std::unique_lock<std::mutex>> locks;
        for (LoadedAvatar* avatar : avatars) locks.emplace_back(avatar->mutex);

        SplatsHandle& first = *handles[0];
        const PixelFilter& filter = first.loaded->data.filter;
        for (std::int64_t i = 0; i < count; ++i) {
            const PixelFilter& other = handles[i]->loaded->data.filter;
            check_value(handles[i]->posed, "render", "splats[" + std::to_string(i) + "] are of a pose that failed");
            check_value(other.dilation == filter.dilation && other.compensate_opacity == filter.compensate_opacity,
                        "render",
                        "splats[" + std::to_string(i) + "] is of an avatar that was trained with another pixel filter "
                        "than that of splats[0], so no picture is right for both");
        }
        const Camera<float> camera = camera_of(numbers).cast<float>();
        const auto height = static_cast<std::size_t>(camera.height), width = static_cast<std::size_t>(camera.width);
        first.planes.resize(3 * height * width);
        const auto image = [&](float* numbers_of_image, int channels) {
            return numbers_of_image == nullptr
                       ? ImageView<float>{}
                       : ImageView<float>{{numbers_of_image, static_cast<std::size_t>(channels) * height * width},
                                          channels, camera.height, camera.width};
        };
        const Rasterizer<cpu::Threads> rasterizer(first.loaded->backend, raster_params<float>(filter));
        rasterizer.forward(camera, joined(handles, count),
                           {.color = vec3<float>(background[0], background[1], background[2])},
                           {.color = image(first.planes.data(), 3),
                            .alpha = image(images.alpha, 1),
                            .expected_depth = image(images.expected_depth, 1),
                            .median_depth = image(images.median_depth, 1)},
                           first.raster);
        const std::size_t pixels = height * width;
        for (std::size_t i = 0; i < pixels; ++i)
            for (std::size_t c = 0; c < 3; ++c) images.color[3 * i + c] = first.planes[c * pixels + i];
    });
}

int read_camera(const char* path, const char* name, CameraNumbers* camera) {
    return guarded_with_files([&] { *camera = numbers_of(gsh::read_camera(path, name).camera); });
}

int check_camera(const CameraNumbers& camera) {
    return guarded([&] { (void)camera_of(camera); });
}

int look_at(const double* eye, const double* target, const double* up, double vertical_fov, CameraNumbers* camera) {
    return guarded([&] {
        const auto vector = [](const double* v) { return vec3<double>(v[0], v[1], v[2]); };
        *camera = numbers_of(gsh::look_at<double>(vector(eye), vector(target), vector(up), vertical_fov, camera->width,
                                                  camera->height));
    });
}

} // namespace

} // namespace gsh_python

extern "C" const gsh_python::PosingApi* gsh_python_posing_api() {
    using namespace gsh_python;
    static constexpr PosingApi api{.load_avatar = &gsh_python::load_avatar,
                                   .release_avatar = &release_avatar,
                                   .avatar_info = &avatar_info,
                                   .joint_names = &joint_names,
                                   .load_motion = &load_motion,
                                   .release_motion = &release_motion,
                                   .motion_info = &motion_info,
                                   .make_splats = &make_splats,
                                   .release_splats = &release_splats,
                                   .splats_info = &splats_info,
                                   .pose = &pose,
                                   .render = &render,
                                   .read_camera = &gsh_python::read_camera,
                                   .check_camera = &gsh_python::check_camera,
                                   .look_at = &gsh_python::look_at};
    return &api;
}
