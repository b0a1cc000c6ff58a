// SPDX-License-Identifier: Apache-2.0
#include "load.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
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
    load.cloud = read_gaussian_ply(ply);
    const std::size_t n = load.cloud.size();
    load.means.resize(n), load.colors.resize(n), load.covariances.resize(n), load.opacities.resize(n);
    Gaussians<cpu::Threads, float> gaussians;
    upload(backend, load.cloud, gaussians);
    StaticSplatsCache<cpu::Threads> cache;
    const SplatView<float> splats{load.means, load.covariances, load.opacities, load.colors};
    with_sh_degree(load.cloud.sh_degree, [&](auto degree) {
        StaticSplats<cpu::Threads, decltype(degree)::value>(backend).forward(
            std::as_const(gaussians).view(), load.cameras.begin()->second[0].center(), splats, cache);
    });
    return load;
}

void write_cloud_load(const std::string& ply, const std::string& cameras, const SplatView<const float>& splats,
                      const std::vector<Camera<float>>& views) {
    nlohmann::json list = nlohmann::json::array();
    for (const Camera<float>& camera : views) {
        const vec3<float> center = camera.center();
        nlohmann::json to_camera = nlohmann::json::array(), to_world = nlohmann::json::array();
        for (int i = 0; i < 3; ++i) {
            to_camera.push_back({camera.R[0][i], camera.R[1][i], camera.R[2][i], camera.t[i]});
            to_world.push_back({camera.R[i][0], camera.R[i][1], camera.R[i][2]});
        }
        to_camera.push_back({0, 0, 0, 1});
        list.push_back({{"id", list.size()},
                        {"img_name", "v" + std::to_string(list.size()) + "_" + std::to_string(camera.width)},
                        {"width", camera.width},
                        {"height", camera.height},
                        {"fx", camera.fx},
                        {"fy", camera.fy},
                        {"cx", camera.cx},
                        {"cy", camera.cy},
                        {"position", {center.x, center.y, center.z}},
                        {"rotation", to_world},
                        {"world_to_camera", to_camera},
                        {"znear", 0.1},
                        {"zfar", 100},
                        {"background", {0, 0, 0}}});
    }
    write_file(cameras, list.dump(1) + "\n");

    GaussianCloud<float> cloud(splats.size(), 0);
    for (std::size_t i = 0; i < splats.size(); ++i) {
        const sym3<float>& c = splats.covariances[i];
        // Axes of C Cᵀ are those of C, and lengths along them are the squares of the scales.
        const auto axes = principal_axes(mat3<double>(vec3<double>(c.xx, c.xy, c.xz), vec3<double>(c.xy, c.yy, c.yz),
                                                      vec3<double>(c.xz, c.yz, c.zz)));
        const quat<double> q = quat_from_rotation(axes.R);
        cloud.means[i] = splats.means[i];
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        for (int k = 0; k < 3; ++k)
            cloud.log_scales[i][k] = static_cast<float>(0.5 * std::log(std::max(axes.lengths[k], 1e-12)));
        cloud.opacity_logits[i] = std::log(splats.opacities[i] / (1 - splats.opacities[i]));
        cloud.sh[i] = sh_of_color(splats.colors[i]);
    }
    write_gaussian_ply(ply, std::move(cloud), {.pad_to_degree = 0});
}

AvatarData make_avatar_load(std::size_t gaussians, AvatarKind kind) {
    BodyModel body = make_actor({.edge_scale = 1.264}); // about as many vertices as SMPL-X has, 10,475
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
        load.light = even_light(static_cast<std::size_t>(configuration.avatar.lights.points),
                                static_cast<std::size_t>(configuration.avatar.lights.directions), {0, 0, 0}, 4);
    load.photos = photos_of(capture, false);
    for (Photo& photo : load.photos) load.pixels.push_back(crop_photo(photo)); // the capture ends here
    return load;
}

} // namespace gsh::bench
