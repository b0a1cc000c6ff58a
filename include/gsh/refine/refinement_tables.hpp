// SPDX-License-Identifier: Apache-2.0
/// @file  The numbers of a refinement: tables of increments. A row takes a step of Adam when it is visited.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/camera_increment.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/refine/refinement_params.hpp>

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// One step of Adam for the numbers of one row. The gradients are zero afterwards.
template <class T>
struct RowStep {
    Span<T> parameters, gradients, m, v;
    Span<const T> rates; // a factor for every three numbers, or empty
    AdamCoefficients<T> coefficients;
    bool learns; // otherwise the gradients are cleared, and nothing else happens
    GSH_HD void apply(std::size_t i) const {
        if (learns) {
            AdamCoefficients<T> mine = coefficients;
            if (!rates.empty()) mine.step_size *= rates[i / 3];
            adam_update(parameters[i], gradients[i], m[i], v[i], mine);
        }
        gradients[i] = T(0);
    }
};

/// The steps of several rows. A step of training visits about ten short ones; on a device a launch each would take
/// longer than their work.
template <class T>
struct RowSteps {
    static constexpr std::size_t capacity = 12;
    RowStep<T> rows[capacity];
    std::size_t ends[capacity]; // row r has the indices from ends[r - 1] to ends[r]
    std::size_t count;
    Span<const std::uint32_t> halt; // halt_word
    [[nodiscard]] std::size_t size() const { return count == 0 ? 0 : ends[count - 1]; }
    GSH_HD void operator()(std::size_t i) const {
        if (is_halted(halt)) return;
        std::size_t row = 0, begin = 0;
        while (i >= ends[row]) begin = ends[row++];
        rows[row].apply(i - begin);
    }
};

} // namespace detail

/// Increments, their gradients and Adam's moments. Each group has a table; all tables lie in one array of the backend.
/// All numbers are zero at first.
///
/// Only a visited row takes a step, with its own step count. It moves by about the rate at each visit, for any number
/// of rows. With dense Adam, the zero gradients during the visits of all other rows would shrink the second moment, and
/// so raise the rate with the motion's length. A frame would also move in steps that do not use it.
///
/// Shapes  see RefinementGroup; the four groups of a camera are one CameraIncrement.
template <Backend B, std::floating_point T = float>
class RefinementTables {
public:
    static constexpr std::size_t camera_width = sizeof(CameraIncrement<T>) / sizeof(T);
    static_assert(camera_width == 9, "a camera's increment is nine numbers without gaps");
    static constexpr std::size_t remembered_steps = 256; ///< that take_back may take back
    static_assert(remembered_steps >= most_unsettled_steps);

    struct Sizes {
        std::size_t frames = 0, joints = 0, expression = 0, betas = 0, cameras = 0;
        bool pose_bias = false, transl_bias = false; ///< whether these groups have a row
    };

    RefinementTables(B& backend, const Sizes& sizes) : backend_(&backend) {
        std::size_t numbers = 0, rows = 0;
        const auto place = [&](RefinementGroup group, std::size_t count, std::size_t width, std::size_t stride,
                               std::size_t offset) {
            tables_[static_cast<std::size_t>(group)] = {offset, count, width, stride, rows};
            rows += count;
        };
        const auto table = [&](RefinementGroup group, std::size_t count, std::size_t width) {
            place(group, count, width, width, numbers);
            numbers += count * width;
        };
        table(RefinementGroup::pose, sizes.frames, 3 * sizes.joints);
        table(RefinementGroup::transl, sizes.frames, 3);
        table(RefinementGroup::expression, sizes.frames, sizes.expression);
        table(RefinementGroup::betas, 1, sizes.betas);
        table(RefinementGroup::pose_bias, sizes.pose_bias ? 1 : 0, 3 * sizes.joints);
        table(RefinementGroup::transl_bias, sizes.transl_bias ? 1 : 0, 3);
        place(RefinementGroup::camera_rotation, sizes.cameras, 3, camera_width, numbers);
        place(RefinementGroup::camera_translation, sizes.cameras, 3, camera_width, numbers + 3);
        place(RefinementGroup::camera_focal, sizes.cameras, 1, camera_width, numbers + 6);
        place(RefinementGroup::camera_principal_point, sizes.cameras, 2, camera_width, numbers + 7);
        numbers += sizes.cameras * camera_width;
        updates_.assign(rows, 0);
        for (Buffer* buffer : {&increments_, &gradient_, &first_moment_, &second_moment_}) {
            buffer->resize(numbers);
            backend_->fill(Span<T>(*buffer), T(0));
        }
    }

    [[nodiscard]] std::size_t rows(RefinementGroup group) const { return table(group).rows; }
    [[nodiscard]] std::size_t width(RefinementGroup group) const { return table(group).width; }

    /// One row, in the backend's memory.
    [[nodiscard]] Span<T> increments(RefinementGroup group, std::size_t row) {
        return at(Span<T>(increments_), group, row);
    }
    [[nodiscard]] Span<const T> increments(RefinementGroup group, std::size_t row) const {
        return at(Span<const T>(increments_), group, row);
    }
    [[nodiscard]] Span<T> gradient(RefinementGroup group, std::size_t row) {
        return at(Span<T>(gradient_), group, row);
    }

    /// All rows of a group with a table of its own, which is any but those of cameras.
    [[nodiscard]] Span<const T> all_increments(RefinementGroup group) const {
        return Span<const T>(increments_).subspan(table(group).offset, table(group).rows * table(group).width);
    }
    /// The numbers of all four groups of a camera.
    [[nodiscard]] Span<const T> camera_increments(std::size_t camera) const {
        return {increments(RefinementGroup::camera_rotation, camera).data(), camera_width};
    }
    [[nodiscard]] Span<T> camera_gradient(std::size_t camera) {
        return {gradient(RefinementGroup::camera_rotation, camera).data(), camera_width};
    }

    /// Begins a step of several rows.
    void begin_step() {
        if (history_.size() == remembered_steps) history_.pop_front();
        history_.emplace_back();
    }
    /// A step of Adam for one row. Its gradient is zero afterwards. rates: a factor for every three numbers, or empty.
    void step(RefinementGroup group, std::size_t row, const Adam& adam, double rate, Span<const T> rates = {}) {
        const std::size_t update = table(group).first_update + row;
        history_.back().push_back(update);
        const auto visit = static_cast<std::int64_t>(++updates_[update]);
        add_row(group, row, rates, adam.coefficients<T>(rate, visit), true);
    }
    /// No step for a row: only its gradient is zero afterwards.
    void forget_gradient(RefinementGroup group, std::size_t row) {
        add_row(group, row, {}, detail::AdamCoefficients<T>{}, false);
    }
    /// Ends the step, which happens now.
    void end_step() {
        steps_.halt = halt_word(*backend_);
        backend_->for_each(steps_.size(), steps_);
        steps_ = detail::RowSteps<T>{};
    }
    /// Takes back the counts of the last `steps` steps, which have changed nothing because the backend had halted, and
    /// clears the gradients that they have left.
    /// Errors  ValueError for more steps than it remembers.
    void take_back(std::uint64_t steps) {
        check_value(steps <= history_.size(), "RefinementTables::take_back", "so many steps are not remembered");
        for (; steps > 0; --steps) {
            for (const std::size_t update : history_.back()) --updates_[update];
            history_.pop_back();
        }
        backend_->fill(Span<T>(gradient_), T(0));
    }

    /// All increments on the host, row by row.
    class HostIncrements {
    public:
        HostIncrements(const RefinementTables& tables) : tables_(&tables), numbers_(tables.increments_.size()) {
            tables.backend_->download(Span<const T>(tables.increments_), Span<T>(numbers_));
        }
        [[nodiscard]] Span<T> operator()(RefinementGroup group, std::size_t row) {
            return tables_->at(Span<T>(numbers_), group, row);
        }
        [[nodiscard]] const std::vector<T>& numbers() const { return numbers_; }

    private:
        const RefinementTables* tables_;
        std::vector<T> numbers_;
    };
    [[nodiscard]] HostIncrements host_increments() const { return HostIncrements(*this); }
    void set_increments(const HostIncrements& host) { backend_->upload(Span<const T>(host.numbers()), increments_); }

    /// Everything but gradients. The caller sets `steps`.
    [[nodiscard]] RefinementState<T> state() const {
        RefinementState<T> state;
        state.updates = updates_;
        const auto fetch = [&](const Buffer& from, std::vector<T>& to) {
            to = downloaded(*backend_, Span<const T>(from));
        };
        fetch(increments_, state.increments);
        fetch(first_moment_, state.first_moment);
        fetch(second_moment_, state.second_moment);
        return state;
    }
    /// Restores a state.
    /// Errors  ShapeError for the state of other tables; then nothing changes.
    void set_state(const RefinementState<T>& state) {
        constexpr std::string_view where = "RefinementTables::set_state",
                                   hint = "resume with the input of the first run";
        check_size(where, "updates", state.updates.size(), updates_.size(), hint);
        check_size(where, "increments", state.increments.size(), increments_.size(), hint);
        check_size(where, "first_moment", state.first_moment.size(), increments_.size(), hint);
        check_size(where, "second_moment", state.second_moment.size(), increments_.size(), hint);
        updates_ = state.updates;
        history_.clear();
        backend_->upload(Span<const T>(state.increments), increments_);
        backend_->upload(Span<const T>(state.first_moment), first_moment_);
        backend_->upload(Span<const T>(state.second_moment), second_moment_);
        backend_->fill(Span<T>(gradient_), T(0));
    }

private:
    using Buffer = typename B::template Buffer<T>;

    /// The place of a group's numbers: row r begins at offset + r stride.
    struct Table {
        std::size_t offset = 0, rows = 0, width = 0, stride = 0, first_update = 0;
    };

    [[nodiscard]] const Table& table(RefinementGroup group) const { return tables_[static_cast<std::size_t>(group)]; }

    template <class U>
    [[nodiscard]] Span<U> at(Span<U> numbers, RefinementGroup group, std::size_t row) const {
        const Table& t = table(group);
        if (row >= t.rows)
            throw ValueError("refinement: row " + std::to_string(row) + " of " +
                             std::string(refinement_group_names[static_cast<std::size_t>(group)]) +
                             " does not exist; the group has " + std::to_string(t.rows) + " rows");
        return numbers.subspan(t.offset + row * t.stride, t.width);
    }

    void add_row(RefinementGroup group, std::size_t row, Span<const T> rates,
                 const detail::AdamCoefficients<T>& coefficients, bool learns) {
        if (steps_.count == detail::RowSteps<T>::capacity) end_step();
        const Span<T> numbers = increments(group, row);
        steps_.ends[steps_.count] = steps_.size() + numbers.size();
        steps_.rows[steps_.count++] = detail::RowStep<T>{numbers,
                                                         gradient(group, row),
                                                         at(Span<T>(first_moment_), group, row),
                                                         at(Span<T>(second_moment_), group, row),
                                                         rates,
                                                         coefficients,
                                                         learns};
    }

    B* backend_;
    detail::RowSteps<T> steps_{}; // of rows that have been visited since begin_step
    std::array<Table, refinement_group_count> tables_;
    Buffer increments_, gradient_, first_moment_, second_moment_;
    std::vector<std::uint64_t> updates_; ///< number of steps of each row of each group
    std::deque<std::vector<std::size_t>> history_; ///< which of them the last steps counted
};

} // namespace gsh
