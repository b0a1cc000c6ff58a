// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/refine/refinement.hpp>

#include "support/contains.hpp"
#include "support/small_training.hpp"

#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
using test::SmallScene;
using test::SmallTraining;

namespace {
struct TemporaryFile {
    std::filesystem::path path;
    explicit TemporaryFile(const char* name)
        : path(std::filesystem::temp_directory_path() / (std::string(name) + std::to_string(getpid()))) {}
    ~TemporaryFile() { std::filesystem::remove(path); }
};
/// A training in which everything learns: shadows, poses, expressions, shape and cameras.
struct Everything {
    SmallTraining<cpu::Serial> training;
    MotionRefinement<cpu::Serial> refinement;

    explicit Everything(const SmallScene& scene)
        : training(scene, cpu::Serial(), 3,
                   {.head_time = true, .ao = AmbientOcclusion::time, .model = {.occlusion_start = 0.3}}),
          refinement(training.backend, training.rig, scene.motion, scene.cameras, config()) {
        training.people.refine(refinement);
    }
    Everything(const Everything&) = delete;

    static RefinementParams config() {
        RefinementParams config;
        config.pose = {.rate = 2e-3, .start = 0.1, .terms = {.pull = 1e-3, .acceleration = 1e-2}};
        config.transl = {.rate = 5e-4, .start = 0.1, .terms = {.pull = 1e-3}};
        config.expression = {.rate = 5e-3, .start = 0.2, .terms = {.pull = 1e-3}};
        config.betas = {.rate = 1e-3, .start = 0, .terms = {.pull = 1e-3}};
        config.camera_focal.rate = 1e-4, config.camera_principal_point.rate = 1e-2;
        return config;
    }
    /// Steps `first` to `last` of a run of 20.
    void run(int first, int last) {
        for (int i = first; i < last; ++i) training.trainer.step(i / 20.0);
    }
    void save(const std::filesystem::path& path) {
        ArchiveWriter writer(path, "checkpoint", checkpoint_version);
        add_trainer(writer, training.trainer);
        add_refinement(writer, refinement);
        writer.commit();
    }
    void load(const std::filesystem::path& path) {
        const ArchiveReader reader(path, "checkpoint", checkpoint_version);
        load_trainer(reader, training.trainer);
        load_refinement(reader, refinement);
    }
};

} // namespace

TEST_CASE("a resumed training goes on bit for bit") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> whole(scene);
    whole.steps(14);

    SmallTraining<cpu::Serial> first(scene);
    first.steps(6);
    const TemporaryFile file("gsh-checkpoint-");
    {
        ArchiveWriter writer(file.path, "checkpoint", checkpoint_version);
        add_trainer(writer, first.trainer);
        writer.commit();
    }
    SmallTraining<cpu::Serial> second(scene);
    load_trainer(ArchiveReader(file.path, "checkpoint", checkpoint_version), second.trainer);
    CHECK(second.trainer.step_count() == 6);
    CHECK(second.parameters() == first.parameters());
    CHECK(second.trainer.gains().gains() == first.trainer.gains().gains());
    second.steps(8);
    CHECK(second.parameters() == whole.parameters());
    CHECK(second.trainer.gains().gains() == whole.trainer.gains().gains());
}

TEST_CASE("a checkpoint of another training is refused, and nothing is taken over") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    const TemporaryFile file("gsh-checkpoint-");
    {
        ArchiveWriter writer(file.path, "checkpoint", checkpoint_version);
        add_trainer(writer, training.trainer);
        writer.commit();
    }
    SmallTraining<cpu::Serial> other_seed(scene, cpu::Serial(), 4);
    const auto before = other_seed.parameters();
    const ArchiveReader reader(file.path, "checkpoint", checkpoint_version);
    CHECK_THROWS_AS(load_trainer(reader, other_seed.trainer), ValueError);
    CHECK(other_seed.parameters() == before);
    CHECK_THROWS_AS(ArchiveReader(file.path, "avatar", 1), IoError);
    CHECK_THROWS_AS(ArchiveReader(file.path, "checkpoint", checkpoint_version + 1), IoError);
}

TEST_CASE("a checkpoint that states no possible progress is refused") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    const TemporaryFile file("gsh-checkpoint-progress-");
    training.trainer.resume(3, 1.5);
    {
        ArchiveWriter writer(file.path, "checkpoint", checkpoint_version);
        add_trainer(writer, training.trainer);
        writer.commit();
    }
    std::string message;
    try {
        load_trainer(ArchiveReader(file.path, "checkpoint", checkpoint_version), training.trainer);
    } catch (const ValueError& error) {
        message = error.what();
    }
    CHECK(message == test::contains("states that 1.5 of the training is done"));
}

TEST_CASE("a checkpoint of a training that learns more, less or other arrays is refused, and nothing is taken over") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> plain(scene), shaded(scene, cpu::Serial(), 3, {.ao = AmbientOcclusion::time}),
        stored(scene, cpu::Serial(), 3, {.hash_displacement = false, .hash_sh = false});
    const TemporaryFile of_plain("gsh-checkpoint-plain-"), of_shaded("gsh-checkpoint-shaded-");
    const auto save = [](const TemporaryFile& file, auto& trainer) {
        ArchiveWriter writer(file.path, "checkpoint", checkpoint_version);
        add_trainer(writer, trainer);
        writer.commit();
    };
    save(of_plain, plain.trainer), save(of_shaded, shaded.trainer);
    plain.steps(2), shaded.steps(2), stored.steps(2);
    const auto refused = [](const TemporaryFile& file, auto& training) {
        const auto before = training.parameters();
        std::string message;
        try {
            load_trainer(ArchiveReader(file.path, "checkpoint", checkpoint_version), training.trainer);
        } catch (const Error& error) {
            message = error.what();
        }
        CHECK(training.parameters() == before);
        CHECK(training.trainer.step_count() == 2);
        return message;
    };
    CHECK(refused(of_plain, shaded) == test::contains("7 learned arrays, this training has 9"));
    CHECK(refused(of_shaded, plain) == test::contains("9 learned arrays, this training has 7"));
    // The same number of arrays, with other names.
    CHECK(refused(of_plain, stored) == test::contains("learned/sh/values"));
}

TEST_CASE("with refinement and shadows, too, a resumed training goes on bit for bit") {
    const SmallScene scene;
    Everything whole(scene);
    whole.run(0, 20);
    const auto expected = whole.refinement.state();
    REQUIRE(expected.increments.size() > 0);
    CHECK(whole.refinement.cameras()[1].t != scene.cameras[1].t); // cameras did learn
    CHECK(whole.refinement.motion().pose != scene.motion.pose);
    CHECK(whole.training.mean_ao().size() == whole.training.model.size());
    for (const int stop : {1, 5, 13}) { // before poses learn, before ambient occlusion learns, after both
        CAPTURE(stop);
        const TemporaryFile file("gsh-checkpoint-");
        {
            Everything first(scene);
            first.run(0, stop);
            first.save(file.path);
        }
        Everything second(scene);
        second.load(file.path);
        CHECK(second.refinement.step_count() == static_cast<std::uint64_t>(stop));
        CHECK(second.training.trainer.progress() == (stop - 1) / 20.0);
        second.run(stop, 20);
        CHECK(second.training.parameters() == whole.training.parameters());
        const auto found = second.refinement.state();
        CHECK(found.steps == expected.steps);
        CHECK(found.updates == expected.updates);
        CHECK(found.increments == expected.increments);
        CHECK(found.first_moment == expected.first_moment);
        CHECK(found.second_moment == expected.second_moment);
    }
}

TEST_CASE("what a resumed training shows is what it showed before, shadows and poses included") {
    const SmallScene scene;
    const TemporaryFile file("gsh-checkpoint-");
    Everything first(scene), second(scene);
    first.run(0, 12);
    first.save(file.path);
    second.load(file.path);
    Image<float> before, after;
    first.training.trainer.render(scene.photos[3], before);
    second.training.trainer.render(scene.photos[3], after);
    CHECK(after.data == before.data);
    CHECK(second.training.mean_ao() == first.training.mean_ao());
}

TEST_CASE("a refinement of other frames or cameras is refused, and nothing is taken over") {
    const SmallScene scene;
    const TemporaryFile file("gsh-checkpoint-"), bare("gsh-checkpoint-bare-");
    Everything training(scene);
    training.run(0, 6);
    training.save(file.path);
    MotionRefinement<cpu::Serial> fewer(training.training.backend, training.training.rig, scene.motion, {},
                                        RefinementParams());
    const auto before = fewer.state();
    const ArchiveReader reader(file.path, "checkpoint", checkpoint_version);
    CHECK_THROWS_AS(load_refinement(reader, fewer), ShapeError);
    CHECK(fewer.state().increments == before.increments);
    CHECK(fewer.step_count() == 0);
    { // a training without refinement has no state of it
        ArchiveWriter writer(bare.path, "checkpoint", checkpoint_version);
        add_trainer(writer, training.training.trainer);
        writer.commit();
    }
    CHECK_THROWS_AS(load_refinement(ArchiveReader(bare.path, "checkpoint", checkpoint_version), fewer), IoError);
}
