// SPDX-License-Identifier: Apache-2.0
/// @file  Where docs/README.md answers a doubt of gsh-check or of the verdict on an avatar.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace gsh::programs {

/// A heading of docs/README.md with the doubts that it answers. A doubt is the `fault` of a CaptureFinding, or the
/// `doubt` of a CaptureAdvice or of an Advice.
struct Answer {
    std::string_view heading;
    std::vector<std::string_view> doubts;
};
[[nodiscard]] const std::vector<Answer>& answers();

/// `docs/README.md, "My hands are blurred"`, for one or several doubts; each heading once. gsh has no address on the
/// web, so programs name the file and the heading.
[[nodiscard]] std::string help_text(const std::vector<std::string>& doubts);

/// "docs/README.md#my-hands-are-blurred", for files that programs read.
[[nodiscard]] std::string help_link(std::string_view doubt);

} // namespace gsh::programs
