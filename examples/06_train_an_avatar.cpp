// SPDX-License-Identifier: Apache-2.0
/// @file  Story 6: a pipeline of parts trains an avatar from photographs of a moving person.
///
/// A field gives colours and displacements of Gaussians on the body. A rig poses them, a rasterizer renders them, a
/// loss compares the render with one of 48 photographs, and Adam updates the learned arrays. The seventh camera is held
/// out. Writes 06_train_an_avatar.png, a view of that camera: truth | start | end.
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/image/color.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/schedule.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <story.hpp>
using namespace gsh;
using examples::numbers, examples::on_host;

namespace {

using B = cpu::Threads; // the backend: another one is a change of this line
template <class T>
using Buffer = B::Buffer<T>;
using Vec = vec3<float>;
using Field = HashField<12, 2>; // 12 levels with 2 numbers each
constexpr int degree = 1, size = 192, steps = 800;
constexpr std::size_t count = 10000, basis = sh_basis_count(degree), stride = basis + 1; // a row of the field: SH, δx

// 1. A part of the program's own: x₀ + δx, and its adjoint. δx is in cm, so that all field outputs are of order one.
struct Displace {
    Span<const Vec> points, rows;
    Span<Vec> means;
    GSH_HD void operator()(std::size_t i) const { means[i] = points[i] + 0.01f * rows[i * stride + basis]; }
};
struct DisplaceBackward {
    Span<const Vec> dL_dmeans;
    Span<Vec> dL_drows;
    GSH_HD void operator()(std::size_t i) const { dL_drows[i * stride + basis] += 0.01f * dL_dmeans[i]; }
};

void story(const std::filesystem::path& folder) {
    // 2. A capture (rendered on the CPU), samples of the body's surface (denser on face and hands), and their rig.
    cpu::Threads studio;
    const BodyModel body = make_actor({.edge_scale = 1.5});
    const Motion motion = actor_motion(ActorMotion::talk, 8);
    const Capture capture = film(studio, body, motion, {.image_size = size, .samples = 9, .light = {}});
    const std::vector<vec3<double>> vertices = shaped_vertices(body, motion.betas);
    const RegionMask mask = region_mask(body, vertices);
    const SurfaceSamples skin = sample_surface(body, vertices, mask.samples_per_vertex(), 1, {.total = count});
    const RigData rig_data = make_rig(body, motion.betas, skin);

    // 3. The initial Gaussians: discs on the skin, with a tenth of their width as thickness.
    std::vector<Vec> start(skin.positions.begin(), skin.positions.end()), in_cube, discs;
    for (const Vec& p : start) in_cube.push_back(0.5f * p + Vec(0.5f)); // the actor is within a metre of the origin
    for (const double s : skin.scales) discs.push_back(Vec(std::log(float(s))) + Vec(0, 0, std::log(0.1f)));
    std::vector<quat<float>> turns;
    for (const vec3<double>& normal : skin.normals) turns.push_back(quat_from_z_axis(Vec(normal)));
    const std::vector<double> tau = mask.at(skin);

    // 4. The parts and the learned arrays. The mask restricts the fine levels of the field to face and hands.
    B backend;
    const Field field({.base = 4, .growth = 1.6, .table_size = 1u << 15}, {.outputs = 3 * stride});
    Field::Query<B> query;
    field.prepare(backend, uploaded(backend, in_cube), query,
                  {.fine_level = 9, .region = uploaded<B, float>(backend, {tau.begin(), tau.end()})});
    Rig<B> rig(backend, rig_data);
    const SkinnedSplats<B, degree> skinning(backend);
    const Rasterizer<B> rasterizer(backend, raster_params<float>({.dilation = 0.1, .compensate_opacity = true}));
    const PhotometricLoss<B> loss(backend);
    LearnedBuffer table(backend, field.grid().initial_table<float>(1));
    LearnedBuffer weights(backend, field.mlp().initial_weights<float>(2));
    LearnedBuffer opacity_logits(backend, std::vector<float>(count, 0)); // half transparent
    LearnedBuffer<B, Vec> log_scales(backend, discs), joints(backend, {rig_data.joints.begin(), rig_data.joints.end()});
    LearnedBuffer quats(backend, turns);

    // 5. Intermediate values between the parts, and their gradients.
    const Buffer<Vec> points = uploaded(backend, start);
    Buffer<Vec> rows(count * stride), dL_drows(count * stride), means(count), dL_dmeans(count);
    const SkinnedView<const float> gaussians{
        means, quats.values(), log_scales.values(), opacity_logits.values(), rows, {}, rig.skin(), stride};
    const SkinnedView<float> dL_dgaussians{
        dL_dmeans, quats.gradient(), log_scales.gradient(), opacity_logits.gradient(), dL_drows, {}, {}, stride};
    Buffer<Affine<float>> dL_dbones(rig.joint_count());
    Splats<B> splats, dL_dsplats;
    splats.resize(count), dL_dsplats.resize(count);
    Buffer<std::uint8_t> rgba(4 * size * size);
    Buffer<float> photo_planes(3 * size * size), render_planes(3 * size * size), gradient_planes(3 * size * size);
    const ImageView<float> photo{photo_planes, 3, size, size}, render{render_planes, 3, size, size},
        dL_drender{gradient_planes, 3, size, size};
    const Background<float> white{.color = Vec(1)};
    Camera<float> camera;
    RigPose<B> pose;
    Field::Cache<B> field_cache;
    Rig<B>::Cache rig_cache;
    SkinnedSplats<B, degree>::Cache skin_cache;
    Rasterizer<B>::Cache raster_cache;
    PhotometricLoss<B>::Cache loss_cache;

    // 6. Forwards in order: from a view's photograph (over white), camera and pose to the loss of the render.
    const auto forward = [&](const CaptureView& view) {
        camera = capture.cameras[view.camera].camera.cast<float>();
        rig.upload_pose(motion, view.frame, pose);
        backend.upload(Span<const std::uint8_t>(capture.image(view).data), rgba);
        composite_rgba8(backend, rgba, size, size, white.color, photo);
        field.forward(backend, table.values(), weights.values(), query, numbers(rows), field_cache);
        backend.for_each(count, Displace{points, rows, means});
        rig.forward(pose, joints.values(), rig_cache);
        rig.add_offsets(rig_cache, means);
        skinning.forward(gaussians, rig_cache.bones, camera.center(), splats.view(), skin_cache);
        rasterizer.forward(camera, splats.view(), white, {.color = render}, raster_cache);
        loss.forward(render, photo, loss_cache);
    };
    // 7. Backwards in reverse. Adjoints add to their outputs, so the gradients between parts start at zero.
    const auto backward = [&] {
        fill_zero(backend, dL_dsplats.view()), backend.fill(dL_drender.data, 0.0f);
        for (auto sum : {numbers(dL_drows), numbers(dL_dmeans), numbers(dL_dbones)}) backend.fill(sum, 0.0f);
        loss.backward(render, photo, 1.0f, loss_cache, dL_drender);
        rasterizer.backward(camera, splats.view(), white, {.color = dL_drender}, raster_cache, dL_dsplats.view());
        skinning.backward(gaussians, rig_cache.bones, camera.center(), dL_dsplats.view(), skin_cache, dL_dgaussians,
                          dL_dbones);
        rig.backward(pose, rig_cache, dL_dbones, dL_dmeans, joints.gradient());
        backend.for_each(count, DisplaceBackward{dL_dmeans, dL_drows});
        field.backward(backend, weights.values(), query, numbers(dL_drows), field_cache, table.gradient(),
                       weights.gradient());
    };

    // 8. Training: each step takes one photograph and updates every array at its own rate, which decreases.
    const std::vector<CaptureView> lessons = capture.views(false), exam = capture.views(true);
    forward(exam[0]);
    const Image<float> truth = on_host(backend, photo), before = on_host(backend, render);
    for (int step = 1; step <= steps; ++step) {
        forward(lessons[random_bits(3, static_cast<std::uint64_t>(step)) % lessons.size()]);
        backward();
        if (step % 100 == 0) std::printf("step %d: loss %.4f\n", step, loss.values(loss_cache).loss);
        const double pace = Schedule::exponential(1, 0.05, steps).rate(step);
        for (const auto& array : {table.announce("table", 1e-2), weights.announce("weights", 3e-3),
                                  opacity_logits.announce("opacities", 5e-2), joints.announce("joints", 5e-4),
                                  log_scales.announce("log_scales", 1e-2), quats.announce("quats", 1e-3)})
            take_step(backend, Adam(), array, pace, step); // the gradient is zero afterwards
    }

    // 9. The held-out view.
    forward(exam[0]);
    const Image<float> after = on_host(backend, render);
    const double decibels = psnr(after.view(), truth.view());
    write_png(folder / "06_train_an_avatar.png", examples::beside<float>({&truth, &before, &after}));
    examples::claim(decibels > 32, "held-out view: PSNR " + std::to_string(decibels) + " dB, expected above 32 dB");
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
