// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/sh.hpp>

#include "support/gradient.hpp"

#include <numbers>

using namespace gsh;

namespace {

template <int D>
struct Degree {
    static constexpr int value = D;
};

/// All Y_k(dir) through the public interface: only coefficient k is one.
template <int D>
std::vector<double> basis_values(const vec3<double>& dir) {
    std::vector<double> values;
    for (int k = 0; k < SHEval<D>::basis_count; ++k) {
        std::vector<vec3<double>> sh(SHEval<D>::basis_count, vec3<double>(0.0));
        sh[static_cast<std::size_t>(k)] = vec3<double>(1, 0, 0);
        values.push_back(SHEval<D>::forward(sh.data(), dir).x);
    }
    return values;
}

} // namespace

TEST_CASE_TEMPLATE("SHEval::backward is the gradient of forward", D, Degree<0>, Degree<1>, Degree<2>, Degree<3>,
                   Degree<4>) {
    using SH = SHEval<D::value>;
    test::Rng rng(7);
    auto sh = rng.vecs(SH::basis_count), dL_dsh = std::vector(sh.size(), vec3<double>(0.0));
    auto dir = normalize(rng.vec()), dL_ddir = vec3<double>(0.0);
    const auto dL_dcolor = rng.vec();
    const auto loss = [&] { return dot(SH::forward(sh.data(), dir), dL_dcolor); };

    SH::backward(sh.data(), dir, dL_dcolor, dL_dsh.data(), dL_ddir);
    test::check_gradient(loss, test::scalars(sh), test::scalars(dL_dsh), {.tolerance = 1e-8});
    test::check_gradient(loss, test::scalars(dir), test::scalars(dL_ddir),
                         {.tolerance = 1e-8, .may_vanish = D::value == 0});

    const auto sh_once = dL_dsh;
    const auto dir_once = dL_ddir;
    SH::backward(sh.data(), dir, dL_dcolor, dL_dsh.data(), dL_ddir);
    for (std::size_t k = 0; k < sh.size(); ++k) CHECK(dL_dsh[k] == sh_once[k] * 2.0);
    CHECK(length(dL_ddir - dir_once * 2.0) < 1e-12);
}

TEST_CASE("the basis is orthonormal on the sphere") {
    // Degree 4 times degree 4 is a polynomial of degree 8: five Gauss-Legendre nodes in z and nine equidistant
    // longitudes integrate it exactly.
    const double node1 = std::sqrt(5 - 2 * std::sqrt(10.0 / 7)) / 3, node2 = std::sqrt(5 + 2 * std::sqrt(10.0 / 7)) / 3;
    const double weight1 = (322 + 13 * std::sqrt(70.0)) / 900, weight2 = (322 - 13 * std::sqrt(70.0)) / 900;
    const double nodes[] = {-node2, -node1, 0, node1, node2};
    const double weights[] = {weight2, weight1, 128.0 / 225, weight1, weight2};
    constexpr std::size_t count = SHEval<4>::basis_count, longitudes = 9;
    std::vector<double> gram(count * count, 0.0);
    for (int i = 0; i < 5; ++i)
        for (std::size_t j = 0; j < longitudes; ++j) {
            const double phi = 2 * std::numbers::pi * static_cast<double>(j) / longitudes;
            const double radius = std::sqrt(1 - nodes[i] * nodes[i]);
            const auto Y = basis_values<4>({radius * std::cos(phi), radius * std::sin(phi), nodes[i]});
            for (std::size_t a = 0; a < count; ++a)
                for (std::size_t b = 0; b < count; ++b)
                    gram[a * count + b] += weights[i] * (2 * std::numbers::pi / longitudes) * Y[a] * Y[b];
        }
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = 0; b < count; ++b) {
            INFO("functions " << a << " and " << b);
            CHECK(std::abs(gram[a * count + b] - (a == b)) < 1e-14);
        }
}

TEST_CASE("degree 3 has the constants, signs and order of 3DGS") {
    test::Rng rng(8);
    for (int trial = 0; trial < 10; ++trial) {
        const vec3<double> dir = normalize(rng.vec());
        const double x = dir.x, y = dir.y, z = dir.z, xx = x * x, yy = y * y, zz = z * z;
        const double expected[] = {0.28209479177387814,
                                   -0.4886025119029199 * y,
                                   0.4886025119029199 * z,
                                   -0.4886025119029199 * x,
                                   1.0925484305920792 * x * y,
                                   -1.0925484305920792 * y * z,
                                   0.31539156525252005 * (2 * zz - xx - yy),
                                   -1.0925484305920792 * x * z,
                                   0.5462742152960396 * (xx - yy),
                                   -0.5900435899266435 * y * (3 * xx - yy),
                                   2.890611442640554 * x * y * z,
                                   -0.4570457994644658 * y * (4 * zz - xx - yy),
                                   0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                                   -0.4570457994644658 * x * (4 * zz - xx - yy),
                                   1.445305721320277 * z * (xx - yy),
                                   -0.5900435899266435 * x * (xx - 3 * yy)};
        const auto Y = basis_values<3>(dir);
        for (std::size_t k = 0; k < Y.size(); ++k) {
            INFO("function " << k);
            CHECK(std::abs(Y[k] - expected[k]) < 1e-15);
        }
    }
}

TEST_CASE("degree 4 appends its nine functions, m = -4 to 4, in the forms on the sphere") {
    test::Rng rng(9);
    const vec3<double> dir = normalize(rng.vec());
    const double x = dir.x, y = dir.y, z = dir.z, xx = x * x, yy = y * y, zz = z * z;
    const double expected[] = {2.5033429417967046 * x * y * (xx - yy),
                               -1.7701307697799304 * y * z * (3 * xx - yy),
                               0.9461746957575601 * x * y * (7 * zz - 1),
                               -0.6690465435572892 * y * z * (7 * zz - 3),
                               0.10578554691520431 * (zz * (35 * zz - 30) + 3),
                               -0.6690465435572892 * x * z * (7 * zz - 3),
                               0.47308734787878004 * (xx - yy) * (7 * zz - 1),
                               -1.7701307697799304 * x * z * (xx - 3 * yy),
                               0.6258357354491761 * (xx * (xx - 3 * yy) - yy * (3 * xx - yy))};
    const auto Y3 = basis_values<3>(dir), Y4 = basis_values<4>(dir);
    for (std::size_t k = 0; k < Y3.size(); ++k) CHECK(Y4[k] == Y3[k]);
    for (std::size_t k = 0; k < 9; ++k) {
        INFO("function " << 16 + k);
        CHECK(std::abs(Y4[16 + k] - expected[k]) < 2e-15);
    }
}
