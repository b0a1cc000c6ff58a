// SPDX-License-Identifier: Apache-2.0
#include <gsh/model/shared_field.hpp>

#include "support/appearance_probe.hpp"

#include <cstddef>
#include <string>

using namespace gsh;

namespace {

template <class B>
using Shared = SharedField<B, double, 2, 3, 2>;

static_assert(AppearancePolicy<Shared<cpu::Serial>, double>);
static_assert(AppearancePolicy<SharedField<cpu::Threads>, float>);

} // namespace

TEST_CASE("the shared field's adjoint is the gradient of colours and displacements, and adds") {
    test::check_appearance<Shared>(test::small_appearance());
}

TEST_CASE("a shared field that reads the time has another gradient at another frame") {
    test::check_appearance<Shared>(test::small_appearance(5), 3);
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    Shared<cpu::Serial> moving(backend, points, test::small_appearance(5)),
        still(backend, points, test::small_appearance());
    CHECK(moving.reads_time());
    CHECK(!still.reads_time());
    test::randomize(moving), test::randomize(still);
    const auto outputs = [&](auto& field, std::size_t frame) {
        return test::AppearanceProbe(field, points->size(), frame).outputs();
    };
    CHECK(outputs(moving, 1) != outputs(moving, 2));
    CHECK(outputs(still, 1) == outputs(still, 2));
    CHECK_THROWS_AS(moving.forward(5), ValueError);
}

TEST_CASE("a table each for coarse and fine levels has the right gradient, too") {
    AppearanceParams params = test::small_appearance();
    params.separate_tables = true;
    test::check_appearance<Shared>(params);
}

TEST_CASE("the last rows of the shared network make displacements and move at their rate") {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    Shared<cpu::Serial> field(backend, points, test::small_appearance());
    const auto arrays = field.learned();
    REQUIRE(arrays.size() == 2);
    CHECK(arrays[0].name == "shared_field.table");
    CHECK(arrays[0].row_size == 2);
    CHECK(arrays[1].name == "shared_field.network");
    CHECK(arrays[0].rate == 2e-3);
    CHECK(arrays[1].rate == 2e-3);
    CHECK(arrays[1].other.where == LearnedArray<double>::OtherRate::Where::tail);
    CHECK(arrays[1].other.rate == 5e-4);
    // With these weights at zero, displacements are zero and colours do not change.
    test::randomize(field);
    test::AppearanceProbe probe(field, points->size(), 0);
    const auto before = probe.outputs();
    const auto network = field.learned()[1];
    backend.fill(network.values.subspan(network.values.size() - network.other.width, network.other.width), 0.0);
    const auto after = probe.outputs();
    const std::size_t colors = 27 * points->size();
    for (std::size_t i = 0; i < before.size(); ++i) CHECK(after[i] == (i < colors ? before[i] : 0.0));
}

TEST_CASE("a shared field starts near zero, whatever the features") {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    Shared<cpu::Serial> field(backend, points, test::small_appearance());
    for (const double value : test::AppearanceProbe(field, points->size(), 0).outputs()) CHECK(std::abs(value) < 1e-2);
}

TEST_CASE("a fine level that the grid does not have is refused") {
    cpu::Serial backend;
    const auto points = test::scattered_points(backend);
    AppearanceParams params = test::small_appearance();
    params.fine_level = 12;
    CHECK_THROWS_AS(Shared<cpu::Serial>(backend, points, params), ValueError);
}
