// SPDX-License-Identifier: Apache-2.0
/// @file  What a network in mixed precision computes, from its equations, and the rounding of numbers to 16 bits.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/field/mlp.hpp>
#include <gsh/math/wide_bf16.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::test {

inline double as_bf16(double x) {
    return std::bit_cast<float>(bf16_bits(static_cast<float>(x)) << 16);
}
/// The nearest multiple of the distance between numbers of fp16 at x; the largest such number beyond their range.
inline double as_fp16(double x) {
    int exponent = 0;
    (void)std::frexp(x, &exponent);
    const double unit = std::ldexp(1.0, std::max(exponent - 11, -24));
    return std::clamp(std::nearbyint(x / unit) * unit, -65504.0, 65504.0);
}

/// Both passes with sums in double: the operands of all products are rounded to bf16, but for the shared inputs, which
/// are a bias. Gradients begin at zero.
///
/// Shapes  inputs, dL_dinputs [rows, inputs that differ from row to row].
struct RoundedMlp {
    std::vector<double> outputs, dL_dweights, dL_dinputs, dL_dshared;

    RoundedMlp(const Mlp& mlp, std::size_t rows, Span<const float> weights, Span<const double> inputs,
               Span<const float> shared, Span<const float> dL_doutputs)
        : dL_dweights(weights.size()), dL_dshared(shared.size()) {
        const std::size_t last = mlp.layer_count() - 1, own = mlp.inputs() - shared.size();
        for (std::size_t r = 0; r < rows; ++r) {
            std::vector<std::vector<double>> x(1);
            for (std::size_t i = 0; i < own; ++i) x[0].push_back(as_bf16(inputs[r * own + i]));
            for (std::size_t l = 0; l <= last; ++l) {
                std::vector<double> y(mlp.layer_outputs(l));
                for (std::size_t o = 0; o < y.size(); ++o) {
                    const float* const row = weights.data() + mlp.layer_offset(l) + o * mlp.layer_inputs(l);
                    for (std::size_t i = 0; i < x[l].size(); ++i) y[o] += as_bf16(double(row[i])) * x[l][i];
                    for (std::size_t c = 0; l == 0 && c < shared.size(); ++c)
                        y[o] += double(row[own + c]) * double(shared[c]);
                    if (l < last) y[o] = as_bf16(std::max(y[o], 0.0));
                }
                x.push_back(y);
            }
            outputs.insert(outputs.end(), x.back().begin(), x.back().end());

            std::vector<double> d_y;
            for (std::size_t o = 0; o < mlp.outputs(); ++o)
                d_y.push_back(as_bf16(double(dL_doutputs[r * mlp.outputs() + o])));
            for (std::size_t l = last + 1; l-- > 0;) {
                std::vector<double> d_x(x[l].size());
                for (std::size_t o = 0; o < d_y.size(); ++o) {
                    const std::size_t row = mlp.layer_offset(l) + o * mlp.layer_inputs(l);
                    for (std::size_t i = 0; i < d_x.size(); ++i) {
                        dL_dweights[row + i] += d_y[o] * x[l][i];
                        d_x[i] += as_bf16(double(weights[row + i])) * d_y[o];
                    }
                    for (std::size_t c = 0; l == 0 && c < shared.size(); ++c) {
                        dL_dweights[row + own + c] += d_y[o] * double(shared[c]);
                        dL_dshared[c] += double(weights[row + own + c]) * d_y[o];
                    }
                }
                if (l == 0) dL_dinputs.insert(dL_dinputs.end(), d_x.begin(), d_x.end());
                for (std::size_t i = 0; i < d_x.size(); ++i) d_x[i] = x[l][i] > 0 ? as_bf16(d_x[i]) : 0;
                d_y = d_x;
            }
        }
    }
};

} // namespace gsh::test
