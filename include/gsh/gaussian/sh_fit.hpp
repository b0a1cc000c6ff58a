// SPDX-License-Identifier: Apache-2.0
/// @file  SH coefficients of one Gaussian from its colours as seen from several directions: least squares.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>

namespace gsh {

/// Collects colours of a Gaussian and finds the coefficients c that minimise
///
///     Σ_i w_i |Y(d_i) c + 1/2 - color_i|² + ridge Σ_i w_i |c - prior|².
///
/// The ridge decides what the colours leave open, for instance where all directions lie on one side.
///
/// Shapes  prior, result [basis_count] RGB.
/// Frame   d_i are unit vectors from the camera's centre to the Gaussian, in the frame of the coefficients.
/// Errors  none; without colours, with weights of zero or a ridge that is not above 0, the result is the prior.
template <int Degree>
class ShFit {
public:
    static constexpr int basis_count = sh_basis_count(Degree);

    explicit ShFit(const vec3<double>* prior) : prior_(prior) {}

    void add(const vec3<double>& dir, const vec3<double>& color, double weight) {
        double Y[basis_count];
        for (int k = 0; k < basis_count; ++k) Y[k] = 0;
        basis(dir, Y);
        vec3<double> residual = color - vec3<double>(0.5);
        for (int k = 0; k < basis_count; ++k) residual -= prior_[k] * Y[k];
        for (int k = 0; k < basis_count; ++k) {
            right_[k] += residual * (Y[k] * weight);
            for (int j = 0; j <= k; ++j) gram_[k][j] += Y[k] * Y[j] * weight;
        }
        weight_ += weight;
    }

    void solve(double ridge, vec3<double>* result) {
        for (int k = 0; k < basis_count; ++k) result[k] = prior_[k];
        if (!(weight_ > 0 && ridge > 0)) return;
        auto L = gram_; // Cholesky, in place
        for (int k = 0; k < basis_count; ++k) {
            L[k][k] += ridge * weight_;
            for (int j = 0; j <= k; ++j) {
                double sum = L[k][j];
                for (int i = 0; i < j; ++i) sum -= L[k][i] * L[j][i];
                L[k][j] = j == k ? std::sqrt(sum) : sum / L[j][j];
            }
        }
        auto x = right_;
        for (int k = 0; k < basis_count; ++k) {
            for (int j = 0; j < k; ++j) x[k] -= x[j] * L[k][j];
            x[k] /= L[k][k];
        }
        for (int k = basis_count; k-- > 0;) {
            for (int j = k + 1; j < basis_count; ++j) x[k] -= x[j] * L[j][k];
            x[k] /= L[k][k];
            result[k] += x[k];
        }
    }

private:
    /// The values of the basis: SHEval's gradient of the first channel with respect to the coefficients.
    static void basis(const vec3<double>& dir, double* Y) {
        vec3<double> sh[basis_count] = {}, dL_dsh[basis_count] = {}, unused(0);
        SHEval<Degree>::backward(sh, dir, vec3<double>(1, 0, 0), dL_dsh, unused);
        for (int k = 0; k < basis_count; ++k) Y[k] = dL_dsh[k].x;
    }

    const vec3<double>* prior_;
    std::array<std::array<double, basis_count>, basis_count> gram_{}; // lower triangle
    std::array<vec3<double>, basis_count> right_{};
    double weight_ = 0;
};

} // namespace gsh
