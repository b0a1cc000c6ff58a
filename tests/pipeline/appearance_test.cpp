// SPDX-License-Identifier: Apache-2.0
#include <gsh/pipeline/appearance.hpp>
#include <gsh/pipeline/shared_field.hpp>
#include <gsh/pipeline/split_appearance.hpp>

#include "support/appearance_probe.hpp"

#include <cstddef>
#include <utility>

using namespace gsh;

namespace {

using B = cpu::Serial;
using Any = AnyAppearance<double, 2>;

static_assert(AppearancePolicy<Any, double>);
static_assert(std::constructible_from<Any, SharedField<B, double, 2, 3, 2>>);
static_assert(!std::constructible_from<Any, SharedField<B, double, 1, 3, 2>>); // another degree
static_assert(!std::constructible_from<Any, SharedField<B, float, 2, 3, 2>>);  // another number type
static_assert(!std::constructible_from<Any, int>);

/// A policy by itself and one behind AnyAppearance do the same, bit for bit.
template <class Policy>
void check_same(const AppearanceParams& params) {
    B backend;
    const auto points = test::scattered_points(backend);
    Policy policy(backend, points, params);
    Any any = Policy(backend, points, params);
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
    test::AppearanceProbe probe(policy, points->size(), 1), probe_any(any, points->size(), 1);
    probe.backward(), probe_any.backward();
    CHECK(probe_any.outputs() == probe.outputs());
    CHECK(test::learned_gradients(any) == test::learned_gradients(policy));
    const Any moved = std::move(any); // the memory that arrays refer to does not move
    CHECK(moved.lookups() == policy.lookups());
    CHECK(found[0].values[0] == expected[0].values[0]);
}

} // namespace

TEST_CASE("any appearance is bit-identical to the policy inside") {
    check_same<SharedField<B, double, 2, 3, 2>>(test::small_appearance(3));
    check_same<SeparateFields<B, double, 2, 3, 2>>(test::small_appearance());
    check_same<StoredAttributes<B, double, 2, 3, 2>>(test::small_appearance());
}
