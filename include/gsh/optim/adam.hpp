// SPDX-License-Identifier: Apache-2.0
/// @file  Adam: gradient descent scaled by running means of each gradient and of its square.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh {

/// What a step does with the gradients after use. Zeroing them in the same pass saves a pass over memory.
enum class UsedGradients { keep, zero };

namespace detail {

/// Numbers of one step that are common to all elements.
template <class T>
struct AdamCoefficients {
    T beta1, beta2, one_minus_beta1, one_minus_beta2, step_size, inverse_root_correction2, epsilon;
};

/// Updates m, v and the parameter of one element (per lane). step_size takes the place of the coefficients' own.
#if defined(__NVCC__)
#pragma nv_exec_check_disable // a register's operations are host functions
#endif
template <Lane T>
GSH_INLINE GSH_HD void adam_update(T& parameter, T gradient, T& m, T& v, const AdamCoefficients<ScalarOf<T>>& c,
                                   T step_size) {
    m = T(c.beta1) * m + T(c.one_minus_beta1) * gradient;
    v = T(c.beta2) * v + T(c.one_minus_beta2) * gradient * gradient;
    parameter -= step_size * m / (sqrt(v) * T(c.inverse_root_correction2) + T(c.epsilon));
}
template <Lane T>
GSH_INLINE GSH_HD void adam_update(T& parameter, T gradient, T& m, T& v, const AdamCoefficients<ScalarOf<T>>& c) {
    adam_update(parameter, gradient, m, v, c, T(c.step_size));
}

/// Element i of one step.
template <class T>
struct AdamStep {
    Span<T> parameters, gradients, m, v;
    AdamCoefficients<T> coefficients;
    bool zero_gradients;

    GSH_INLINE GSH_HD void operator()(std::size_t i) const {
        adam_update(parameters[i], gradients[i], m[i], v[i], coefficients);
        if (zero_gradients) gradients[i] = T(0);
    }
};

} // namespace detail

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void adam_step(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Adam: include its backend's overloads, <gsh/optim/cpu/adam.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void adam_step_rows(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Adam: include its backend's overloads, <gsh/optim/cpu/adam.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void adam_step_columns(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Adam: include its backend's overloads, <gsh/optim/cpu/adam.hpp> or <gsh/cpu.hpp>");
}

/// p -= rate * (m / (1 - β1^t)) / (sqrt(v / (1 - β2^t)) + ε), with m and v the running means of g and g².
///
/// Shapes  parameters, gradients, m, v [N]; m and v start at zero; the first step has number 1.
/// Errors  ShapeError, ValueError before any work starts.
/// Source  Kingma and Ba, "Adam: A Method for Stochastic Optimization", 2015, algorithm 1.
struct Adam {
    double beta1 = 0.9;     ///< the mean covers about 10 steps
    double beta2 = 0.999;   ///< the mean of the square covers about 1000 steps
    double epsilon = 1e-15; ///< small, so that rarely touched entries still take full steps

    /// One step of every parameter.
    template <Backend B, std::floating_point T>
    void step(B& backend, Span<T> parameters, std::type_identity_t<Span<T>> gradients,
              std::type_identity_t<Span<T>> m, std::type_identity_t<Span<T>> v, double rate, std::int64_t step_number,
              UsedGradients used = UsedGradients::keep) const {
        check_memory<T>(backend, "Adam::step", parameters, gradients, m, v);
        adam_step(backend, prepared<T>(parameters, gradients, m, v, rate, step_number, used), parameters.size());
    }

    /// One step of some rows of a [., width] table, for instance the entries that a hash grid's query uses.
    ///
    /// Rows that never had a gradient have m = v = 0 and do not move in a dense step either. If every step includes all
    /// rows that ever have a gradient, the result is bit-identical to dense Adam, with a fraction of the memory
    /// traffic.
    ///
    /// Shapes  rows [R], distinct; ascending rows are the fastest.
    template <Backend B, std::floating_point T>
    void step_rows(B& backend, Span<T> parameters, std::type_identity_t<Span<T>> gradients,
                   std::type_identity_t<Span<T>> m, std::type_identity_t<Span<T>> v,
                   std::type_identity_t<Span<const std::uint32_t>> rows, std::size_t width, double rate,
                   std::int64_t step_number, UsedGradients used = UsedGradients::keep) const {
        check_value(width > 0 && parameters.size() % width == 0, "Adam::step_rows",
                    "parameters must hold a whole number of rows of width > 0");
        check_memory<T>(backend, "Adam::step_rows", parameters, gradients, m, v);
        gsh::check_memory(backend, "Adam::step_rows", "rows", rows);
        adam_step_rows(backend, prepared<T>(parameters, gradients, m, v, rate, step_number, used), rows, width);
    }

    /// One step of a [., width] table whose first `first` columns have one rate and the others another. Examples are
    /// the constant and the higher bands of spherical harmonics.
    template <Backend B, std::floating_point T>
    void step_columns(B& backend, Span<T> parameters, std::type_identity_t<Span<T>> gradients,
                      std::type_identity_t<Span<T>> m, std::type_identity_t<Span<T>> v, std::size_t width,
                      std::size_t first, double first_rate, double other_rate, std::int64_t step_number,
                      UsedGradients used = UsedGradients::keep) const {
        check_value(first <= width && width > 0 && parameters.size() % width == 0, "Adam::step_columns",
                    "parameters must hold a whole number of rows of width > 0, and first be at most the width");
        check_memory<T>(backend, "Adam::step_columns", parameters, gradients, m, v);
        adam_step_columns(backend, prepared<T>(parameters, gradients, m, v, first_rate, step_number, used),
                          prepared<T>(parameters, gradients, m, v, other_rate, step_number, used),
                          parameters.size() / width, width, first);
    }

    /// The numbers of one step, for kernels of a caller's own. The first step has number 1.
    template <std::floating_point T>
    [[nodiscard]] detail::AdamCoefficients<T> coefficients(double rate, std::int64_t step_number) const {
        check_value(step_number >= 1, "Adam", "step_number counts from 1");
        const double t = static_cast<double>(step_number);
        const double correction1 = 1 - std::pow(beta1, t), correction2 = 1 - std::pow(beta2, t);
        return {T(beta1), T(beta2), T(1 - beta1), T(1 - beta2), T(rate / correction1), T(1 / std::sqrt(correction2)),
                T(epsilon)};
    }

private:
    template <class T, Backend B>
    static void check_memory(const B& backend, const char* where, Span<T> parameters, Span<T> gradients, Span<T> m,
                             Span<T> v) {
        gsh::check_memory(backend, where, "parameters", parameters);
        gsh::check_memory(backend, where, "gradients", gradients);
        gsh::check_memory(backend, where, "m", m);
        gsh::check_memory(backend, where, "v", v);
    }

    template <class T>
    [[nodiscard]] detail::AdamStep<T> prepared(Span<T> parameters, Span<T> gradients, Span<T> m, Span<T> v, double rate,
                                               std::int64_t step_number, UsedGradients used) const {
        check_size("Adam", "gradients", gradients.size(), parameters.size());
        check_size("Adam", "m", m.size(), parameters.size());
        check_size("Adam", "v", v.size(), parameters.size());
        return {parameters, gradients, m, v, coefficients<T>(rate, step_number), used == UsedGradients::zero};
    }
};

} // namespace gsh
