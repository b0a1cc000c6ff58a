// SPDX-License-Identifier: Apache-2.0
#include <gsh/model/appearance.hpp>
#include <gsh/model/shared_field.hpp>
#include <gsh/model/split_appearance.hpp>

#include "support/appearance_probe.hpp"

#include <cstddef>
#include <utility>

using namespace gsh;

namespace {

using AnyColors = AnyAppearance<double, 2>;

static_assert(AppearancePolicy<AnyColors, double>);
static_assert(std::constructible_from<AnyColors, SharedField<cpu::Serial, double, 2, 3, 2>>);
static_assert(!std::constructible_from<AnyColors, SharedField<cpu::Serial, double, 1, 3, 2>>); // another degree
static_assert(!std::constructible_from<AnyColors, SharedField<cpu::Serial, float, 2, 3, 2>>);  // another number type
static_assert(!std::constructible_from<AnyColors, int>);

/// A policy and the same policy inside AnyAppearance give bit-identical results.
template <class Policy>
void check_same_appearance(const AppearanceParams& params) {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    Policy policy(backend, points, params);
    AnyColors any = Policy(backend, points, params);
    test::randomize(policy), test::randomize(any);
    CHECK(any.reads_time() == policy.reads_time());
    CHECK(any.lookups() == policy.lookups());
    const auto expected = policy.learned(), found = any.learned();
    REQUIRE(found.size() == expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
        CHECK(found[i].name == expected[i].name);
        CHECK(found[i].rate == expected[i].rate);
        CHECK(found[i].other.where == expected[i].other.where);
        CHECK(found[i].other.rate == expected[i].other.rate);
        CHECK(found[i].row_size == expected[i].row_size);
        CHECK(found[i].touched_rows.size() == expected[i].touched_rows.size());
    }
    test::AppearanceProbe probe(policy, points->size(), 1);
    test::AppearanceProbe probe_any(any, points->size(), 1);
    probe.backward(), probe_any.backward();
    CHECK(probe_any.outputs() == probe.outputs());
    CHECK(test::learned_gradients(any) == test::learned_gradients(policy));
    any.release_memory();
    CHECK(probe_any.kept() == probe.kept());
    const AnyColors moved = std::move(any); // arrays still refer to the same memory
    CHECK(moved.lookups() == policy.lookups());
    CHECK(found[0].values[0] == expected[0].values[0]);
}

} // namespace

TEST_CASE("any appearance is bit-identical to the policy inside") {
    check_same_appearance<SharedField<cpu::Serial, double, 2, 3, 2>>(test::small_appearance(3));
    check_same_appearance<SeparateFields<cpu::Serial, double, 2, 3, 2>>(test::small_appearance());
    check_same_appearance<StoredAttributes<cpu::Serial, double, 2, 3, 2>>(test::small_appearance());
}
