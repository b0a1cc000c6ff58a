// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include "io/small_body.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/makehuman_skeleton.hpp>
#include <gsh/io/body/region_file.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/learn/learned_array.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh::fuzz {

namespace {

const Registered body_target("body", "a.npz", [](const InputFile& file) {
    const BodyModel model = load_body_model(file);
    use(model);
    must_come_back("body.npz", model, save_body_model,
                   [](const std::filesystem::path& path) { return load_body_model(path); });
});

const Registered makehuman_target("makehuman", "a.zip", [](const InputFile& file) {
    const MakeHumanData data = load_makehuman(file);
    try {
        for (const vec3<double>& p :
             turned(data.skeleton, t_pose_rotations(data.skeleton, data.mesh.vertices), data.mesh.vertices))
            must(std::isfinite(p.x + p.y + p.z), "a vertex in T-pose is not finite");
    } catch (const ValueError&) {
        return; // bones without a length, which no T-pose has
    }
});

const Registered regions_target("regions", "a.json", [](const InputFile& file) {
    static const BodyModel model = test::small_body(55);
    const RegionLists lists = read_regions(file, model.vertex_count());
    for (const double importance : region_mask(model, model.v_template, lists).samples_per_vertex())
        must(std::isfinite(importance) && importance >= 0, "a region has no number of samples");
});

const Registered avatar_target("avatar", "a.gsh", [](const InputFile& file) {
    const AvatarData data = load_avatar(file);
    use(data);
    must_come_back(
        "avatar.gsh", data, [](const auto& path, const AvatarData& value) { save_avatar(path, value); },
        [](const auto& path) { return load_avatar(path); });
    const std::filesystem::path compact = scratch() / "compact.gsh";
    save_avatar(compact, data, ArrayStorage::compact);
    must(load_avatar(compact).gaussians.size() == data.gaussians.size(), "a compact avatar has other Gaussians");
});

/// A training of two learned arrays without gradients: all that a checkpoint's readers ask of one.
struct SmallTraining {
    using Scalar = float;
    cpu::Serial serial;
    std::vector<float> numbers = std::vector<float>(18, 0.5f);
    std::uint64_t steps = 0;
    double done = 0;

    [[nodiscard]] cpu::Serial& backend() { return serial; }
    [[nodiscard]] std::uint64_t seed() const { return 3; }
    [[nodiscard]] LearnedArrays<float> learned() {
        const auto part = [&](std::size_t begin, std::size_t size) {
            return Span<float>(numbers).subspan(begin, size);
        };
        LearnedArrays<float> arrays(2);
        arrays[0].name = "means", arrays[1].name = "opacity_logits";
        arrays[0].values = part(0, 4), arrays[0].first_moment = part(4, 4), arrays[0].second_moment = part(8, 4);
        arrays[1].values = part(12, 2), arrays[1].first_moment = part(14, 2), arrays[1].second_moment = part(16, 2);
        return arrays;
    }
    void resume(std::uint64_t step_count, double progress) { steps = step_count, done = progress; }
};

/// What a refinement of poses reads.
struct SmallRefinement {
    using Scalar = float;
    struct State {
        std::uint64_t steps = 0;
        std::vector<std::uint64_t> updates;
        std::vector<float> increments, first_moment, second_moment;
    };
    State state;
    void set_state(State given) { state = std::move(given); }
};

const Registered checkpoint_target("checkpoint", "a.gsh", [](const InputFile& file) {
    const ArchiveReader archive(file, "checkpoint", checkpoint_version);
    for (const char* text : {"configuration", "options"})
        if (archive.has(text)) (void)archive.read_text(text);
    SmallRefinement refinement;
    if (archive.has("refinement/steps")) load_refinement(archive, refinement);
    SmallTraining training;
    load_trainer(archive, training);
    must(training.done >= 0 && training.done <= 1, "the progress of a training is not from 0 to 1");
});

} // namespace

} // namespace gsh::fuzz
