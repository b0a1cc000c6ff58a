// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays that training changes, as the parts of a model announce them to optimisers, checkpoints and reports.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/optim/adam.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// One learned array: its numbers, their gradient, Adam's moments, and how fast it moves. The part that announces it
/// owns the memory; the views hold until that part is changed in size or moved.
///
/// Shapes  values, gradient, first_moment, second_moment [N], in the backend's memory.
/// Units   rate: change per step, in the unit of the values; 0 keeps them as they are.
template <class T>
struct LearnedArray {
    /// Some of the numbers move at another rate than the rest.
    struct OtherRate {
        enum class Where {
            none,
            columns, ///< all but the first `first` of every `width` numbers
            tail     ///< the last `width` numbers of the array
        };
        Where where = Where::none;
        std::size_t width = 0, first = 0;
        double rate = 0;
    };

    std::string name; ///< unique among the arrays of a model; a checkpoint's key
    Span<T> values, gradient, first_moment, second_moment;
    double rate = 0;
    OtherRate other = {};
    /// For a table: the rows, `row_size` numbers each, that ever receive a gradient. Empty with row_size 0: all.
    Span<const std::uint32_t> touched_rows = {};
    std::size_t row_size = 0;

    [[nodiscard]] bool is_table() const { return row_size != 0; }
};

/// All learned arrays of a model, in a fixed order.
template <class T>
using LearnedArrays = std::vector<LearnedArray<T>>;

/// Appends the arrays of one part to those of a whole, each name behind `prefix`.
template <class T>
void append(LearnedArrays<T>& all, LearnedArrays<T> part, const std::string& prefix = {}) {
    for (LearnedArray<T>& array : part) {
        array.name = prefix + array.name;
        all.push_back(std::move(array));
    }
}

/// A learned array with memory of its own.
template <Backend B, std::floating_point T = float>
class LearnedBuffer {
public:
    LearnedBuffer() = default;
    /// Gradient and moments start at zero.
    LearnedBuffer(B& backend, const std::vector<T>& initial) {
        for (auto* buffer : {&values_, &gradient_, &first_moment_, &second_moment_}) buffer->resize(initial.size());
        backend.upload(Span<const T>(initial), Span<T>(values_));
        for (auto* buffer : {&gradient_, &first_moment_, &second_moment_}) backend.fill(Span<T>(*buffer), T(0));
    }

    [[nodiscard]] std::size_t size() const { return values_.size(); }
    [[nodiscard]] Span<T> values() { return values_; }
    [[nodiscard]] Span<const T> values() const { return values_; }
    [[nodiscard]] Span<T> gradient() { return gradient_; }
    [[nodiscard]] LearnedArray<T> announce(std::string name, double rate) {
        return {.name = std::move(name),
                .values = values_,
                .gradient = gradient_,
                .first_moment = first_moment_,
                .second_moment = second_moment_,
                .rate = rate};
    }

private:
    typename B::template Buffer<T> values_, gradient_, first_moment_, second_moment_;
};

/// One step of Adam for one array, all of its rates multiplied by `factor`; the gradient is zero afterwards.
template <Backend B, class T>
void take_step(B& backend, const Adam& adam, const LearnedArray<T>& array, double factor, std::int64_t step_number) {
    using Where = typename LearnedArray<T>::OtherRate::Where;
    const auto& [name, values, gradient, m, v, base_rate, other, touched_rows, row_size] = array;
    const double rate = base_rate * factor;
    if (values.empty()) return;
    if (base_rate == 0) {
        backend.fill(gradient, T(0));
    } else if (array.is_table()) {
        adam.step_rows(backend, values, gradient, m, v, touched_rows, row_size, rate, step_number, UsedGradients::zero);
    } else if (other.where == Where::columns) {
        adam.step_columns(backend, values, gradient, m, v, other.width, other.first, rate, other.rate * factor,
                          step_number, UsedGradients::zero);
    } else {
        const std::size_t tail = other.where == Where::tail ? other.width : 0, body = values.size() - tail;
        adam.step(backend, values.subspan(0, body), gradient.subspan(0, body), m.subspan(0, body), v.subspan(0, body),
                  rate, step_number, UsedGradients::zero);
        if (tail)
            adam.step(backend, values.subspan(body, tail), gradient.subspan(body, tail), m.subspan(body, tail),
                      v.subspan(body, tail), other.rate * factor, step_number, UsedGradients::zero);
    }
}

} // namespace gsh
