// SPDX-License-Identifier: Apache-2.0
/// Each allocation fails in turn while a person is registered, reconstructed and judged, and while a checkpoint is
/// written and read.
#include <gsh/cpu.hpp>
#include <gsh/reconstruct/judge.hpp>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/register_people.hpp>
#include <gsh/reconstruct/resume.hpp>
#include <gsh/reconstruct/train.hpp>

#include "failures/failing_allocations.hpp"
#include "io/temporary.hpp"
#include "reconstruct/small_people.hpp"

#include <memory>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

using Person = Reconstruction<cpu::Serial>;

std::vector<float> numbers_of(AnyReconstruction& person) {
    const AvatarData avatar = person.avatars().at(0);
    std::vector<float> all = avatar.gaussians.opacity_logits;
    for (const auto& v : avatar.gaussians.sh) all.insert(all.end(), {v.x, v.y, v.z});
    return all;
}

} // namespace

TEST_CASE("memory runs out while a person is registered, reconstructed and judged") {
    cpu::Serial backend;
    Recipe recipe = test::small_recipe(2);
    recipe.refine = true;
    const ReconstructionInput input = test::small_input();
    test::Exhausted sum = test::exhaust(
        "registration", [&] { return std::make_unique<ReconstructionInput>(input); },
        [&](const auto& people) {
            if (!people->registration) register_people(backend, *people, recipe);
            return people->people[0].motion.pose;
        },
        {.first = 1, .sample = 2});
    recipe.registration = false;
    sum += test::exhaust("a reconstruction",
                         [&] {
                             Person person(backend, test::small_input(), recipe);
                             TrainingRecord record;
                             train(person, recipe.length(), record);
                             return numbers_of(person);
                         },
                         {.first = 1, .sample = 3});
    Person person(backend, test::small_input(), recipe);
    TrainingRecord record;
    train(person, recipe.length(), record);
    sum += test::exhaust("judging",
                         [&] {
                             Judge<cpu::Serial> judge(backend, input);
                             const Photo& photo = person.setup.test_photos.at(0);
                             const ImageScore score = judge.judge(person.compare(photo), photo).score;
                             return std::vector<double>{score.psnr, score.ssim, score.psnr_person};
                         },
                         {.first = 3, .sample = 4});
    test::report("reconstruction", sum);
}

TEST_CASE("memory runs out while a checkpoint is written and read") {
    cpu::Serial backend;
    const Recipe recipe = test::small_recipe(2);
    Person person(backend, test::small_input(), recipe), later(backend, test::small_input(), recipe);
    TrainingRecord record;
    train(person, recipe.length(), record);
    const test::Temporary folder;
    const auto path = folder / "checkpoint.gsh";
    test::Exhausted sum = test::exhaust("writing a checkpoint",
                                        [&] {
                                            save_checkpoint(path, person, record);
                                            test::allocations::end();
                                            return read_file(path);
                                        },
                                        {.first = 8, .sample = 8});
    sum += test::exhaust("reading a checkpoint",
                         [&] {
                             std::string damage;
                             const TrainingRecord read = load_checkpoint(whole_checkpoint(path, damage), later);
                             test::allocations::end();
                             return std::pair(read.steps, damage.empty());
                         },
                         {.first = 8, .sample = 8});
    CHECK(numbers_of(later) == numbers_of(person));
    test::report("checkpoints", sum);
}
