// SPDX-License-Identifier: Apache-2.0
/// @file  Story 7: gsh's trainer trains a part that gsh does not have. Every second frame of a capture is darker. The
/// part is a brightness factor per frame, in the place of the avatar's ambient occlusion. Training finds the factors.
#include <filmed_actor.hpp>
#include <gsh/backend/sum.hpp>
#include <gsh/model/shared_field.hpp>
#include <story.hpp>
using namespace gsh;
using Device = cpu::Threads; // another backend is a change of this line

// 1. The part: ao = exp(g[frame]) for every Gaussian. PlainOcclusion has the other calls of an occlusion policy.
struct Exposure : PlainOcclusion<Device> {
    Device* backend;
    LearnedBuffer<Device> g; // [frames]
    Device::Buffer<float> partials;

    Exposure(Device& where, std::size_t frames) : backend(&where), g(where, std::vector<float>(frames, 0)) {}
    void forward(const OcclusionInput<Device>& input, Span<float> ao) {
        const Span<const float> g_frame = g.values().subspan(input.frame, 1);
        backend->for_each(ao.size(), [=](std::size_t i) { ao[i] = std::exp(g_frame[0]); });
    }
    void backward(const OcclusionInput<Device>& input, Span<const float> ao, Span<float> dL_dao, Span<vec3<float>>) {
        backend->for_each(ao.size(), [=](std::size_t i) { dL_dao[i] *= ao[i]; }); // exp' = exp
        add_sum(*backend, Span<const float>(dL_dao), g.gradient().subspan(input.frame, 1), partials);
    }
    LearnedArrays<float> learned() { return {g.announce("exposure", 5e-3)}; }
};

void story(const std::filesystem::path&) {
    // 2. Four frames of the built-in actor. Frames 1 and 3 are darkened to 60%.
    Device backend;
    examples::FilmedActor actor(backend);
    Capture& capture = actor.capture;
    for (std::size_t image = 1; image < capture.images.size(); image += 2) // frames vary fastest
        for (std::size_t i = 0; i < capture.images[image].data.size(); ++i)
            if (std::uint8_t& byte = capture.images[image].data[i]; i % 4 < 3) byte = std::uint8_t(0.6 * byte + 0.5);

    // 3. The part above together with parts of gsh, and gsh's trainer.
    AvatarModel model(backend, actor.rig, actor.skin, actor.points, SharedField<Device>(backend, actor.points),
                      Exposure(backend, actor.motion.frame_count()), {.occlusion_start = 0});
    AvatarScene scene(backend, model, actor.motion);
    Trainer trainer(backend, scene, photos_of(capture, false), 1, {.gain = {}}); // no gains: the part does their work
    for (int step = 0; step < 200; ++step) trainer.step(step / 200.0);

    // 4. The result.
    const std::vector<float> g = downloaded(backend, model.occlusion().g.values());
    const double ratio = std::exp(0.5 * (g[1] + g[3] - g[0] - g[2]));
    examples::claim(std::abs(ratio - 0.6) < 0.05, "the factor of dark frames is 0.6, found " + std::to_string(ratio));
}

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
