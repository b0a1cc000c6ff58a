// SPDX-License-Identifier: Apache-2.0
/// @file  Whether an avatar is good, in words, and what would make it better.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

/// What is known of an avatar after its evaluation. PSNR in dB, means over test images; NaN where no image shows it.
struct VerdictInput {
    double person = 0, face = 0, hands = 0;
    std::optional<double> seen_motion = {}, new_motion = {}; ///< on the person, with --hold-out-motion
    std::size_t gaussians = 0, unseen = 0;                   ///< unseen: by no photograph
    std::vector<std::size_t> doubtful_frames = {};           ///< that registration hardly believed
    bool refined = false;                                    ///< --refine
    std::uint64_t steps = 0, usual_steps = 0; ///< of training; of one with the same configuration
};

/// Something that can be improved.
struct Advice {
    std::string doubt; ///< its name: "weak-hands"
    std::string text;  ///< what is wrong, and what to do
};

/// A sentence on the whole, and what can be improved, the most important first.
struct Verdict {
    std::string headline;
    std::vector<Advice> advice;
};

/// Limits are those at which a reader of docs/quality.md sees a difference: the paper's configuration reaches 29 dB on
/// the person, 32 on the face and 26 on the hands of a capture with six cameras and exact poses.
[[nodiscard]] Verdict verdict_of(const VerdictInput& input);

} // namespace gsh::programs
