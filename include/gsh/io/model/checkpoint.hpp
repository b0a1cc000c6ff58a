// SPDX-License-Identifier: Apache-2.0
/// @file  Stores the state of training in a file, so that it can be resumed with bit-identical results.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/train/avatar_scene.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

inline constexpr int checkpoint_version = 5;

namespace detail {

/// Calls f(key, numbers) for each span of numbers that steps of a learned array change.
template <class T, class F>
void for_each_state(const LearnedArray<T>& array, const F& f) {
    f("learned/" + array.name + "/values", array.values);
    f("learned/" + array.name + "/first_moment", array.first_moment);
    f("learned/" + array.name + "/second_moment", array.second_moment);
}

} // namespace detail

/// Settles a trainer, and adds its state to an archive: all learned arrays with their moments, the steps, and the seed
/// by which load_trainer recognises the run.
template <class TrainerType>
void add_trainer(ArchiveWriter& file, TrainerType& trainer) {
    using T = typename TrainerType::Scalar;
    std::vector<T> host;
    trainer.settle(); // arrays and steps of the same moment
    file.add("steps", std::uint64_t(trainer.step_count()));
    file.add("progress", trainer.progress());
    file.add("seed", std::uint64_t(trainer.seed()));
    const LearnedArrays<T> arrays = trainer.learned();
    file.add("arrays", std::uint64_t(arrays.size()));
    for (const LearnedArray<T>& array : arrays)
        detail::for_each_state(array, [&](const std::string& key, Span<const T> numbers) {
            host.resize(numbers.size());
            trainer.backend().download(numbers, Span<T>(host));
            file.add(key, host);
        });
}

/// Adds the state of a person's refinement to an archive.
template <class Refinement>
void add_refinement(ArchiveWriter& file, const Refinement& refinement, std::size_t person = 0) {
    const auto state = refinement.state();
    const std::string key = person_prefix(person) + "refinement/";
    file.add(key + "steps", std::uint64_t(state.steps));
    file.add(key + "updates", state.updates);
    file.add(key + "increments", state.increments);
    file.add(key + "first_moment", state.first_moment);
    file.add(key + "second_moment", state.second_moment);
}

/// Restores the state stored by add_refinement; the refinement must have been made from the same input.
///
/// Errors  ShapeError if the file belongs to another motion or number of cameras.
template <class Refinement>
void load_refinement(const ArchiveReader& file, Refinement& refinement, std::size_t person = 0) {
    using T = typename Refinement::Scalar;
    const std::string key = person_prefix(person) + "refinement/";
    refinement.set_state({.steps = file.read_number<std::uint64_t>(key + "steps"),
                          .updates = file.read<std::uint64_t>(key + "updates").data,
                          .increments = file.read<T>(key + "increments").data,
                          .first_moment = file.read<T>(key + "first_moment").data,
                          .second_moment = file.read<T>(key + "second_moment").data});
}

/// Brings a trainer that was made from the same input to the state that add_trainer kept.
/// Errors  ShapeError, ValueError or IoError if the file is of another training: another seed, or other arrays. Nothing
///         is loaded then.
template <class TrainerType>
void load_trainer(const ArchiveReader& file, TrainerType& trainer) {
    using T = typename TrainerType::Scalar;
    const std::string path = file.file().path().string();
    const auto seed = file.read_number<std::uint64_t>("seed");
    check_value(seed == trainer.seed(), path,
                "was made with seed " + std::to_string(seed) + ", not " + std::to_string(trainer.seed()) +
                    "; resume with that seed");
    const LearnedArrays<T> arrays = trainer.learned();
    const auto stored = file.read_number<std::uint64_t>("arrays");
    check_value(stored == arrays.size(), path,
                "holds " + std::to_string(stored) + " learned arrays, this training has " +
                    std::to_string(arrays.size()) + "; resume with the options and the input of the first run");
    std::vector<std::vector<T>> kept; // all is read before any of it is taken over
    for (const LearnedArray<T>& array : arrays)
        detail::for_each_state(array, [&](const std::string& key, Span<const T> numbers) {
            kept.push_back(file.read<T>(key).data);
            check_size(path, key, kept.back().size(), numbers.size(),
                       "resume with the options and the input of the first run");
        });
    const auto steps = file.read_number<std::uint64_t>("steps");
    const auto progress = file.read_number<double>("progress");
    check_value(progress >= 0 && progress <= 1, path,
                "states that " + detail::number_text(progress) + " of the training is done, expected 0 to 1");
    std::size_t next = 0;
    for (const LearnedArray<T>& array : arrays)
        detail::for_each_state(array, [&](const std::string&, Span<T> numbers) {
            trainer.backend().upload(Span<const T>(kept[next++]), numbers);
        });
    trainer.resume(steps, progress);
}

} // namespace gsh
