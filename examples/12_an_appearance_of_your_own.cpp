// SPDX-License-Identifier: Apache-2.0
/// @file  Story 12: an avatar whose colours come from an appearance that gsh does not have. It has one colour for each
/// joint's part of the body, and no displacements. gsh's model and trainer do the rest.
#include <filmed_actor.hpp>
#include <story.hpp>
using namespace gsh;
using Device = cpu::Threads; // another backend is a change of this line
using Vec = vec3<float>;

// 1. The appearance. forward copies a part's colour to each of its Gaussians, and backward adds up what they ask for.
struct Palette {
    static constexpr int sh_degree = 0;
    Device* backend;
    LearnedBuffer<Device, Vec> colors;  // [parts], coefficients of constant colours
    Device::Buffer<std::uint32_t> part; // [N]
    Device::Buffer<Vec> sh, dL_dsh, displacements;

    Palette(Device& where, std::size_t parts, const std::vector<std::uint32_t>& part_of)
        : backend(&where), colors(where, std::vector<Vec>(parts, Vec(0))), part(uploaded(where, part_of)),
          sh(part.size()), dL_dsh(part.size()), displacements(part.size()) {
        where.fill(Span<Vec>(displacements), Vec(0));
    }
    void forward(std::size_t /*frame*/) {
        backend->for_each(sh.size(), [to = Span<Vec>(sh), of = Span<const std::uint32_t>(part),
                                      from = colors.values()](std::size_t i) { to[i] = from[of[i]]; });
    }
    AppearanceView<float> view() const { return {sh, 1, displacements}; }
    ColorGradient<float> color_gradient() {
        backend->fill(Span<Vec>(dL_dsh), Vec(0));
        return {dL_dsh, 1};
    }
    void backward(std::size_t /*frame*/, Span<Vec> /*dL_dmeans*/) {
        backend->for_each(colors.size(), [of = Span<const std::uint32_t>(part), from = Span<const Vec>(dL_dsh),
                                          to = colors.gradient()](std::size_t p) {
            for (std::size_t i = 0; i < of.size(); ++i) to[p] += of[i] == p ? from[i] : Vec(0);
        });
    }
    LearnedArrays<float> learned() { return {colors.announce("palette", 5e-2)}; }
    bool reads_time() const { return false; }
};

void story(const std::filesystem::path&) {
    // 2. The part of a point is that of its heaviest joint, the first in the table of weights.
    Device backend;
    const examples::FilmedActor actor(backend);
    std::vector<std::uint32_t> part;
    for (std::size_t i = 0; i < actor.skin.size(); ++i)
        part.push_back(actor.skin.weights.joints[i * actor.skin.weights.influences]);
    // 3. The model with this appearance, trained by gsh's trainer.
    AvatarModel model(backend, actor.rig, actor.skin, actor.points, Palette(backend, actor.body.joint_count(), part));
    AvatarScene scene(backend, model, actor.motion);
    Trainer trainer(backend, scene, photos_of(actor.capture, false), 1);
    for (int step = 0; step < 300; ++step) trainer.step(step / 300.0);
    const double found = trainer.last_psnr();
    examples::claim(found > 20, "one colour a joint: PSNR " + std::to_string(found) + " dB, expected above 20 dB");
}

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
