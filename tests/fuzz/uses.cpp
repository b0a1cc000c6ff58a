// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include "io/small_body.hpp"

#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/image.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace gsh::fuzz {

namespace {

constexpr int size = 64;

/// Pictures may be black or white, but must hold numbers.
void check_picture(const Image<float>& picture) {
    for (const float value : picture.data) must(std::isfinite(value), "a picture holds a number that is not finite");
}

Image<float> drawn(cpu::Serial& backend, const Camera<float>& camera, const SplatView<float>& splats,
                   const RasterParams<float>& params) {
    Image<float> picture(3, size, size);
    Rasterizer<cpu::Serial>::Cache cache;
    Rasterizer<cpu::Serial>(backend, params)
        .forward(camera, splats, {.color = vec3<float>(0.5f)}, {.color = picture.view()}, cache);
    return picture;
}

/// Of a size for which float arithmetic holds; others are not of this world.
bool is_of_this_world(const vec3<float>& point) {
    return std::max({std::abs(point.x), std::abs(point.y), std::abs(point.z)}) < 1e6f;
}

std::vector<vec3<double>> bent(std::size_t joints, double angle) {
    return std::vector<vec3<double>>(joints, vec3<double>(angle, 0.5 * angle, -angle));
}

} // namespace

const BodyModel& small_smplx() {
    static const BodyModel body = test::small_body(55, 3, 2, true);
    return body;
}
const BodyModel& small_smpl() {
    static const BodyModel body = test::small_body(24, 3, 0);
    return body;
}

void use(const GaussianCloud<float>& cloud) {
    cpu::Serial backend;
    Gaussians<cpu::Serial, float> gaussians;
    Splats<cpu::Serial, float> splats;
    upload(backend, cloud, gaussians);
    splats.resize(cloud.size());
    vec3<float> low(1e6f), high(-1e6f);
    for (const vec3<float>& mean : cloud.means)
        if (is_of_this_world(mean))
            for (int k = 0; k < 3; ++k) low[k] = std::min(low[k], mean[k]), high[k] = std::max(high[k], mean[k]);
    const vec3<float> center = low.x <= high.x ? 0.5f * (low + high) : vec3<float>(0);
    // At least so far that the eye is another point than the centre.
    const float least = 1e-2f + 1e-4f * length(center),
                reach = low.x <= high.x ? std::max(length(high - low), least) : 1;
    const auto camera = look_at<float>(center + vec3<float>(0, 0, 2 * reach), center, {0, 1, 0}, 0.7f, size, size);
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        StaticSplatsCache<cpu::Serial> cache;
        StaticSplats<cpu::Serial, degree()>(backend).forward(gaussians.view(), camera.center(), splats.view(), cache);
    });
    check_picture(drawn(backend, camera, splats.view(), {}));
}

void use(const BodyModel& body) {
    for (const double angle : {0.0, 0.3}) {
        const PosedBody posed = pose_body(body, bent(body.joint_count(), angle));
        for (const auto& points : {posed.joints, posed.vertices})
            for (const vec3<double>& p : points)
                must(std::isfinite(p.x + p.y + p.z), "a posed body has a point that is not finite");
    }
}

void use(const Motion& motion, const BodyModel& body) {
    validate(motion, body, "fuzz");
    must(motion.frame_count() > 0, "a motion has no frames");
    for (const std::size_t frame : {std::size_t(0), motion.frame_count() - 1}) {
        for (const vec3<double>& joint :
             pose_body(body, motion.pose_at(frame), motion.transl[frame], motion.betas).joints)
            must(std::isfinite(joint.x + joint.y + joint.z), "a posed joint is not finite");
    }
}

void use(const AvatarData& data) {
    cpu::Serial backend;
    const Avatar<cpu::Serial> avatar(backend, data);
    const std::size_t joints = data.rig.body.joint_count();
    Motion motion;
    motion.joint_count = joints, motion.betas = data.rig.betas;
    for (const double angle : {0.0, 0.3})
        for (const vec3<double>& turn : bent(joints, angle)) motion.pose.push_back(turn);
    motion.transl.assign(2, vec3<double>(0)), motion.timestamps = {0, 0.1};
    Splats<cpu::Serial, float> splats;
    splats.resize(avatar.size());
    for (const std::size_t frame : {0u, 1u}) {
        RigPose<cpu::Serial, float> pose;
        Avatar<cpu::Serial>::Cache cache;
        avatar.rig().upload_pose(motion, frame, pose);
        const auto camera = look_at<float>({0, 1, 3}, {0, 1, 0}, {0, 1, 0}, 0.9f, size, size);
        avatar.pose(pose, camera.center(), splats.view(), cache);
        check_picture(drawn(backend, camera, splats.view(), raster_params<float>(data.filter)));
    }
}

void check_warnings(const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings) {
        std::string_view rest = warning;
        while (!rest.empty()) {
            const std::size_t length = detail::printable_length(rest);
            must(length > 0, "a warning is not printable");
            rest.remove_prefix(length);
        }
        must(warning.size() <= 2000, "a warning is too long to be read");
    }
}

} // namespace gsh::fuzz
