// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/polar.hpp>

#include "support/linear.hpp"

#include <gsh/math/linalg.hpp>

#include <Eigen/LU>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <numbers>

using namespace gsh;

namespace {

/// U diag(1, 1, ±1) Vᵀ, and how well R is determined: the smallest sum of two eigenvalues of S, divided by the largest.
struct Reference {
    mat3<double> R;
    double certainty;

    explicit Reference(const mat3<double>& M) {
        Eigen::Matrix3d m;
        for (int c = 0; c < 3; ++c)
            for (int r = 0; r < 3; ++r) m(r, c) = M[c][r];
        const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
        Eigen::Vector3d sign(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1);
        const Eigen::Matrix3d found = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
        for (int c = 0; c < 3; ++c)
            for (int r = 0; r < 3; ++r) R[c][r] = found(r, c);
        certainty = (svd.singularValues()(1) + sign(2) * svd.singularValues()(2)) / svd.singularValues()(0);
    }
};

} // namespace

TEST_CASE("it is the nearest rotation, as found by singular values, mirrored and flat matrices included") {
    test::Rng rng(1);
    int mirrored = 0;
    for (int n = 0; n < 2000; ++n) {
        mat3<double> M = test::random_matrix(rng);
        if (n % 5 == 1) M[2] = M[0] * 0.3 + M[1] * 0.4; // singular: the image is a plane
        if (n % 5 == 2) M[2] = M[0] * 0.3 + M[1] * 0.4 + M[2] * 1e-6;
        if (n % 5 == 3) M = M * std::exp(rng.uniform(-20, 20));
        const Reference reference(M);
        if (reference.certainty < 0.02) continue;
        mirrored += determinant(M) < 0;
        INFO("matrix " << n << ", certainty " << reference.certainty);
        CHECK(test::distance(polar_rotation(M), reference.R) < 1e-13 / reference.certainty);
        CHECK(test::distance(polar_rotation(mat3<float>(M)), mat3<float>(reference.R)) <
              2e-6f / static_cast<float>(reference.certainty));
    }
    CHECK(mirrored > 500);
}

TEST_CASE("between two bones it is the rotation between, to a half turn's edge") {
    for (const double degrees : {0.0, 1e-6, 30.0, 120.0, 150.0, 170.0, 178.0}) {
        const double angle = degrees * std::numbers::pi / 180;
        const vec3<double> axis = normalize(vec3<double>(1, 2, -3));
        const mat3<double> M = (mat3<double>(1.0) + rotation_from_axis_angle(axis * angle)) * 0.5;
        CHECK(test::distance(polar_rotation(M), rotation_from_axis_angle(axis * (angle / 2))) < 1e-12);
    }
}

TEST_CASE_TEMPLATE("whatever is finite gives a rotation and a bounded adjoint", T, float, double) {
    test::Rng rng(2);
    std::vector<mat3<T>> cases = {mat3<T>(T(0)), mat3<T>(T(1)), mat3<T>(T(-1)), mat3<T>(T(1e-25)), mat3<T>(T(1e12))};
    // A reflection: many nearest rotations.
    cases.push_back(mat3<T>(vec3<T>(1, 0, 0), vec3<T>(0, 1, 0), vec3<T>(0, 0, -1)));
    cases.push_back(mat3<T>(vec3<T>(1, 0, 0), vec3<T>(0, 0, 0), vec3<T>(0, 0, 0)));
    for (const double off : {0.0, 1e-12, 1e-7, 1e-4, 1e-2}) { // equal blends of bones half a turn apart
        const auto axis = normalize(rng.vec());
        const auto first = rotation_from_axis_angle(rng.vec());
        cases.push_back(mat3<T>((first + rotation_from_axis_angle(axis * (std::numbers::pi - off)) * first) * 0.5));
    }
    for (int n = 0; n < 200; ++n) cases.push_back(mat3<T>(outer(rng.vec(), rng.vec())));
    // The equal blend of half turns about three axes.
    cases.push_back(mat3<T>(T(-1) / 3));
    for (std::size_t n = 0; n < cases.size(); ++n) {
        INFO("case " << n);
        const mat3<T> R = polar_rotation(cases[n]);
        CHECK(test::distance(transpose(R) * R, mat3<T>(T(1))) < (sizeof(T) == 4 ? T(1e-6) : T(1e-14)));
        CHECK(determinant(R) > T(0.99));
        mat3<T> dL_dM(T(0));
        polar_rotation_backward(cases[n], mat3<T>(vec3<T>(1, -1, 1), vec3<T>(1, 1, -1), vec3<T>(-1, 1, 1)), dL_dM);
        T largest = 0, size = 0;
        for (int k = 0; k < 3; ++k)
            largest = std::max(largest, length(dL_dM[k])), size = std::max(size, length(cases[n][k]));
        CHECK(std::isfinite(largest));
        CHECK(largest * size < T(1e5));
    }
}

TEST_CASE("the adjoint is the gradient, mirrored and nearly singular matrices included") {
    test::Rng rng(3);
    int checked = 0;
    for (int n = 0; n < 100; ++n) {
        mat3<double> M = test::random_matrix(rng), dL_dM(0.0);
        if (n % 4 == 1) M[2] = M[0] * 0.3 + M[1] * 0.4;
        if (n % 4 == 2) {
            M = mat3<double>(0.0);
            for (int k = 0; k < 4; ++k) M += rotation_from_axis_angle(rng.vec(-2, 2)) * rng.uniform(0.1, 0.4);
        }
        const Reference reference(M);
        if (reference.certainty < 0.1) continue;
        ++checked;
        const mat3<double> weight = test::random_matrix(rng);
        const auto loss = [&] { return test::inner(polar_rotation(M), weight); };
        polar_rotation_backward(M, weight, dL_dM);
        test::check_gradient(loss, test::scalars(M), test::scalars(dL_dM), {.tolerance = 1e-6});
        // The result does not depend on the scale.
        CHECK(std::abs(test::inner(dL_dM, M)) < 1e-12 * (1 + test::inner(dL_dM, dL_dM)));
        const mat3<double> once = dL_dM;
        polar_rotation_backward(M, weight, dL_dM);
        CHECK(test::distance(dL_dM, once * 2.0) < 1e-12);
    }
    CHECK(checked > 60);
}

TEST_CASE("at a rotation the adjoint keeps what lies along turns") {
    test::Rng rng(4);
    const mat3<double> R = rotation_from_axis_angle(rng.vec()), G = test::random_matrix(rng);
    mat3<double> dL_dM(0.0);
    polar_rotation_backward(R, G, dL_dM);
    CHECK(test::distance(dL_dM, (G - R * transpose(G) * R) * 0.5) < 1e-14);
}
