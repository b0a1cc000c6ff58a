// SPDX-License-Identifier: Apache-2.0
#include <gsh/simd/pack.hpp>

#include <doctest/doctest.h>

#include <vector>

using namespace gsh;

TEST_CASE_TEMPLATE("a pack is a lane type whose lanes do what scalars do", S, float, double) {
    using P = Pack<S>;
    using Traits = LaneTraits<P>;
    static_assert(Lane<P> && Traits::width == P::size);
    static_assert(std::is_same_v<ScalarOf<P>, S>);
    alignas(64) S in[Traits::width], out[Traits::width];
    for (std::size_t i = 0; i < Traits::width; ++i) in[i] = static_cast<S>(i) * S(1.5) + S(0.25);
    const P x = P::load_aligned(in);

    const auto index = Traits::to_index(x);
    Traits::from_index(index).store_aligned(out);
    for (std::size_t i = 0; i < Traits::width; ++i)
        CHECK(out[i] == static_cast<S>(LaneTraits<S>::to_index(in[i])));

    std::vector<S> table(2 * Traits::width + 1);
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = static_cast<S>(i * i);
    Traits::gather(table.data(), index).store_aligned(out);
    for (std::size_t i = 0; i < Traits::width; ++i) CHECK(out[i] == table[static_cast<std::size_t>(in[i])]);

    const MaskOf<P> small = x < P(S(2));
    CHECK(any(small));
    CHECK_FALSE(any(x < P(S(-1))));
    select(small, x, P(S(-7))).store_aligned(out);
    for (std::size_t i = 0; i < Traits::width; ++i) CHECK(out[i] == (in[i] < S(2) ? in[i] : S(-7)));
    clamp(x, P(S(1)), P(S(3))).store_aligned(out);
    for (std::size_t i = 0; i < Traits::width; ++i) CHECK(out[i] == clamp(in[i], S(1), S(3)));
}
