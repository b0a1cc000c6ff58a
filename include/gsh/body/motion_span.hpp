// SPDX-License-Identifier: Apache-2.0
/// @file  A span of a motion: its last share, or from one frame to another, and the frames that belong to it.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <string>
#include <vector>

namespace gsh {

/// A span of a motion: the last `share` of its frames in time, or the frames from `first` to `last`, both included.
/// "From to" is meant in time, too: in a motion whose frames are stored in another order than that of their times, the
/// span holds the frames whose times lie between those of the two.
struct MotionSpan {
    double share = 0;                ///< above 0 and below 1; 0: from `first` to `last`
    std::size_t first = 0, last = 0; ///< frames, counted from 0
    std::string name = "MotionSpan"; ///< begins the messages, for instance the name of an option
};

/// The frames of a span, in ascending order. A share is rounded to whole frames. Frames of the same time keep their
/// order.
///
/// Shapes  timestamps [frames]
/// Errors  ValueError for a share that is not between 0 and 1 or that is less than one frame, for a frame that does not
///         exist, a first frame that is later than the last, and a span of all frames.
[[nodiscard]] inline std::vector<std::size_t> span_frames(const MotionSpan& span, Span<const double> timestamps) {
    const std::size_t count = timestamps.size();
    const std::string of_all = " of " + std::to_string(count) + " frames";
    std::vector<std::size_t> order(count);
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return timestamps[a] != timestamps[b] ? timestamps[a] < timestamps[b] : a < b;
    });
    auto begin = order.begin(), end = order.end();
    if (span.share != 0) {
        check_value(span.share > 0 && span.share < 1, span.name,
                    "is a share of " + detail::number_text(span.share) + ", expected one above 0 and below 1");
        const auto size = static_cast<std::size_t>(std::lround(span.share * static_cast<double>(count)));
        check_value(size > 0, span.name, "is none" + of_all + ", expected a share of at least one frame");
        begin = end - static_cast<std::ptrdiff_t>(size);
    } else {
        for (const std::size_t frame : {span.first, span.last})
            check_value(frame < count, span.name,
                        "names frame " + std::to_string(frame) + of_all + ", expected frames from 0 to " +
                            std::to_string(count == 0 ? 0 : count - 1));
        begin = std::find(order.begin(), order.end(), span.first);
        const auto last = std::find(order.begin(), order.end(), span.last);
        check_value(begin <= last, span.name,
                    "begins with frame " + std::to_string(span.first) + ", which is later than frame " +
                        std::to_string(span.last) + ", its end; expected the earlier frame first");
        end = last + 1;
    }
    check_value(static_cast<std::size_t>(end - begin) < count, span.name,
                "is all" + of_all + ", expected to leave some to train on");
    std::vector<std::size_t> frames(begin, end);
    std::sort(frames.begin(), frames.end());
    return frames;
}

} // namespace gsh
