// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/train/checkpoint.hpp>

#include "support/small_training.hpp"

#include <unistd.h>

#include <filesystem>
#include <string>

using namespace gsh;
using test::SmallScene;
using test::SmallTraining;

namespace {
struct TemporaryFile {
    std::filesystem::path path;
    explicit TemporaryFile(const char* name) : path(std::filesystem::temp_directory_path() / (std::string(name) + std::to_string(getpid()))) {}
    ~TemporaryFile() { std::filesystem::remove(path); }
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
    second.steps(8);
    CHECK(second.parameters() == whole.parameters());
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
