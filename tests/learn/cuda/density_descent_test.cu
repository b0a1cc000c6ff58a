// SPDX-License-Identifier: Apache-2.0
/// @file  A change of density control that a GPU plans is the host's.
#include <gsh/backend/serial.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/learn/cuda/density_descent.cuh>
#include <gsh/learn/density_descent.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"

#include <algorithm>
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

template <class B, class T>
Plan plan(const std::vector<Fate>& fates, const std::vector<T>& gradients, std::size_t split_count,
          std::size_t most) {
    B backend;
    typename B::template Buffer<Fate> f(fates.size());
    typename B::template Buffer<T> g(gradients.size());
    backend.upload(Span<const Fate>(fates), Span<Fate>(f));
    backend.upload(Span<const T>(gradients), Span<T>(g));
    detail::DescentBuffers<B> to;
    using detail::plan_descent;
    Plan result{.change = plan_descent(backend, Span<const Fate>(f), Span<const T>(g), split_count, most, to),
                .parents = std::vector<std::uint32_t>(to.parents.size()),
                .kin = std::vector<Kin>(to.kin.size())};
    backend.download(Span<const std::uint32_t>(to.parents), Span<std::uint32_t>(result.parents));
    backend.download(Span<const Kin>(to.kin), Span<Kin>(result.kin));
    return result;
}

template <class T>
void check_equal(const std::vector<Fate>& fates, const std::vector<T>& gradients, std::size_t split_count,
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
    for (const std::uint64_t gradients_of : {1u, 20u, 1'000'000u}) { // all equal, many ties, hardly any
        std::vector<Fate> fates;
        std::vector<double> gradients;
        for (std::size_t i = 0; i < 5000; ++i) {
            fates.push_back(static_cast<Fate>(rng.below(4)));
            gradients.push_back((rng.below(2) ? -1 : 1) * 1e-6 * static_cast<double>(rng.below(gradients_of)));
        }
        const std::vector<float> rounded(gradients.begin(), gradients.end());
        for (const std::size_t split_count : {1u, 2u, 3u, 6u})
            for (const std::size_t most : {0u, 3750u, 3751u, 3752u, 3753u, 4000u, 4500u, 6000u, 8000u, 20000u}) {
                CAPTURE(gradients_of);
                check_equal(fates, rounded, split_count, most);
                check_equal(fates, gradients, split_count, most);
            }
    }
}

TEST_CASE("a limit leaves the same Gaussians unchanged for numbers about a tile, with many ties") {
    if (test::skip_without_device()) return;
    for (const std::size_t count : {0u, 1u, 31u, 32u, 33u, 2047u, 2048u, 2049u})
        for (const bool all_tied : {true, false}) {
            CAPTURE(all_tied);
            Rng rng(count + 7);
            std::vector<float> gradients;
            for (std::size_t i = 0; i < count; ++i) { // the first and the last ones are larger than the others
                const bool tied = all_tied || (i >= 100 && i + 50 < count);
                gradients.push_back(tied ? 0.5f : static_cast<float>(rng.uniform(0.6, 1)));
            }
            for (const Fate fate : {Fate::clone, Fate::split})
                for (const std::size_t split_count : {2u, 3u}) {
                    const std::size_t growth = fate == Fate::split ? split_count - 1 : 1, all = count * (1 + growth);
                    // Room for all, for all but the last, for all but one of its children, for half of them, for none.
                    for (const std::size_t less : {std::size_t(0), std::size_t(1), growth, growth + 1, count / 2, all})
                        check_equal(std::vector<Fate>(count, fate), gradients, split_count, all - std::min(less, all));
                }
        }
}

TEST_CASE("children of blocks begin where those before end, for more blocks than are summed at a time") {
    if (test::skip_without_device()) return;
    for (const std::size_t blocks : {0u, 1u, 1023u, 1024u, 1025u, 2050u}) { // 2,048 Gaussians each
        CAPTURE(blocks);
        Rng rng(blocks);
        std::vector<std::uint32_t> sums, begin{0};
        for (std::size_t b = 0; b < blocks; ++b) {
            sums.push_back(static_cast<std::uint32_t>(rng.below(4097)));
            begin.push_back(begin.back() + sums.back());
        }
        Device device;
        const auto from = uploaded(device, sums);
        cuda::Buffer<std::uint32_t> to(blocks + 1);
        device.launch(1, cuda::detail::ScanDescent{from, to});
        CHECK(test::fetched(device, to) == begin);
    }
}

TEST_CASE("clones take the room that is too small for a split") {
    if (test::skip_without_device()) return;
    const std::vector<Fate> fates = {Fate::clone, Fate::split, Fate::clone, Fate::split, Fate::clone, Fate::keep};
    const std::vector<float> gradients = {1, 5, 3, 4, 2, 9};
    for (std::size_t most = 0; most < 16; ++most) check_equal(fates, gradients, 4, most);
    const Plan eleven = plan<Device>(fates, gradients, 4, 11); // the first split takes three places of five
    CHECK(eleven.change.split == 1);
    CHECK(eleven.change.cloned == 2);
    CHECK(eleven.parents == std::vector<std::uint32_t>{0, 1, 1, 1, 1, 2, 2, 3, 4, 4, 5});
}

} // namespace gsh::density_descent_on_device
