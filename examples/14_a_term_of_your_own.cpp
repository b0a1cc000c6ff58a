// SPDX-License-Identifier: Apache-2.0
/// @file  Story 14: a term of the loss that gsh does not have. Gaussians that are wider than 15 mm show as spikes in new
/// poses. The term w/N Σ max(0, log s - log 15 mm)² keeps the three widths of each Gaussian below that.
#include <filmed_actor.hpp>
#include <gsh/model/shared_field.hpp>
#include <gsh/photo/loss_term.hpp>
#include <story.hpp>
using namespace gsh;
using Device = cpu::Threads; // another backend is a change of this line

// 1. The term adds its gradient to that of the model's widths. A term of the pose would add to dL_dpose instead.
struct NoSpikes final : LossTerm<Device> {
    static constexpr float weight = 1;
    Device* backend;
    LearnedArray<float> log_scales; // of the model
    float limit = std::log(0.015f);

    NoSpikes(Device& where, LearnedArray<float> of_model) : backend(&where), log_scales(std::move(of_model)) {}
    void backward(std::size_t, const RigPose<Device>&, const RigPoseGradient<float>&) override {
        const float scale = 2 * weight / float(log_scales.values.size() / 3);
        backend->for_each(log_scales.values.size(),
                          [s = log_scales.values, dL_ds = log_scales.gradient, scale, at = limit](std::size_t i) {
                              dL_ds[i] += s[i] > at ? scale * (s[i] - at) : 0.0f;
                          });
    }
};

void story(const std::filesystem::path&) {
    // 2. An actor of 1000 Gaussians, which are wide, is trained without and with the term.
    Device backend;
    const examples::FilmedActor actor(backend, 1000);
    const auto share_of_wide = [&](bool with_term) {
        AvatarModel model(backend, actor.rig, actor.skin, actor.points, SharedField<Device>(backend, actor.points),
                          NoOcclusion<Device>(), {.log_scale_rate = 2e-2});
        AvatarScene scene(backend, model, actor.motion);
        NoSpikes term(backend, model.learned()[2]);
        if (with_term) scene.add(term);
        Trainer trainer(backend, scene, photos_of(actor.capture, false), 1);
        for (int step = 0; step < 200; ++step) trainer.step(step / 200.0);
        const Span<float> widths = term.log_scales.values;
        const auto is_wide = [&](float s) { return s > term.limit + 0.1f; };
        return double(std::count_if(widths.begin(), widths.end(), is_wide)) / double(widths.size());
    };
    const double without = share_of_wide(false), with = share_of_wide(true);
    examples::claim(without > 0.2 && with < 0.02, "widths above 16.5 mm: " + std::to_string(without) + " of all, " +
                                                      std::to_string(with) + " with the term");
}

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
