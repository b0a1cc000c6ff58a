// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/backend/threads.hpp>

#include "support/gradient.hpp"

using namespace gsh;

static_assert(std::is_trivially_copyable_v<GaussiansView<float>>);
static_assert(std::is_convertible_v<GaussiansView<float>, GaussiansView<const float>>);
static_assert(!std::is_convertible_v<GaussiansView<const float>, GaussiansView<float>>);
static_assert(std::is_convertible_v<SplatView<double>, SplatView<const double>>);

TEST_CASE("a cloud goes to a backend and comes back as it was") {
    test::Rng rng(1);
    for (const std::size_t count : {0, 1, 7}) {
        GaussianCloud<double> cloud(count, 2);
        for (auto& mean : cloud.means) mean = rng.vec();
        for (auto& coefficient : cloud.sh) coefficient = rng.vec();
        for (auto& logit : cloud.opacity_logits) logit = rng.uniform();
        cpu::Threads backend(2);
        Gaussians<cpu::Threads, double> gaussians;
        upload(backend, cloud, gaussians);
        CHECK(gaussians.size() == count);
        CHECK(gaussians.view().sh.size() == 9 * count);
        const GaussianCloud<double> back = download(backend, gaussians);
        CHECK(back.means == cloud.means);
        CHECK(back.sh == cloud.sh);
        CHECK(back.opacity_logits == cloud.opacity_logits);
        CHECK(back.sh_degree == 2);
    }
}

TEST_CASE("every attribute's size is checked, by name") {
    cpu::Serial backend;
    Gaussians<cpu::Serial, float> gaussians;
    const auto broken = [&](auto&& breakage) {
        GaussianCloud<float> cloud(3, 1);
        breakage(cloud);
        return cloud;
    };
    const auto fails = [&](const GaussianCloud<float>& cloud, const char* message) {
        CHECK_THROWS_WITH_AS(upload(backend, cloud, gaussians), message, ShapeError);
    };
    fails(broken([](auto& c) { c.quats.pop_back(); }),
          "upload: cloud.quats has 2 elements, expected 3; one quaternion per Gaussian");
    fails(broken([](auto& c) { c.log_scales.pop_back(); }),
          "upload: cloud.log_scales has 2 elements, expected 3; three log-scales per Gaussian");
    fails(broken([](auto& c) { c.opacity_logits.clear(); }),
          "upload: cloud.opacity_logits has 0 elements, expected 3; one opacity logit per Gaussian");
    fails(broken([](auto& c) { c.sh.pop_back(); }),
          "upload: cloud.sh has 11 elements, expected 12; (sh_degree + 1)² RGB coefficients per Gaussian");

    GaussianCloud<float> partial(3, 1);
    partial.quats.clear();
    CHECK_NOTHROW(check_gaussians("f", "dL_dgaussians", partial.view(), 3, true));
    CHECK_THROWS_AS(check_gaussians("f", "dL_dgaussians", partial.view(), 3), ShapeError);
    CHECK_THROWS_AS(check_gaussians("f", "dL_dgaussians", partial.view(), 4, true), ShapeError);
}

TEST_CASE("with_sh_degree turns a number into a template argument") {
    for (int degree = 0; degree <= 4; ++degree)
        CHECK(with_sh_degree(degree, [](auto d) { return sh_basis_count(d()); }) == (degree + 1) * (degree + 1));
    const auto nothing = [](auto) {};
    CHECK_THROWS_AS(with_sh_degree(5, nothing), ValueError);
    CHECK_THROWS_AS(with_sh_degree(-1, nothing), ValueError);
}

TEST_CASE("a resized cloud holds neutral Gaussians") {
    const GaussianCloud<double> cloud(2, 0);
    CHECK(cloud.quats[1].w == 1);
    CHECK(cloud.quats[1].x == 0);
    CHECK(cloud.means[1] == vec3<double>(0.0));
}

TEST_CASE("splats resize together") {
    Splats<cpu::Serial, float> splats;
    splats.resize(5);
    CHECK(splats.view().size() == 5);
    CHECK(splats.view().covariances.size() == 5);
    CHECK(splats.view().opacities.size() == 5);
    CHECK(splats.view().colors.size() == 5);
}
