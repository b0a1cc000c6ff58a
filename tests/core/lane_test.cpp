// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/lane.hpp>
#include <gsh/math/wide.hpp>

#include "support/elements.hpp"
#include "support/gradient.hpp"

using namespace gsh;

static_assert(Lane<float> && Lane<double> && Lane<Wide<float>> && Lane<Wide<double>>);
static_assert(!Lane<int> && !Lane<vec3<float>>);

TEST_CASE("the scalar functions are those of std") {
    CHECK(select(true, 1.0, 2.0) == 1);
    CHECK(select(false, 1u, 2u) == 2);
    CHECK(min(1.0f, 2.0f) == 1);
    CHECK(max(1.0, 2.0) == 2);
    CHECK(abs(-3.0) == 3);
    CHECK(clamp(5.0, 0.0, 1.0) == 1);
    CHECK(clamp(-5.0, 0.0, 1.0) == 0);
    CHECK(floor(-0.5) == -1);
    CHECK(log(exp(0.3)) == doctest::Approx(0.3));
    CHECK(sin(0.3) == std::sin(0.3));
    CHECK(cos(0.3f) == std::cos(0.3f));
    CHECK(sqrt(4.0) == 2);
    CHECK(LaneTraits<float>::to_index(3.9f) == 3u);
    CHECK(any(true));
    CHECK_FALSE(any(false));
    CHECK(bits_as<std::uint32_t>(1.0f) == 0x3f800000u);
    CHECK(bits_as<double>(std::uint64_t(0x4000000000000000u)) == 2);
    CHECK(multiply_add(2.0, 3.0, 4.0) == 10);
    CHECK(horner(2.0, 1.0, 3.0, 5.0) == 1 + 3 * 2 + 5 * 4);
}

namespace {

template <Lane T>
using Run = void (*)(test::Inputs<T>, test::Outputs<T>, const ScalarOf<T>* table);

/// Runs an element on a register of samples and on each sample alone. Registers compute exp and log by other
/// polynomials, so lanes agree to a few units in the last place of numbers near 1 and are not bit-identical.
template <class S>
void compare_lanes(const char* name, Run<Wide<S>> on_registers, Run<S> on_scalars, double tolerance) {
    using P = Wide<S>;
    constexpr std::size_t width = P::width;
    test::Rng rng(11);
    std::vector<S> table(test::element_table_size);
    for (S& number : table) number = static_cast<S>(rng.uniform(-1, 1));

    for (int round = 0; round < 8; ++round) {
        std::vector<S> in(width * test::element_inputs);
        for (S& number : in) number = static_cast<S>(rng.uniform(-1, 1));
        std::vector<P> packed(test::element_inputs), packed_out(test::element_outputs, P(S(0)));
        for (std::size_t k = 0; k < packed.size(); ++k) {
            alignas(64) S lanes[width];
            for (std::size_t lane = 0; lane < width; ++lane) lanes[lane] = in[lane * test::element_inputs + k];
            packed[k] = P::load(lanes);
        }
        on_registers(test::Inputs<P>(packed.data()), test::Outputs<P>(packed_out.data()), table.data());

        for (std::size_t lane = 0; lane < width; ++lane) {
            std::vector<S> out(test::element_outputs, S(0));
            on_scalars(test::Inputs<S>(in.data() + lane * test::element_inputs), test::Outputs<S>(out.data()),
                       table.data());
            for (std::size_t k = 0; k < out.size(); ++k) {
                alignas(64) S lanes[width];
                packed_out[k].store(lanes);
                const double expected = static_cast<double>(out[k]);
                INFO(name << ", round " << round << ", lane " << lane << ", output " << k << ": pack " << lanes[lane]
                          << ", scalar " << out[k]);
                REQUIRE(std::abs(static_cast<double>(lanes[lane]) - expected) <=
                        tolerance * std::max(1.0, std::abs(expected)));
            }
        }
    }
}

template <class Element, class S>
void compare_lanes(double tolerance) {
    compare_lanes<S>(
        Element::name, [](auto in, auto out, const S* table) { Element().run(in, out, table); },
        [](auto in, auto out, const S* table) { Element().run(in, out, table); }, tolerance);
}

} // namespace

TEST_CASE_TEMPLATE_DEFINE("every lane of a register computes what the scalar computes", Element, lanes_as_scalars) {
    compare_lanes<Element, float>(2e-5);
    compare_lanes<Element, double>(4e-14);
}
TEST_CASE_TEMPLATE_APPLY(lanes_as_scalars, test::Elements);
