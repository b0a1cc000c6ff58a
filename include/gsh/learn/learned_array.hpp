// SPDX-License-Identifier: Apache-2.0
/// @file  Learned arrays: the list of what training changes, for optimisers, checkpoints and reports.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/optim/adam.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// The learning rate of stored spherical harmonics above the constant colour, as a share of the rate of the constant.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023: a 20th.
inline constexpr double sh_band_share = 0.05;

/// One learned array: its numbers, their gradient, Adam's moments, and its learning rate. A part of a model announces
/// it and owns the memory. The views are valid until that part changes its size or is moved.
///
/// Shapes  values, gradient, first_moment, second_moment [N], in the backend's memory.
/// Units   rate: about the change per step of Adam, in the unit of the values; 0 keeps them as they are.
template <class T>
struct LearnedArray {
    /// A second rate for some of the numbers. It also counts where the first rate is 0.
    struct OtherRate {
        enum class Where {
            none,
            columns, ///< of every `width` numbers, all but the first `first`
            tail     ///< the last `width` numbers of the array
        };
        Where where = Where::none;
        std::size_t width = 0, first = 0;
        double rate = 0;
    };

    std::string name; ///< unique among the arrays of a model; the key in a checkpoint
    Span<T> values, gradient, first_moment, second_moment;
    double rate = 0;
    OtherRate other = {};
    /// For a hash table: the rows that can receive a gradient, `row_size` numbers each. row_size is 0 for other arrays.
    Span<const std::uint32_t> touched_rows = {};
    std::size_t row_size = 0;

    [[nodiscard]] bool is_table() const { return row_size != 0; }
};

/// All learned arrays of a model, in a fixed order.
template <class T>
using LearnedArrays = std::vector<LearnedArray<T>>;

/// Appends the arrays of a part to a list. `prefix` is put before each name.
template <class T>
void append(LearnedArrays<T>& all, LearnedArrays<T> part, const std::string& prefix = {}) {
    for (LearnedArray<T>& array : part) {
        array.name = prefix + array.name;
        all.push_back(std::move(array));
    }
}

/// The memory of one learned array: values, gradient and moments, of numbers or of vectors and quaternions of them.
/// Others see it as an array of numbers.
template <Backend B, class Element = float>
class LearnedBuffer {
public:
    LearnedBuffer() = default;
    /// Gradient and moments start at zero.
    LearnedBuffer(B& backend, const std::vector<Element>& initial) {
        for (auto* buffer : {&values_, &gradient_, &first_moment_, &second_moment_}) buffer->resize(initial.size());
        backend.upload(Span<const Element>(initial), Span<Element>(values_));
        for (auto* buffer : {&gradient_, &first_moment_, &second_moment_}) backend.fill(numbers(*buffer), Number(0));
    }

    [[nodiscard]] std::size_t size() const { return values_.size(); }
    [[nodiscard]] Span<Element> values() { return values_; }
    [[nodiscard]] Span<const Element> values() const { return values_; }
    [[nodiscard]] Span<Element> gradient() { return gradient_; }
    [[nodiscard]] auto announce(std::string name, double rate) {
        return LearnedArray<Number>{.name = std::move(name),
                                    .values = numbers(values_),
                                    .gradient = numbers(gradient_),
                                    .first_moment = numbers(first_moment_),
                                    .second_moment = numbers(second_moment_),
                                    .rate = rate};
    }

private:
    using Buffer = typename B::template Buffer<Element>;
    static auto number_of(const Element& element) {
        if constexpr (std::is_floating_point_v<Element>) return element;
        else return element.x;
    }
    using Number = decltype(number_of(std::declval<Element>()));
    static Span<Number> numbers(Buffer& buffer) { return view_as<Number>(Span<Element>(buffer)); }

    Buffer values_, gradient_, first_moment_, second_moment_;
};

/// One step of Adam for one array. `factor` multiplies all of its rates. The gradient is zero afterwards.
template <Backend B, class T>
void take_step(B& backend, const Adam& adam, const LearnedArray<T>& array, double factor, std::int64_t step_number) {
    using Where = typename LearnedArray<T>::OtherRate::Where;
    const auto& [name, values, gradient, m, v, base_rate, other, touched_rows, row_size] = array;
    const double rate = base_rate * factor;
    if (values.empty()) return;
    if (base_rate == 0 && (other.where == Where::none || other.rate == 0)) {
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

/// One step of Adam for each array, at the same time where the backend can.
template <Backend B, class T>
void take_steps(B& backend, const Adam& adam, const LearnedArrays<T>& arrays, double factor, std::int64_t step_number) {
    for_each_branch(backend, arrays.size(),
                    [&](std::size_t i) { take_step(backend, adam, arrays[i], factor, step_number); });
}

/// An optimiser changes learned arrays by their gradients, each at its own rate times a factor, and leaves gradients of
/// zero. Adam is one. Another one has an overload of take_steps in its own namespace.
template <class O, class B, class T>
concept ArrayOptimizer = requires(B& backend, const O& optimizer, const LearnedArrays<T>& arrays, double factor,
                                  std::int64_t step_number) {
    take_steps(backend, optimizer, arrays, factor, step_number);
};

} // namespace gsh
