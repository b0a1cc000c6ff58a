// SPDX-License-Identifier: Apache-2.0
#include <gsh/model/split_appearance.hpp>

#include "support/appearance_probe.hpp"

#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;

namespace {

template <class B>
using FieldsApart = SeparateFields<B, double, 2, 3, 2>;
template <class B>
using ColorsStored = StoredColorsFieldDisplacements<B, double, 2, 3, 2>;
template <class B>
using DisplacementsStored = FieldColorsStoredDisplacements<B, double, 2, 3, 2>;
template <class B>
using BothStored = StoredAttributes<B, double, 2, 3, 2>;

static_assert(AppearancePolicy<FieldsApart<cpu::Serial>, double> &&
              AppearancePolicy<ColorsStored<cpu::Serial>, double>);
static_assert(AppearancePolicy<DisplacementsStored<cpu::Serial>, double>);
static_assert(AppearancePolicy<StoredAttributes<cpu::Threads>, float>);

template <class A>
std::vector<std::string> names_of_sources(A& appearance) {
    std::vector<std::string> all;
    for (const auto& array : appearance.learned()) all.push_back(array.name);
    return all;
}

} // namespace

TEST_CASE("the adjoint of every split appearance is the gradient of colours and displacements, and adds") {
    SUBCASE("fields for both") {
        test::check_appearance<FieldsApart>(test::small_appearance());
    }
    SUBCASE("fields for both that read the time") {
        test::check_appearance<FieldsApart>(test::small_appearance(4), 2);
    }
    SUBCASE("colours stored") {
        test::check_appearance<ColorsStored>(test::small_appearance());
    }
    SUBCASE("displacements stored") {
        test::check_appearance<DisplacementsStored>(test::small_appearance(4), 1);
    }
    SUBCASE("both stored") {
        test::check_appearance<BothStored>(test::small_appearance());
    }
}

TEST_CASE("each split appearance announces what it learns, and reads tables for its fields alone") {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    const auto params = test::small_appearance();
    FieldsApart<cpu::Serial> fields(backend, points, params);
    ColorsStored<cpu::Serial> colors(backend, points, params);
    DisplacementsStored<cpu::Serial> displacements(backend, points, params);
    BothStored<cpu::Serial> both(backend, points, params);
    using Names = std::vector<std::string>;
    CHECK(names_of_sources(fields) ==
          Names{"sh_field.table", "sh_field.network", "displacement_field.table", "displacement_field.network"});
    CHECK(names_of_sources(colors) == Names{"sh", "displacement_field.table", "displacement_field.network"});
    CHECK(names_of_sources(displacements) == Names{"sh_field.table", "sh_field.network", "displacements"});
    CHECK(names_of_sources(both) == Names{"sh", "displacements"});
    CHECK(fields.lookups() == 2 * colors.lookups());
    CHECK(displacements.lookups() == colors.lookups());
    CHECK(colors.lookups() > 0);
    CHECK(both.lookups() == 0);
}

TEST_CASE("each source moves at its own rate, and stored bands at theirs") {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    AppearanceParams params = test::small_appearance();
    params.sh_rate = 1, params.displacement_rate = 2, params.stored_sh_rate = 3, params.stored_sh_bands = 0.5;
    params.stored_displacement_rate = 5;
    FieldsApart<cpu::Serial> fields(backend, points, params);
    BothStored<cpu::Serial> both(backend, points, params);
    CHECK(test::learned_array(fields, "sh_field.table").rate == 1);
    CHECK(test::learned_array(fields, "sh_field.network").rate == 1);
    CHECK(test::learned_array(fields, "displacement_field.network").rate == 2);
    CHECK(test::learned_array(both, "displacements").rate == 5);
    const auto sh = test::learned_array(both, "sh");
    CHECK(sh.rate == 3);
    CHECK(sh.other.where == LearnedArray<double>::OtherRate::Where::columns);
    CHECK(sh.other.width == 27);
    CHECK(sh.other.first == 3);
    CHECK(sh.other.rate == 1.5);
}

TEST_CASE("stored attributes start at zero and do not read the time") {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    BothStored<cpu::Serial> both(backend, points, test::small_appearance());
    CHECK(!both.reads_time());
    for (const double value : test::AppearanceProbe(both, points->size(), 0).outputs()) CHECK(value == 0);
    FieldsApart<cpu::Serial> fields(backend, points, test::small_appearance(3));
    CHECK(fields.reads_time());
    CHECK_THROWS_AS(fields.forward(3), ValueError);
}
