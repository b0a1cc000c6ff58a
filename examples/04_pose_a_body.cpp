// SPDX-License-Identifier: Apache-2.0
/// @file  Story 4: Gaussians on a body follow its bones.
///
/// A procedural actor gets 40,000 Gaussians on its skin, each in the colour of the bone with the largest weight. A
/// motion poses them. Their positions are compared with those on the posed mesh, which other code computes. Writes
/// 04_pose_a_body.png: rest | pose.
#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <story.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <vector>

using namespace gsh;

namespace {

using Backend = cpu::Threads;

// One colour per bone; neighbours have very different hues. Light from above and the front is baked in.
vec3<float> bone_color(std::size_t bone, const vec3<double>& normal) {
    const double hue = 2.4 * static_cast<double>(bone), light = 0.65 + 0.35 * dot(normal, {0.4, 0.7, 0.6});
    const vec3<double> wheel(std::cos(hue), std::cos(hue - 2.1), std::cos(hue + 2.1));
    return vec3<float>(light * (0.6 + 0.35 * wheel));
}

// 1. Gaussians on the skin: flat discs whose size follows from the sampling, nearly opaque, with one colour from all
//    sides (SH of degree 0).
GaussianCloud<float> dress(const SurfaceSamples& skin) {
    GaussianCloud<float> cloud(skin.size(), 0);
    for (std::size_t i = 0; i < skin.size(); ++i) {
        const std::size_t heaviest = skin.weights.joints[i * skin.weights.influences]; // sorted, largest first
        cloud.means[i] = vec3<float>(skin.positions[i]);
        const vec3<float> n(skin.normals[i].z < 0 ? -skin.normals[i] : skin.normals[i]); // a disc has no front
        cloud.quats[i] = {1 + n.z, -n.y, n.x, 0};                                        // rotates z to n
        const float scale = static_cast<float>(skin.scales[i]);
        cloud.log_scales[i] = {std::log(scale), std::log(scale), std::log(0.2f * scale)};
        cloud.opacity_logits[i] = logit(0.9f);
        cloud.sh[i] = sh_of_color(bone_color(heaviest, skin.normals[i]));
    }
    return cloud;
}

// 2. The steps that show an avatar: upload a pose, compute splats, rasterize an image.
class Stage {
public:
    Stage(Backend& backend, const AvatarData& data) : backend_(backend), avatar_(backend, data), rasterizer_(backend) {
        splats_.resize(avatar_.size());
    }

    Image<float> show(const Motion& motion, std::size_t frame, const Camera<float>& camera) {
        avatar_.rig().upload_pose(motion, frame, pose_);
        avatar_.pose(pose_, camera.center(), splats_.view(), avatar_cache_);
        Image<float> image(3, camera.height, camera.width);
        rasterizer_.forward(camera, splats_.view(), {.color = vec3<float>(1)}, {.color = image.view()}, raster_cache_);
        return image;
    }

    /// The positions of the Gaussians that were shown last.
    [[nodiscard]] std::vector<vec3<float>> means() {
        return downloaded(backend_, Span<const vec3<float>>(splats_.means));
    }

private:
    Backend& backend_;
    Avatar<Backend> avatar_;
    Rasterizer<Backend> rasterizer_;
    RigPose<Backend, float> pose_;
    Splats<Backend, float> splats_;
    Avatar<Backend>::Cache avatar_cache_;
    Rasterizer<Backend>::Cache raster_cache_;
};

// 3. The distance of each Gaussian, in metres, from its expected position: its place in its triangle of the posed mesh.
struct Distance {
    double mean = 0, most = 0;
};

Distance off_the_mesh(const std::vector<vec3<float>>& means, const SurfaceSamples& skin,
                      Span<const vec3<double>> mesh) {
    Distance off;
    for (std::size_t i = 0; i < means.size(); ++i) {
        vec3<double> expected(0);
        for (int corner = 0; corner < 3; ++corner)
            expected += skin.barycentric[i][corner] *
                        mesh[static_cast<std::size_t>(skin.triangles[i][static_cast<std::size_t>(corner)])];
        const double distance = length(vec3<double>(means[i]) - expected);
        off.mean += distance / static_cast<double>(means.size());
        off.most = std::max(off.most, distance);
    }
    return off;
}

void story(const std::filesystem::path& folder) {
    // 4. A body, samples of its skin (evenly by area), and the rig that moves the samples.
    const BodyModel body = make_actor({.edge_scale = 1.4});
    const std::vector<double> betas(static_cast<std::size_t>(body.shape_count), 0.0);
    const std::vector<vec3<double>> vertices = shaped_vertices(body, betas);
    const std::vector<double> one_each(body.vertex_count(), 1.0);
    const SurfaceSamples skin = sample_surface(body, vertices, one_each, 4, {.total = 40000});
    const AvatarData data{make_rig(body, betas, skin), dress(skin)};
    std::printf("%zu vertices, %zu joints, %zu Gaussians\n", body.vertex_count(), body.joint_count(), skin.size());

    // 5. Two frames of a motion: the rest pose (all zeros, arms spread) and a dance step.
    Motion motion = actor_motion(ActorMotion::stride, 8);
    std::fill_n(motion.pose.begin(), motion.joint_count, vec3<double>(0));
    std::fill_n(motion.expression.begin(), motion.expression_count, 0.0);
    motion.transl[0] = vec3<double>(0);
    constexpr std::size_t rest = 0, step = 3;

    Backend backend;
    Stage stage(backend, data);
    const Camera<float> camera = frame_sphere(vec3<float>(0, -0.08f, 0), 0.95f, vec3<float>(0.45f, 0.15f, 1),
                                              vec3<float>(0, 1, 0), 0.5f, 400, 400);
    const Image<float> rest_image = stage.show(motion, rest, camera);
    const Distance rest_off = off_the_mesh(stage.means(), skin, vertices);
    const Image<float> step_image = stage.show(motion, step, camera);
    const PosedBody posed =
        pose_body(body, motion.pose_at(step), motion.transl[step], betas, motion.expression_at(step));
    const Distance step_off = off_the_mesh(stage.means(), skin, posed.vertices);
    write_png(folder / "04_pose_a_body.png", examples::beside<float>({&rest_image, &step_image}));

    // 6. In the rest pose nothing moves. In other poses, a Gaussian and the corners of its triangle have different
    //    blends of bones. At the joints the results differ, on this coarse mesh by millimetres.
    std::printf("distance from the mesh: at most %.4f mm at rest; mean %.3f mm in the pose, at most %.1f mm\n",
                1e3 * rest_off.most, 1e3 * step_off.mean, 1e3 * step_off.most);
    examples::claim(rest_off.most < 1e-5, "the rest pose moves nothing");
    examples::claim(step_off.mean < 2e-4 && step_off.most < 5e-3, "posed Gaussians stay on the posed mesh");
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
