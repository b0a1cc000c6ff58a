// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars of files, posed as arrays of splats, and the adjoint with respect to the pose.

#include "library/avatar.hpp"

#include "library/arrays.hpp"
#include "library/errors.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/model/avatar_file.hpp>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace gsh_python {

namespace {

using namespace gsh;
using B = cpu::Threads;

/// A pose of an avatar, and what its adjoint needs.
struct PosedAvatar;

/// An avatar on threads of its own. Poses hold it, so that it outlives them.
struct LoadedAvatar {
    B backend;
    AvatarData data;
    Avatar<B> avatar;
    std::mutex mutex; // of `free`
    std::vector<std::unique_ptr<PosedAvatar>> free; // whose memory serves the next pose

    LoadedAvatar(const char* path, int threads)
        : backend(static_cast<std::size_t>(std::max(threads, 1))), data(gsh::load_avatar(path)),
          avatar(backend, data) {}
};

struct PosedAvatar {
    std::shared_ptr<LoadedAvatar> owner;
    RigPose<B> pose;
    vec3<float> center = vec3<float>(0);
    Avatar<B>::Cache cache;
};

[[nodiscard]] SplatView<float> view_of(const SplatOutputs& out, std::size_t n) {
    return {elements<vec3<float>, float>(out.means, 0, n), elements<sym3<float>, float>(out.covars, 0, n),
            elements<float, float>(out.opacities, 0, n), elements<vec3<float>, float>(out.colors, 0, n)};
}

} // namespace

int open_avatar(const char* path, int threads, void** avatar, AvatarSizes* sizes) {
    return guarded([&] {
        auto loaded = std::make_unique<std::shared_ptr<LoadedAvatar>>(std::make_shared<LoadedAvatar>(path, threads));
        const AvatarData& data = (*loaded)->data;
        *sizes = {.count = static_cast<std::int64_t>(data.rig.point_count()),
                  .joints = static_cast<std::int64_t>(data.rig.joint_count()),
                  .betas = static_cast<std::int64_t>(data.rig.betas.size()),
                  .expression = data.rig.body.expression_count,
                  .dilation = data.filter.dilation,
                  .compensate = data.filter.compensate_opacity ? 1 : 0,
                  .lit = data.light ? 1 : 0};
        *avatar = loaded.release();
    });
}

int betas_of_avatar(void* avatar, double* betas) {
    return guarded([&] {
        const std::vector<double>& own = (*static_cast<std::shared_ptr<LoadedAvatar>*>(avatar))->data.rig.betas;
        std::copy(own.begin(), own.end(), betas);
    });
}

int pose_avatar(void* avatar, const PoseArrays& pose, const SplatOutputs& out, void** pass) {
    return guarded([&] {
        const std::shared_ptr<LoadedAvatar>& loaded = *static_cast<std::shared_ptr<LoadedAvatar>*>(avatar);
        const Rig<B>& rig = loaded->avatar.rig();
        std::unique_ptr<PosedAvatar> posed;
        {
            const std::lock_guard lock(loaded->mutex);
            if (!loaded->free.empty()) posed = std::move(loaded->free.back()), loaded->free.pop_back();
        }
        if (!posed) posed = std::make_unique<PosedAvatar>();
        posed->owner = loaded;
        const auto angles = elements<vec3<float>, float>(pose.pose, 0, rig.joint_count());
        const auto coefficients = elements<float, float>(pose.coefficients, 0, rig.coefficient_count());
        const auto transl = elements<vec3<float>, float>(pose.transl, 0, 1);
        assign(loaded->backend, angles, posed->pose.pose);
        assign(loaded->backend, coefficients, posed->pose.coefficients);
        assign(loaded->backend, transl, posed->pose.transl);
        posed->center = elements<vec3<float>, float>(pose.center, 0, 1)[0];
        loaded->avatar.pose(posed->pose, posed->center, view_of(out, loaded->avatar.size()), posed->cache);
        *pass = posed.release();
    });
}

int pose_avatar_backward(void* pass, const SplatInputs& dL, const PoseGradients& out) {
    return guarded([&] {
        auto& posed = *static_cast<PosedAvatar*>(pass);
        LoadedAvatar& loaded = *posed.owner;
        const std::size_t n = loaded.avatar.size();
        const SplatView<const float> dL_dsplats{
            elements<vec3<float>, float>(dL.means, 0, n), elements<sym3<float>, float>(dL.covars, 0, n),
            elements<float, float>(dL.opacities, 0, n), elements<vec3<float>, float>(dL.colors, 0, n)};
        const Rig<B>& rig = loaded.avatar.rig();
        const RigPoseGradient<float> dL_dpose{elements<vec3<float>, float>(out.pose, 0, rig.joint_count()),
                                              elements<float, float>(out.coefficients, 0, rig.coefficient_count()),
                                              elements<vec3<float>, float>(out.transl, 0, 1)};
        loaded.avatar.backward_to_pose(posed.pose, posed.center, dL_dsplats, posed.cache, dL_dpose,
                                       elements<vec3<float>, float>(out.center, 0, out.center ? 1 : 0));
    });
}

void release_posed(void* pass) {
    std::unique_ptr<PosedAvatar> posed(static_cast<PosedAvatar*>(pass));
    const std::shared_ptr<LoadedAvatar> owner = std::move(posed->owner); // the last to go
    const std::lock_guard lock(owner->mutex);
    if (owner->free.size() < 2) owner->free.push_back(std::move(posed));
}

void close_avatar(void* avatar) { delete static_cast<std::shared_ptr<LoadedAvatar>*>(avatar); }

} // namespace gsh_python
