// SPDX-License-Identifier: Apache-2.0
/// @file  Lets the n-th allocation of a call fail, for n = 1, 2, ... The program counts and replaces all allocations.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>
#include <set>
#include <string>
#include <vector>

namespace gsh::test {

/// What failing_allocations.cpp counts on all threads. It replaces operator new, and malloc and its relatives, so that
/// allocations of C libraries fail, too; not under sanitizers, which have their own malloc.
namespace allocations {
/// From now on, the `fail_at`-th allocation fails; none for 0.
void begin(std::size_t fail_at);
/// No allocation fails from now on. Returns their number since begin().
std::size_t end();
/// Whether one failed since begin().
[[nodiscard]] bool one_failed();
/// Blocks of operator new that are allocated now. Those of malloc are not counted: libzip loses some when it fails.
[[nodiscard]] std::ptrdiff_t live();
} // namespace allocations

/// How thorough exhaust() is.
struct Thoroughness {
    std::size_t first = 60;  ///< so many allocations fail in turn,
    std::size_t sample = 40; ///< and so many of the others, chosen by a seed
    static constexpr std::uint64_t seed = 54;

    /// GSH_ALL_FAILURES, for the long form: the first 2000, and 500 of the others.
    [[nodiscard]] static Thoroughness of_environment(Thoroughness usual) {
        return std::getenv("GSH_ALL_FAILURES") ? Thoroughness{2000, 500} : usual;
    }
};

/// What became of the calls in which an allocation failed.
struct Exhausted {
    std::size_t allocations = 0; ///< of a call in which none fails
    std::size_t failed = 0;      ///< calls in which one failed
    std::size_t survived = 0;    ///< of these, the calls that did without it, with the same result

    void operator+=(const Exhausted& other) {
        allocations += other.allocations, failed += other.failed, survived += other.survived;
    }
};

namespace allocations {
/// The numbers of those that fail.
inline std::vector<std::size_t> chosen_failures(std::size_t count, const Thoroughness& how) {
    std::set<std::size_t> chosen;
    for (std::size_t n = 1; n <= std::min(count, how.first); ++n) chosen.insert(n);
    if (count > how.first && count - how.first <= how.sample)
        for (std::size_t n = how.first + 1; n <= count; ++n) chosen.insert(n);
    else if (count > how.first)
        for (std::uint64_t k = 0; chosen.size() < how.first + how.sample; ++k)
            chosen.insert(how.first + 1 + random_bits(Thoroughness::seed, k) % (count - how.first));
    return {chosen.begin(), chosen.end()};
}
} // namespace allocations

/// Lets allocations of call() fail, one per call. Each call must return the same result as without a failure, or throw
/// std::bad_alloc or an error of gsh; the next call must return the same result; and no block may be lost.
///
/// `prepare()` makes a fresh object for each call, and `call(object)` returns something with ==.
template <class Prepare, class Call>
Exhausted exhaust(const std::string& what, const Prepare& prepare, const Call& call, Thoroughness usual = {}) {
    CAPTURE(what);
    Exhausted sum;
    const auto expected = [&] { // once more than needed, so that what is made once and kept exists
        auto object = prepare();
        return call(object);
    }();
    std::ptrdiff_t lost = 0;
    {
        const std::ptrdiff_t before = allocations::live();
        {
            auto object = prepare();
            allocations::begin(0);
            const auto result = call(object);
            sum.allocations = allocations::end();
            if (!(result == expected)) FAIL_CHECK(what << ": two calls differ");
        }
        lost = allocations::live() - before;
        if (lost != 0) FAIL_CHECK(what << ": a call keeps " << lost << " blocks");
    }
    for (const std::size_t n : allocations::chosen_failures(sum.allocations, Thoroughness::of_environment(usual))) {
        std::string problem;
        problem.reserve(1000); // one block, also while it grows
        const std::ptrdiff_t before = allocations::live();
        {
            auto object = prepare();
            bool same = true, returned = false;
            std::string thrown;
            allocations::begin(n);
            try {
                const auto result = call(object);
                allocations::end();
                returned = true;
                same = result == expected;
            } catch (const std::bad_alloc&) {
                allocations::end();
            } catch (const Error&) {
                allocations::end();
            } catch (const std::exception& error) {
                allocations::end();
                thrown = error.what();
            }
            if (!allocations::one_failed()) break; // fewer than without a failure, as of a cache
            ++sum.failed;
            sum.survived += returned && same;
            if (!thrown.empty()) problem = "another exception: " + thrown;
            if (!same) problem = "another result, and no error";
            try {
                if (!(call(object) == expected)) problem += "; the next call has another result";
            } catch (const std::exception& error) {
                problem += "; the next call throws: " + std::string(error.what());
            }
        }
        if (const std::ptrdiff_t kept = allocations::live() - before; kept != 0)
            problem += "; " + std::to_string(kept) + " blocks are lost";
        if (!problem.empty()) FAIL_CHECK(what << ": allocation " << n << " of " << sum.allocations << ": " << problem);
    }
    return sum;
}

/// The same for a function without an object.
template <class Call>
Exhausted exhaust(const std::string& what, const Call& call, Thoroughness usual = {}) {
    return exhaust(what, [] { return 0; }, [&](int) { return call(); }, usual);
}

/// Prints the figures of a test.
inline void report(const std::string& what, const Exhausted& sum) {
    std::cout << what << ": " << sum.failed << " calls with a failed allocation (of " << sum.allocations
              << " allocations), " << sum.survived << " of them did without" << std::endl;
    CHECK(sum.failed > 0);
}

} // namespace gsh::test
