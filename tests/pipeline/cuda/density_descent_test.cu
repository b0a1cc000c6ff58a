// SPDX-License-Identifier: Apache-2.0
/// @file  A change of density control that a GPU plans is the host's.
#include <gsh/backend/serial.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/pipeline/cuda/density_descent.cuh>
#include <gsh/pipeline/density_descent.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::density_descent_on_device {
namespace {

using cuda::Device;
using detail::Kin;

struct Plan {
    DensityChange change;
    std::vector<std::uint32_t> parents;
    std::vector<Kin> kin;
};

template <class B>
Plan plan(const std::vector<Fate>& fates, const std::vector<float>& gradients, std::size_t split_count,
          std::size_t most) {
    B backend;
    typename B::template Buffer<Fate> f(fates.size());
    typename B::template Buffer<float> g(gradients.size());
    backend.upload(Span<const Fate>(fates), Span<Fate>(f));
    backend.upload(Span<const float>(gradients), Span<float>(g));
    detail::DescentBuffers<B> to;
    using detail::plan_descent;
    Plan result{.change = plan_descent(backend, Span<const Fate>(f), Span<const float>(g), split_count, most, to),
                .parents = std::vector<std::uint32_t>(to.parents.size()),
                .kin = std::vector<Kin>(to.kin.size())};
    backend.download(Span<const std::uint32_t>(to.parents), Span<std::uint32_t>(result.parents));
    backend.download(Span<const Kin>(to.kin), Span<Kin>(result.kin));
    return result;
}

void check_equal(const std::vector<Fate>& fates, const std::vector<float>& gradients, std::size_t split_count,
                 std::size_t most) {
    CAPTURE(fates.size());
    CAPTURE(most);
    const Plan found = plan<Device>(fates, gradients, split_count, most),
               expected = plan<cpu::Serial>(fates, gradients, split_count, most);
    CHECK(found.change.cloned == expected.change.cloned);
    CHECK(found.change.split == expected.change.split);
    CHECK(found.change.pruned == expected.change.pruned);
    CHECK(found.parents == expected.parents);
    CHECK(found.kin == expected.kin);
}

} // namespace

TEST_CASE("the children of Gaussians are those that the host plans, for any number and any mixture of fates") {
    if (test::skip_without_device()) return;
    for (const std::size_t count : {0u, 1u, 7u, 8u, 9u, 31u, 32u, 33u, 2047u, 2048u, 2049u, 6000u})
        for (const std::size_t split_count : {1u, 2u, 5u}) {
            Rng rng(count + split_count);
            std::vector<Fate> fates;
            std::vector<float> gradients;
            for (std::size_t i = 0; i < count; ++i) {
                fates.push_back(static_cast<Fate>(rng.below(4)));
                gradients.push_back(static_cast<float>(rng.uniform(0, 1)));
            }
            check_equal(fates, gradients, split_count, 1'000'000);
            for (const Fate fate : {Fate::keep, Fate::clone, Fate::split, Fate::prune})
                check_equal(std::vector<Fate>(count, fate), gradients, split_count, 1'000'000);
        }
}

TEST_CASE("a limit leaves the same Gaussians unchanged as on the host") {
    if (test::skip_without_device()) return;
    Rng rng(5);
    std::vector<Fate> fates;
    std::vector<float> gradients;
    for (std::size_t i = 0; i < 3000; ++i) {
        fates.push_back(static_cast<Fate>(rng.below(4)));
        gradients.push_back(static_cast<float>(rng.below(20))); // many ties
    }
    for (const std::size_t most : {0u, 1000u, 2250u, 2500u, 2999u, 3000u, 4000u})
        check_equal(fates, gradients, 2, most);
}

} // namespace gsh::density_descent_on_device
