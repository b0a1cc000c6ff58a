// SPDX-License-Identifier: Apache-2.0
/// @file  The barriers of one warp: which lanes know of each other's accesses.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::test {

/// A barrier of some lanes tells each of them what the others have done or been told so far.
class WarpBarriers {
public:
    /// Barriers so far, of any lanes. What a lane does is dated by it.
    [[nodiscard]] std::uint32_t count() const { return count_; }

    /// `whole` if these are all lanes of the warp: mostly they are, and then nothing need be kept for each lane.
    void pass(std::uint32_t lanes, bool whole) {
        ++count_;
        if (whole) {
            whole_ = count_;
            return;
        }
        if (told_.empty()) told_.resize(32, Dates{});
        Dates all{};
        for (std::size_t lane = 0; lane < 32; ++lane)
            if (lanes >> lane & 1u)
                for (std::size_t other = 0; other < 32; ++other) all[other] = std::max(all[other], told_[lane][other]);
        for (std::size_t lane = 0; lane < 32; ++lane)
            if (lanes >> lane & 1u) all[lane] = count_;
        for (std::size_t lane = 0; lane < 32; ++lane)
            if (lanes >> lane & 1u) told_[lane] = all;
    }

    /// Whether a lane knows what another did at a date.
    [[nodiscard]] bool knows(std::size_t lane, std::size_t other, std::uint32_t date) const {
        return date < whole_ || (!told_.empty() && date < told_[lane][other]);
    }

private:
    using Dates = std::array<std::uint32_t, 32>; // by lane: all that it did before

    std::uint32_t count_ = 0, whole_ = 0;
    std::vector<Dates> told_; // empty until there is a barrier of some lanes only
};

} // namespace gsh::test
