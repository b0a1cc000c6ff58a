// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/model/filled_points.hpp>

#include "support/guarded.hpp"
#include "support/small_training.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

/// Four Gaussians with two coefficients each, in rows of three vectors that end with the displacement.
template <class B>
void check_fill(B& backend) {
    std::vector<vec3<float>> rows;
    for (int i = 0; i < 12; ++i) rows.push_back(vec3<float>(static_cast<float>(i)));
    const std::vector<float> logits{0.1f, 0.2f, 0.3f, 0.4f};
    typename B::template Buffer<vec3<float>> learned(rows.size());
    typename B::template Buffer<float> opacity_logits(logits.size());
    backend.upload(Span<const vec3<float>>(rows), Span<vec3<float>>(learned));
    backend.upload(Span<const float>(logits), Span<float>(opacity_logits));
    const Span<const vec3<float>> all = learned;

    const PointFill<float> fill{{1, 3}, {vec3<float>(50), vec3<float>(60)}, {vec3<float>(7), vec3<float>(8)}, {2, 3}};
    FilledPoints<B, float> filled(backend, 4, 2, fill);
    filled.forward({all, 3, all.subspan(2, 10), 3}, opacity_logits);
    const AppearanceView<float> view = filled.view();
    CHECK(view.sh_stride == 2);
    std::vector<vec3<float>> sh(view.sh.size()), displacements(4);
    std::vector<float> found(4);
    backend.download(view.sh, Span<vec3<float>>(sh));
    backend.download(view.displacements, Span<vec3<float>>(displacements));
    backend.download(filled.opacity_logits(), Span<float>(found));
    const std::vector<float> expected{0, 1, 50, 0, 6, 7, 60, 0};
    REQUIRE(sh.size() == expected.size());
    for (std::size_t k = 0; k < sh.size(); ++k) CHECK(sh[k] == vec3<float>(expected[k]));
    CHECK(displacements == std::vector<vec3<float>>{vec3<float>(2), vec3<float>(7), vec3<float>(8), vec3<float>(8)});
    CHECK(found == std::vector<float>{0.1f, 2, 0.3f, 3});
}

} // namespace

TEST_CASE("filled Gaussians have what they are given, the others what they learned, on every backend") {
    cpu::Serial serial;
    cpu::Threads threads(2);
    test::Guarded guarded;
    check_fill(serial), check_fill(threads), check_fill(guarded);
}

TEST_CASE("a fill of points that do not exist, of points out of order or of other lengths is refused") {
    cpu::Serial backend;
    const vec3<float> v(0);
    using Filled = FilledPoints<cpu::Serial, float>;
    CHECK_THROWS_AS(Filled(backend, 4, 1, {{4}, {v}, {v}, {0}}), ValueError);
    CHECK_THROWS_AS(Filled(backend, 4, 1, {{2, 1}, {v, v}, {v, v}, {0, 0}}), ValueError);
    CHECK_THROWS_AS(Filled(backend, 4, 1, {{1}, {}, {v}, {0}}), ShapeError);
    CHECK_THROWS_AS(Filled(backend, 4, 1, {{1}, {v}, {v, v}, {0}}), ShapeError);
    CHECK_THROWS_AS(Filled(backend, 4, 1, {{1}, {v}, {v}, {}}), ShapeError);
}

TEST_CASE("a filled model shows the fill, does not learn, and is what it was when the fill is taken away") {
    const test::SmallScene scene;
    test::SmallTraining<cpu::Serial> training(scene);
    training.steps(3);
    training.model.update_canonical(0);
    const GaussianCloud<float> before = canonical_gaussians(training.backend, training.model);
    PointFill<float> fill{{0, 5}, {}, {}, {4, 4}};
    fill.colors.assign(2, vec3<float>(0.7f)), fill.displacements.assign(2, vec3<float>(0.01f));
    training.model.fill(fill);
    training.model.update_canonical(0);
    const GaussianCloud<float> with = canonical_gaussians(training.backend, training.model);
    const std::size_t basis = with.sh.size() / with.size();
    for (std::size_t i = 0; i < with.size(); ++i) {
        const bool given = i == 0 || i == 5;
        CHECK((with.opacity_logits[i] == (given ? 4 : before.opacity_logits[i])));
        CHECK((with.sh[i * basis] == (given ? vec3<float>(0.7f) : before.sh[i * basis])));
        CHECK((with.means[i] == before.means[i]) == !given);
    }
    CHECK_THROWS_AS(training.steps(1), ValueError);
    training.model.end_fill();
    training.model.update_canonical(0);
    const GaussianCloud<float> after = canonical_gaussians(training.backend, training.model);
    CHECK(after.sh == before.sh);
    CHECK(after.means == before.means);
    CHECK(after.opacity_logits == before.opacity_logits);
}
