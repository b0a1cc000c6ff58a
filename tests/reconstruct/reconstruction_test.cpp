// SPDX-License-Identifier: Apache-2.0
/// A capture becomes an avatar by the library alone: stages, stops, checkpoints, another backend, several people.
#include "io/temporary.hpp"
#include "reconstruct/small_people.hpp"
#include "support/contains.hpp"
#include "support/guarded.hpp"

#include <gsh/core/error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/resume.hpp>
#include <gsh/reconstruct/train.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::small_input;
using test::small_recipe;
using Threads = Reconstruction<cpu::Threads>;

namespace {

void check_same(AnyReconstruction& a, AnyReconstruction& b) {
    const std::vector<AvatarData> of_a = a.avatars(), of_b = b.avatars();
    REQUIRE(of_a.size() == of_b.size());
    for (std::size_t p = 0; p < of_a.size(); ++p) {
        CHECK(of_a[p].gaussians.means == of_b[p].gaussians.means);
        CHECK(of_a[p].gaussians.sh == of_b[p].gaussians.sh);
        CHECK(of_a[p].gaussians.opacity_logits == of_b[p].gaussians.opacity_logits);
        REQUIRE(of_a[p].light.has_value());
        CHECK(of_a[p].light->log_intensities == of_b[p].light->log_intensities);
    }
    const Photo& photo = a.setup.test_photos.at(0);
    CHECK(a.compare(photo).render.data == b.compare(photo).render.data);
}

/// Two people on a backend whose memory the host cannot access have the bits of the threads.
void check_guarded(const Recipe& recipe) {
    cpu::Threads host(2);
    test::Guarded guarded;
    Threads threads(host, small_input(2), recipe);
    Reconstruction<test::Guarded> other(guarded, host, small_input(2), recipe);
    TrainingRecord of_threads, of_other;
    train(threads, recipe.length(), of_threads);
    train(other, recipe.length(), of_other);
    CHECK(of_threads.loss == of_other.loss);
    REQUIRE(threads.setup.people.size() == 2);
    CHECK(threads.setup.people[1].name == "bob");
    CHECK(threads.setup.people[0].seed != threads.setup.people[1].seed);
    check_same(threads, other);
}

/// A small recipe with each kind of stage: a quarter, half, and all of the Gaussians, then stored colours.
Recipe staged_recipe(std::uint64_t steps) {
    Recipe recipe = small_recipe(steps);
    recipe.configuration.schedule = ScheduleParams{.stride = 4, .least_points = 50, .all_points = 0.5, .stored = 0.75};
    return recipe;
}

} // namespace

TEST_CASE("the default recipe trains a lit avatar, and reports each stage from its beginning to its end") {
    cpu::Threads backend(2);
    Recipe recipe = small_recipe();
    recipe.refine = true, recipe.fine_registration = 1;
    std::vector<std::string> told;
    const Observer observer{.report = [&](const StageReport& report) {
        const std::string text = report.stage + (report.over ? " over" : "");
        if (told.empty() || told.back() != text) told.push_back(text);
        if (report.share) CHECK((*report.share >= 0 && *report.share <= 1));
    }};
    Threads person(backend, small_input(), recipe, observer);
    REQUIRE(person.input() != nullptr);
    REQUIRE(person.input()->registration.has_value());
    CHECK(person.input()->registration->frame_weights.size() == 2);
    CHECK(person.setup.registered);
    CHECK(person.setup.gaussian_count() == 200);

    TrainingRecord record;
    std::vector<double> shares;
    train(person, recipe.length(), record, {.progress = [&](double share) { shares.push_back(share); }});
    CHECK(shares == std::vector<double>{0.25, 0.5, 0.75, 1});
    CHECK(record.steps == 4);
    CHECK(record.loss.size() == 1); // of the first step; the next sample is due at the tenth
    CHECK(person.fill_unseen().size() == 1);
    const AvatarData avatar = person.avatars().at(0);
    CHECK(avatar.light.has_value());
    CHECK(avatar.gaussians.size() == 200);
    REQUIRE(person.refine_test_poses(observer));
    CHECK(told == std::vector<std::string>{"registering poses", "registering poses over", "preparing the avatar",
                                           "preparing the avatar over", "fitting test poses",
                                           "fitting test poses over"});
}

TEST_CASE("images that are read when they are needed give the same bits as those in memory") {
    cpu::Threads backend(2);
    Recipe recipe = staged_recipe(8);
    recipe.refine = true, recipe.fine_registration = 1;
    recipe.configuration.unknown_band = 0.03;
    recipe.configuration.test_fit.steps = 4;
    const auto input = [] {
        ReconstructionInput made = small_input(2);
        for (PixelImage& image : made.capture.images) // a background, so that masks have an unknown region
            for (std::size_t i = 0; i < image.data.size(); i += 4)
                if (image.data[i + 3] == 0)
                    image.data[i] = 90, image.data[i + 1] = static_cast<std::uint8_t>(i / 4 % 64);
        made.capture.hidden.resize(made.capture.images.size());
        made.capture.hidden[0] = {{.index = 65, .background = {}, .hidden = 1}};
        return made;
    };
    const auto check_trained = [&](AnyReconstruction& held, const std::vector<AnyReconstruction*>& others) {
        TrainingRecord of_held;
        train(held, recipe.length(), of_held);
        REQUIRE(held.refine_test_poses());
        for (AnyReconstruction* other : others) {
            TrainingRecord record;
            train(*other, recipe.length(), record);
            CHECK(record.loss == of_held.loss);
            REQUIRE(other->refine_test_poses());
            check_same(held, *other);
            const Photo &a = held.setup.test_photos.at(1), &b = other->setup.test_photos.at(1);
            const Comparison<float> of_a = held.compare(a), of_b = other->compare(b);
            CHECK(of_a.truth.data == of_b.truth.data);
            CHECK(of_a.mask.data == of_b.mask.data);
            CHECK(of_a.score.psnr == of_b.score.psnr);
        }
    };
    SUBCASE("with a registration, some kept or none") {
        Threads held(backend, input(), recipe), stored(backend, test::with_stored_images(input()), recipe),
            kept(backend, test::with_stored_images(input(), 1 << 20), recipe);
        REQUIRE(stored.setup.photos.at(0).source);
        CHECK(held.setup.photos[0].unknown.size() > 10);
        CHECK(stored.setup.light_text == held.setup.light_text);
        CHECK(stored.setup.pixels.empty());
        check_trained(held, {&stored, &kept});
    }
    SUBCASE("on a backend whose memory the host cannot access") {
        recipe.registration = false; // slow there, and tested apart
        test::Guarded guarded;
        Threads held(backend, input(), recipe);
        Reconstruction<test::Guarded> elsewhere(guarded, backend, test::with_stored_images(input()), recipe);
        check_trained(held, {&elsewhere});
    }
}

TEST_CASE("a training that was stopped, or goes on from a checkpoint, ends with the same bits") {
    cpu::Threads backend(2);
    Recipe recipe = small_recipe(6);
    recipe.refine = true, recipe.registration = false;
    Threads whole(backend, small_input(), recipe), stopped(backend, small_input(), recipe);
    TrainingRecord record, of_stopped;
    train(whole, recipe.length(), record);

    const test::Temporary folder;
    const auto path = folder / "checkpoint.gsh";
    std::uint64_t steps = 0;
    train(stopped, recipe.length(), of_stopped,
          {.progress = [&](double) { ++steps; },
           .stop = [&] { return steps == 2; },
           .checkpoint = [&] { save_checkpoint(path, stopped, of_stopped, "my words"); }});
    CHECK(of_stopped.steps == 2);
    CHECK(of_stopped.saved == 2);
    CHECK(checkpoint_words(path) == "my words");
    train(stopped, recipe.length(), of_stopped);
    check_same(whole, stopped);

    Threads later(backend, small_input(), recipe);
    check_checkpoint(path, later.setup.run);
    std::string lines = later.setup.run; // an older gsh listed the settings in another order
    const std::size_t first = lines.find('\n') + 1;
    REQUIRE(lines.substr(0, first) == test::contains(" = "));
    check_checkpoint(path, lines.substr(first) + lines.substr(0, first));
    CHECK_THROWS_WITH_AS(check_checkpoint(path, lines.substr(first)), doctest::Contains("belongs to a different run"),
                         ValueError);
    TrainingRecord of_later = load_checkpoint(path, later);
    CHECK(of_later.steps == 2);
    CHECK(of_later.loss == record.loss);
    train(later, recipe.length(), of_later, {}, 4);
    CHECK(of_later.steps == 4);
    train(later, recipe.length(), of_later);
    check_same(whole, later);

    Recipe other = recipe;
    other.refine_cameras = true;
    Threads of_another(backend, small_input(), other);
    CHECK_THROWS_WITH_AS((void)load_checkpoint(path, of_another, "; begin again"),
                         doctest::Contains("it has 'refine' where this run has 'refine, cameras too'; begin again"),
                         ValueError);
    CHECK_THROWS_WITH_AS((void)load_checkpoint(folder / "none.gsh", later), doctest::Contains("there is no checkpoint"),
                         IoError);

    // If the last checkpoint is damaged or gone, the one before it is used.
    save_checkpoint(path, later, of_later);
    const auto before = checkpoint_before(path);
    CHECK(before == folder / "checkpoint.before.gsh");
    std::string damage = "of an earlier call";
    CHECK(whole_checkpoint(path, damage) == path);
    CHECK(damage.empty());
    test::truncate_file(path, 1000);
    CHECK(whole_checkpoint(path, damage) == before);
    CHECK(damage == test::contains("checkpoint.gsh"));
    CHECK(damage == test::contains("checkpoint.before.gsh"));
    Threads once_more(backend, small_input(), recipe);
    TrainingRecord of_before = load_checkpoint(before, once_more);
    CHECK(of_before.steps == 2);
    train(once_more, recipe.length(), of_before);
    check_same(whole, once_more);
    std::filesystem::remove(path);
    CHECK(has_checkpoint(path));
    CHECK(whole_checkpoint(path, damage) == before);
    test::truncate_file(before, 1000);
    CHECK_THROWS_WITH_AS((void)whole_checkpoint(path, damage), doctest::Contains("there is no checkpoint"), IoError);
    remove_checkpoints(path);
    CHECK(!has_checkpoint(path));
}

TEST_CASE("two people on a backend whose memory the host cannot access have the bits of the threads") {
    check_guarded(small_recipe(3));
    check_guarded(staged_recipe(4)); // grows
}

TEST_CASE("a training grows in stages, and avatars of each stage can be exported") {
    cpu::Threads backend(2);
    const Recipe recipe = staged_recipe(8);
    Threads person(backend, small_input(), recipe);
    CHECK(person.setup.gaussian_count() == 200);
    std::vector<std::size_t> sizes, lookups;
    TrainingRecord record;
    train(person, recipe.length(), record, {.progress = [&](double) {
              person.settle();
              sizes.push_back(person.avatars().at(0).gaussians.size());
              lookups.push_back(person.table_counts().lookups);
          }});
    CHECK(sizes == std::vector<std::size_t>{50, 50, 100, 100, 200, 200, 200, 200});
    for (std::size_t step = 0; step < 8; ++step) CHECK((lookups[step] > 0) == (step < 6));
    CHECK(record.steps == 8);
    CHECK(person.fill_unseen().size() == 1);
    CHECK(person.avatars().at(0).gaussians.size() == 200);
}

TEST_CASE("a run that ends in an early stage has all Gaussians, and one that was stopped has those of its stage") {
    cpu::Threads backend(2);
    for (const bool stops : {false, true}) {
        const Recipe recipe = staged_recipe(stops ? 2 : 1);
        Threads person(backend, small_input(), recipe);
        TrainingRecord record;
        std::size_t in_checkpoint = 0;
        train(person, recipe.length(), record,
              {.stop = [&] { return stops && person.step_count() == 1; },
               .checkpoint = [&] { in_checkpoint = person.avatars().at(0).gaussians.size(); }});
        CHECK(record.steps == 1);
        CHECK(in_checkpoint == (stops ? 50 : 200));
        CHECK(person.avatars().at(0).gaussians.size() == in_checkpoint);
    }
}

TEST_CASE("stored colours and displacements begin as what the field gave") {
    cpu::Threads backend(2);
    Recipe recipe = small_recipe(4);
    recipe.configuration.schedule = ScheduleParams{.stored = 0.5};
    for (const char* rate :
         {"rate.stored_sh", "rate.stored_displacements", "rate.quats", "rate.log_scales", "rate.opacity_logits",
          "rate.joints", "rate.light_points", "rate.light_intensities", "rate.light_gloss", "gain.rate"})
        set_setting(recipe.configuration, rate, "0", "test"); // what is stored does not learn
    Threads person(backend, small_input(), recipe);
    for (const double progress : {0.0, 0.25}) person.step(progress);
    const AvatarData before = person.avatars().at(0);
    for (const double progress : {0.5, 0.75}) person.step(progress);
    const AvatarData after = person.avatars().at(0);
    CHECK(before.gaussians.means == after.gaussians.means);
    REQUIRE(before.gaussians.sh.size() == after.gaussians.sh.size());
    for (std::size_t i = 0; i < before.gaussians.sh.size(); i += 9) {
        CHECK(before.gaussians.sh[i] == after.gaussians.sh[i]);
        for (std::size_t k = 1; k < 9; ++k) CHECK(after.gaussians.sh[i + k] == vec3<float>(0)); // began after
    }
}

TEST_CASE("a training goes on from a checkpoint of each stage, or before the next one, with the same bits") {
    cpu::Threads backend(2);
    Recipe recipe = staged_recipe(8);
    recipe.refine = true, recipe.registration = false;
    Threads whole(backend, small_input(), recipe);
    TrainingRecord record;
    train(whole, recipe.length(), record);
    const test::Temporary folder;
    Threads stopped(backend, small_input(), recipe);
    TrainingRecord of_stopped;
    for (const std::uint64_t until : {1, 4, 7}) {
        CAPTURE(until);
        const auto path = folder / ("checkpoint" + std::to_string(until) + ".gsh");
        train(stopped, recipe.length(), of_stopped, {}, until);
        save_checkpoint(path, stopped, of_stopped);
        Threads later(backend, small_input(), recipe);
        TrainingRecord of_later = load_checkpoint(path, later);
        CHECK(of_later.steps == until);
        train(later, recipe.length(), of_later);
        check_same(whole, later);
    }
    TrainingRecord of_longer = load_checkpoint(folder / "checkpoint7.gsh", stopped); // for longer than was planned
    train(stopped, {.steps = 40}, of_longer, {}, 9); // steps 8 and 9 are in the first half of 40
    CHECK(of_longer.steps == 9);
    CHECK(stopped.avatars().at(0).gaussians.size() == 200);
    CHECK(stopped.table_counts().lookups == 0);
    CHECK_THROWS_WITH_AS((void)load_checkpoint(folder / "checkpoint1.gsh", whole),
                         doctest::Contains("is of an earlier stage than this training"), ValueError);
}

TEST_CASE("poses are registered on the backend that trains, with the bits of the threads") {
    cpu::Threads host(2);
    test::Guarded guarded;
    Recipe recipe = small_recipe(1);
    recipe.refine = true, recipe.fine_registration = 1, recipe.gaussians = 50;
    const Threads threads(host, small_input(), recipe);
    const Reconstruction<test::Guarded> other(guarded, host, small_input(), recipe);
    REQUIRE(other.setup.registered);
    CHECK(other.input()->people[0].motion.pose == threads.input()->people[0].motion.pose);
    CHECK(other.input()->people[0].motion.pose != small_input().people[0].motion.pose);
    CHECK(other.input()->registration->frame_fit == threads.input()->registration->frame_fit);
}

TEST_CASE("without refine, there are no refined motions and no fit of test poses") {
    cpu::Threads backend(2);
    Threads person(backend, small_input(), small_recipe());
    const auto says = doctest::Contains("the poses are not refined; make the reconstruction with Recipe::refine");
    CHECK_THROWS_WITH_AS((void)person.refined_motion(0), says, ValueError);
    CHECK_THROWS_WITH_AS((void)person.refine_test_poses(), says, ValueError);
    CHECK_THROWS_WITH_AS(person.end_test_refinement(), says, ValueError);
}

TEST_CASE("the pixels of photographs are kept once, in the setup, and the motions are the given ones without refine") {
    cpu::Threads backend(2);
    const ReconstructionInput input = small_input();
    const Threads person(backend, input, small_recipe());
    CHECK(!person.setup.registered);
    CHECK(!person.setup.refinement.has_value());
    for (const PixelImage& image : person.input()->capture.images) CHECK(image.data.empty());
    REQUIRE(person.setup.pixels.size() == person.setup.photos.size() + person.setup.test_photos.size());
    CHECK(person.setup.photos[0].rgba.data() == person.setup.pixels[0].data());
    CHECK(person.input()->people[0].motion.pose == input.people[0].motion.pose);
}
