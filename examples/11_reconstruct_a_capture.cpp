// SPDX-License-Identifier: Apache-2.0
/// @file  Story 11: a capture becomes an avatar, by the recipe of gsh-reconstruct: registration, light, training, figures.
///
/// 11-reconstruct-a-capture FOLDER films the built-in actor. 11-reconstruct-a-capture FOLDER CAPTURE BODY.npz takes a
/// capture of yours, at full size. Writes 11_avatar.gsh for gsh-view.
#include <gsh/cpu.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/reconstruct/judge.hpp>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/train.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <story.hpp>
using namespace gsh;

Capture small_film(cpu::Threads& backend, const BodyModel& body) {
    StudioParams studio;
    studio.image_size = 64, studio.train_cameras = 4, studio.samples = 4;
    return film(backend, body, actor_motion(ActorMotion::talk, 4), studio);
}

int main(int argc, char** argv) {
    return examples::tell(std::min(argc, 2), argv, [&](const std::filesystem::path& folder) {
        // 1. A capture and its body: yours, or a small film.
        const bool yours = argc > 3;
        cpu::Threads backend;
        BodyModel body = yours ? load_body_model(argv[3]) : make_actor({.edge_scale = 1.5});
        Capture capture = yours ? load_capture(backend, argv[2], body) : small_film(backend, body);

        // 2. The recipe: the default configuration, light. Poses are registered, and go on learning in training.
        Recipe recipe{.refine = true};
        if (!yours) recipe.steps = 100, recipe.gaussians = 1500;

        // 3. Everything before the first step, then the training. An Observer would show each stage.
        Reconstruction<cpu::Threads> person(backend, reconstruction_input(std::move(capture), std::move(body)), recipe);
        TrainingRecord record;
        train(person, recipe.length(), record,
              {.progress = [&](double share) { std::printf("\r%3.0f%%", 100 * share); }});
        person.fill_unseen();
        save_avatar(folder / "11_avatar.gsh", person.avatars()[0]);

        // 4. How good it is on the photographs that training did not see.
        person.refine_test_poses();
        Judge<cpu::Threads> judge(backend, *person.input());
        std::vector<ImageScore> scores;
        for (const Photo& photo : person.setup.test_photos)
            scores.push_back(judge.judge(person.compare(photo), photo).score);
        std::printf("\r%s\n", person.setup.light_text.c_str());
        examples::claim(mean_score(scores).psnr_person > 18, "the avatar has more than 18 dB on the person");
    });
}
