// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/shade.hpp>

#include "support/gradient.hpp"

using namespace gsh;

TEST_CASE("shade_backward is the gradient of shade inside and outside the clamp") {
    test::Rng rng(1);
    for (const ColorClamp clamping : {ColorClamp::both, ColorClamp::below}) {
        auto sh = rng.vecs(9), dL_dsh = std::vector(sh.size(), vec3<double>(0.0));
        // The constant coefficient puts red below 0, green inside and blue above 1, all away from the kinks.
        for (auto& coefficient : sh) coefficient *= 0.05;
        sh[0] += vec3<double>(-3, 0, 3);
        auto dir = normalize(rng.vec()), dL_ddir = vec3<double>(0.0);
        double ao = 0.7, dL_dao = 0;
        const auto weight = rng.vec();
        const auto loss = [&] { return dot(shade<2>(sh.data(), dir, ao, clamping), weight); };
        const vec3<double> color = shade<2>(sh.data(), dir, ao, clamping);
        CHECK(color.x == 0);
        CHECK((color.z == ao) == (clamping == ColorClamp::both));

        shade_backward<2>(sh.data(), dir, ao, clamping, weight, dL_dsh.data(), dL_ddir, dL_dao);
        test::check_gradient(loss, test::scalars(sh), test::scalars(dL_dsh));
        test::check_gradient(loss, test::scalars(dir), test::scalars(dL_ddir));
        test::check_gradient(loss, test::scalars(ao), test::scalars(dL_dao));
        for (const auto& gradient : dL_dsh) {
            CHECK(gradient.x == 0);
            CHECK((gradient.z == 0) == (clamping == ColorClamp::both));
        }

        const auto once = dL_dsh;
        const double once_ao = dL_dao;
        shade_backward<2>(sh.data(), dir, ao, clamping, weight, dL_dsh.data(), dL_ddir, dL_dao);
        for (std::size_t k = 0; k < sh.size(); ++k) CHECK(dL_dsh[k] == once[k] * 2.0);
        CHECK(dL_dao == 2 * once_ao);
    }
}

TEST_CASE("ao has a gradient even where it is 0") {
    const vec3<double> sh[] = {vec3<double>(0.5)}, weight(1, 2, 3);
    vec3<double> dL_dsh[] = {vec3<double>(0.0)}, dL_ddir(0.0);
    double dL_dao = 0;
    shade_backward<0>(sh, vec3<double>(0, 0, 1), 0.0, ColorClamp::both, weight, dL_dsh, dL_ddir, dL_dao);
    CHECK(dL_dao == doctest::Approx(6 * (0.5 + 0.5 * 0.28209479177387814)));
    CHECK(dL_dsh[0] == vec3<double>(0.0));
}

TEST_CASE("sh_of_color gives a Gaussian its colour back") {
    const vec3<double> color(0.1, 0.5, 0.9), sh[] = {sh_of_color(color)};
    const auto shaded = shade<0>(sh, vec3<double>(0, 0, 1), 1.0, ColorClamp::both);
    for (int c = 0; c < 3; ++c) CHECK(shaded[c] == doctest::Approx(color[c]).epsilon(1e-12));
}

TEST_CASE("no coefficients make grey") {
    const vec3<double> sh[] = {vec3<double>(0.0)};
    CHECK(shade<0>(sh, vec3<double>(1, 0, 0), 1.0, ColorClamp::below) == vec3<double>(0.5));
}
