// SPDX-License-Identifier: Apache-2.0
/// @file  A checkpoint that gsh 0.1.0 wrote, from which every 0.1.x goes on (docs/versions.md).
///
/// tests/data/0.1/checkpoint.gsh was written once, by the first test case, with GSH_WRITE_FILES=tests/data/0.1.
#include "reconstruct/small_people.hpp"

#include <gsh/cpu.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/reconstruct/reconstruction.hpp>
#include <gsh/reconstruct/resume.hpp>
#include <gsh/reconstruct/train.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <vector>

using namespace gsh;

namespace {

/// A quarter of the Gaussians learn at first, in small tables. The paper's settings stay what they are, and those of the
/// default may change.
Recipe kept_recipe() {
    Recipe recipe{.configuration = named_configuration("paper"), .steps = 8, .gaussians = 60};
    recipe.configuration.schedule = ScheduleParams{.stride = 4, .least_points = 15, .all_points = 0.5, .stored = 0.75};
    for (const auto& [key, value] : {std::pair("light", "true"), {"light.points", "1"}, {"light.directions", "2"},
                                     {"hash.table_size", "16"}, {"ao.table_size", "16"}, {"ao.points", "8"}})
        set_setting(recipe.configuration, key, value, "kept_recipe");
    return recipe;
}

} // namespace

TEST_CASE("a checkpoint of this version is written where a variable asks for it") {
    const char* to = std::getenv("GSH_WRITE_FILES");
    if (!to) return;
    cpu::Threads backend(1);
    const Recipe recipe = kept_recipe();
    Reconstruction<cpu::Threads> person(backend, test::small_input(), recipe);
    TrainingRecord record;
    train(person, recipe.length(), record, {.stop = [&] { return person.step_count() == 3; }});
    save_checkpoint(std::filesystem::path(to) / "checkpoint.gsh", person, record, "words of the caller");
}

TEST_CASE("a training goes on from a checkpoint of 0.1") {
    const std::filesystem::path path = std::filesystem::path(GSH_SOURCE_DIR) / "tests/data/0.1/checkpoint.gsh";
    CHECK(checkpoint_words(path) == "words of the caller");
    const ArchiveReader file(path, "checkpoint", checkpoint_version);
    CHECK(file.read_number<std::uint64_t>("steps") == 3);

    cpu::Threads backend(2);
    const Recipe recipe = kept_recipe();
    Reconstruction<cpu::Threads> person(backend, test::small_input(), recipe);
    TrainingRecord record = load_checkpoint(path, person);
    CHECK(record.steps == 3);
    REQUIRE(record.loss.size() == 1);
    CHECK(record.loss[0].first == 1);
    CHECK(record.psnr[0].second > 5);
    // What was loaded is what the file holds.
    const AvatarData loaded = person.avatars().at(0);
    CHECK(loaded.gaussians.size() == 30); // of 60, in the second of the three stages
    CHECK(loaded.gaussians.opacity_logits == file.read<float>("learned/opacity_logits/values").data);
    const auto intensities = file.read<float>("learned/light_log_intensities/values").data;
    REQUIRE((loaded.light.has_value() && loaded.light->size() == 3 && intensities.size() == 3));
    for (std::size_t i = 0; i < 3; ++i)
        CHECK(loaded.light->log_intensities[i] == doctest::Approx(intensities[i]).epsilon(1e-6));

    train(person, recipe.length(), record);
    CHECK(record.steps == 8);
    const AvatarData avatar = person.avatars().at(0);
    CHECK(avatar.gaussians.size() == 60);
    for (const float logit : avatar.gaussians.opacity_logits) CHECK(std::isfinite(logit));
}
