// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/io/avatar_file.hpp>

#include "support/bodies.hpp"

#include <unistd.h>

#include <filesystem>
#include <limits>
#include <string>

using namespace gsh;

namespace {

AvatarData small_avatar() {
    const BodyModel body = test::tube(4, 6, 6);
    const std::vector<double> betas{0.3, -0.1};
    const auto samples = sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 2.0), 3);
    AvatarData avatar{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 2), ColorClamp::below};
    test::Rng rng(6);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        avatar.gaussians.means[i] = vec3<float>(samples.positions[i]);
        avatar.gaussians.log_scales[i] = vec3<float>(rng.vec(-4, -3));
        avatar.gaussians.opacity_logits[i] = static_cast<float>(rng.uniform(-1, 1));
    }
    for (auto& value : avatar.gaussians.sh) value = vec3<float>(rng.vec());
    return avatar;
}

std::filesystem::path temporary(const char* name) {
    return std::filesystem::temp_directory_path() / ("gsh-avatar-" + std::to_string(getpid()) + "-" + name);
}

template <class F>
std::string message_of(const F& work) {
    try {
        work();
    } catch (const Error& error) {
        return error.what();
    }
    return {};
}

} // namespace

TEST_CASE("an avatar comes back from its file as it was, and poses the same") {
    const AvatarData avatar = small_avatar();
    const auto path = temporary("round.gsh");
    save_avatar(path, avatar);
    const AvatarData back = load_avatar(path);
    CHECK(back.rig.betas == avatar.rig.betas);
    CHECK(back.rig.triangles == avatar.rig.triangles);
    CHECK(back.rig.skin.weights == avatar.rig.skin.weights);
    CHECK(back.gaussians.sh == avatar.gaussians.sh);
    CHECK(back.gaussians.opacity_logits == avatar.gaussians.opacity_logits);
    CHECK(back.clamping == ColorClamp::below);

    cpu::Serial backend;
    Motion motion = rest_motion(avatar.rig);
    test::Rng rng(2);
    motion.pose = rng.vecs(4);
    const auto posed = [&](const AvatarData& data) {
        const Avatar<cpu::Serial> shown(backend, data);
        RigPose<cpu::Serial, float> pose;
        shown.rig().upload_pose(motion, 0, pose);
        Splats<cpu::Serial, float> splats;
        splats.resize(shown.size());
        Avatar<cpu::Serial>::Cache cache;
        shown.pose(pose, {0, 0, 3}, splats.view(), cache);
        return std::vector<vec3<float>>(splats.means.begin(), splats.means.end());
    };
    CHECK(posed(back) == posed(avatar));
    std::filesystem::remove(path);
}

TEST_CASE("what cannot be an avatar is refused by name") {
    const auto path = temporary("bad.gsh");
    AvatarData avatar = small_avatar();
    avatar.gaussians.means[3].y = std::numeric_limits<float>::quiet_NaN();
    save_avatar(path, avatar);
    const std::string nan = message_of([&] { (void)load_avatar(path); });
    CHECK(nan.find("means[10]") != std::string::npos);
    CHECK(nan.find(path.string()) != std::string::npos);

    avatar = small_avatar();
    avatar.rig.skin.joints[0] = 4;
    save_avatar(path, avatar);
    CHECK(message_of([&] { (void)load_avatar(path); }).find("joint 4") != std::string::npos);

    avatar = small_avatar();
    avatar.gaussians.resize(avatar.gaussians.size() - 1, 2);
    CHECK_THROWS_AS(save_avatar(path, avatar), ShapeError);

    std::filesystem::resize_file(path, 1000);
    CHECK_THROWS_AS((void)load_avatar(path), IoError);
    std::filesystem::remove(path);
    CHECK_THROWS_AS((void)load_avatar(path), IoError);
}
