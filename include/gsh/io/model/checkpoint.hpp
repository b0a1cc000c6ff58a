// SPDX-License-Identifier: Apache-2.0
/// @file  Stores the state of training in a file, so that it can be resumed with bit-identical results.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/train/parameters.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

inline constexpr int checkpoint_version = 2;

namespace detail {

/// Prefix of a person's keys. The first person has none, so files of one person keep their original layout.
[[nodiscard]] inline std::string person_key(std::size_t person) {
    return person == 0 ? std::string() : "person" + std::to_string(person) + "/";
}

/// Calls f(name, parameters) for each array of numbers that training changes.
template <class TrainerType, class F>
void for_each_trained(TrainerType& trainer, const F& f) {
    for (std::size_t person = 0; person < trainer.person_count(); ++person) {
        f(person_key(person) + "parameters", trainer.model(person).parameters());
        f(person_key(person) + "first_moment", trainer.first_moment(person));
        f(person_key(person) + "second_moment", trainer.second_moment(person));
    }
}

[[nodiscard]] inline std::string trained_key(std::string_view what, std::size_t group) {
    return std::string(what).append("/").append(parameter_group_names[group]);
}

} // namespace detail

/// Adds a trainer's state to an archive: all people's parameters and moments, the step count, and the seed, by which
/// load_trainer identifies the training.
template <class TrainerType>
void add_trainer(ArchiveWriter& file, TrainerType& trainer) {
    using T = typename TrainerType::Scalar;
    std::vector<T> host;
    file.add("steps", std::uint64_t(trainer.step_count()));
    file.add("progress", trainer.progress());
    file.add("seed", std::uint64_t(trainer.seed()));
    if (trainer.person_count() > 1) file.add("people", std::uint64_t(trainer.person_count()));
    detail::for_each_trained(trainer, [&](std::string_view what, auto& parameters) {
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const Span<const T> values = parameters[static_cast<ParameterGroup>(g)];
            host.resize(values.size());
            trainer.backend().download(values, Span<T>(host));
            file.add(detail::trained_key(what, g), host);
        }
    });
}

/// Adds the state of a person's refinement to an archive.
template <class Refinement>
void add_refinement(ArchiveWriter& file, const Refinement& refinement, std::size_t person = 0) {
    const auto state = refinement.state();
    const std::string key = detail::person_key(person) + "refinement/";
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
    const std::string key = detail::person_key(person) + "refinement/";
    refinement.set_state({.steps = file.read_number<std::uint64_t>(key + "steps"),
                          .updates = file.read<std::uint64_t>(key + "updates").data,
                          .increments = file.read<T>(key + "increments").data,
                          .first_moment = file.read<T>(key + "first_moment").data,
                          .second_moment = file.read<T>(key + "second_moment").data});
}

/// Restores the state stored by add_trainer; the trainer must have been made from the same input.
///
/// Errors  ShapeError or ValueError if the file belongs to another training: another seed, number of people, or size of
///         an array.
template <class TrainerType>
void load_trainer(const ArchiveReader& file, TrainerType& trainer) {
    using T = typename TrainerType::Scalar;
    const auto seed = file.read_number<std::uint64_t>("seed");
    check_value(seed == trainer.seed(), file.file().path().string(),
                "was made with seed " + std::to_string(seed) + ", not " + std::to_string(trainer.seed()) +
                    "; resume with that seed");
    const std::uint64_t people = file.has("people") ? file.read_number<std::uint64_t>("people") : 1;
    check_value(people == trainer.person_count(), file.file().path().string(),
                "was made for a scene of " + std::to_string(people) + " people, not " +
                    std::to_string(trainer.person_count()) + "; resume with the poses of the first run");
    // Everything is read before the trainer is changed.
    std::vector<std::vector<T>> values;
    detail::for_each_trained(trainer, [&](std::string_view what, auto& parameters) {
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const std::string key = detail::trained_key(what, g);
            values.push_back(file.read<T>(key).data);
            check_size(file.file().path().string(), key, values.back().size(),
                       parameters[static_cast<ParameterGroup>(g)].size(),
                       "resume with the options and the input of the first run");
        }
    });
    const auto steps = file.read_number<std::uint64_t>("steps");
    const auto progress = file.read_number<double>("progress");
    std::size_t next = 0;
    detail::for_each_trained(trainer, [&](std::string_view, auto& parameters) {
        for (std::size_t g = 0; g < parameter_group_count; ++g)
            trainer.backend().upload(Span<const T>(values[next++]), parameters[static_cast<ParameterGroup>(g)]);
    });
    trainer.set_step_count(steps);
    trainer.set_progress(progress);
}

} // namespace gsh
