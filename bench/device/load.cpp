// SPDX-License-Identifier: Apache-2.0
#include "load.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <nlohmann/json.hpp>

#include <fstream>
#include <utility>

namespace gsh::bench {

CloudLoad read_cloud_load(const std::string& ply, const std::string& cameras) {
    CloudLoad load;
    std::ifstream file(cameras);
    if (!file) throw IoError(cameras + ": cannot be read");
    try {
        for (const nlohmann::json& entry : nlohmann::json::parse(file)) {
            Camera<float> camera;
            camera.width = entry.at("width"), camera.height = entry.at("height");
            camera.fx = entry.at("fx"), camera.fy = entry.at("fy");
            camera.cx = entry.at("cx"), camera.cy = entry.at("cy");
            for (std::size_t row = 0; row < 3; ++row) {
                const nlohmann::json& numbers = entry.at("world_to_camera").at(row);
                for (std::size_t column = 0; column < 3; ++column)
                    camera.R[static_cast<int>(column)][static_cast<int>(row)] = numbers.at(column);
                camera.t[static_cast<int>(row)] = numbers.at(3);
            }
            load.cameras[std::to_string(camera.width)].push_back(camera);
        }
    } catch (const nlohmann::json::exception& error) {
        throw ValueError(cameras + ": " + error.what());
    }
    if (load.cameras.empty()) throw ValueError(cameras + ": has no camera");

    cpu::Threads backend;
    const GaussianCloud<float> cloud = read_gaussian_ply(ply);
    const std::size_t n = cloud.size();
    load.means.resize(n), load.colors.resize(n), load.covariances.resize(n), load.opacities.resize(n);
    Gaussians<cpu::Threads, float> gaussians;
    upload(backend, cloud, gaussians);
    StaticSplatsCache<cpu::Threads> cache;
    const SplatView<float> splats{load.means, load.covariances, load.opacities, load.colors};
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        StaticSplats<cpu::Threads, decltype(degree)::value>(backend).forward(
            std::as_const(gaussians).view(), load.cameras.begin()->second[0].center(), splats, cache);
    });
    return load;
}

AvatarData make_avatar_load(std::size_t gaussians, AvatarKind kind) {
    BodyModel body = make_actor();
    Rng rng(1);
    if (kind == AvatarKind::pose_directions) {
        body.posedirs.resize(body.vertex_count() * body.pose_feature_count());
        for (vec3<double>& direction : body.posedirs)
            for (int c = 0; c < 3; ++c) direction[c] = 0.001 * rng.normal();
    }
    const std::vector<double> betas(static_cast<std::size_t>(body.shape_count), 0.0);
    const double share = static_cast<double>(gaussians) / static_cast<double>(body.vertex_count());
    const SurfaceSamples samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), share), 1);
    AvatarData data{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 2)};
    for (std::size_t i = 0; i < samples.size(); ++i) {
        data.gaussians.means[i] = vec3<float>(samples.positions[i]);
        const quat<double> q{rng.normal(), rng.normal(), rng.normal(), rng.normal()};
        const quat<double> turn = normalize(q);
        data.gaussians.quats[i] = {float(turn.w), float(turn.x), float(turn.y), float(turn.z)};
        for (int k = 0; k < 3; ++k) data.gaussians.log_scales[i][k] = static_cast<float>(-6 + 0.4 * rng.normal());
        data.gaussians.opacity_logits[i] = static_cast<float>(rng.uniform(-1, 5));
    }
    for (vec3<float>& band : data.gaussians.sh)
        for (int c = 0; c < 3; ++c) band[c] = static_cast<float>(0.2 * rng.normal());
    if (kind == AvatarKind::light) data.light = even_light(4, 12, {0, 0, 0}, 4);
    return data;
}

TrainingLoad make_training_load(const Configuration& configuration, std::size_t gaussians, int size) {
    TrainingLoad load;
    load.configuration = configuration;
    cpu::Threads backend;
    const BodyModel actor = make_actor();
    StudioParams studio;
    studio.image_size = size, studio.samples = 1;
    Capture capture = film(backend, actor, actor_motion(ActorMotion::stride, 6), studio);
    load.setup = make_canonical_setup(backend, actor, capture.motion, configuration, gaussians, 1);
    if (configuration.avatar.light)
        load.light = even_light(static_cast<std::size_t>(configuration.avatar.light_points),
                                static_cast<std::size_t>(configuration.avatar.light_directions), {0, 0, 0}, 4);
    load.photos = photos_of(capture, false);
    for (Photo& photo : load.photos) load.pixels.push_back(crop_photo(photo)); // the capture ends here
    return load;
}

} // namespace gsh::bench
