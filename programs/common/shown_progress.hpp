// SPDX-License-Identifier: Apache-2.0
/// @file  Shows a library's long jobs as lines of progress, and stops them after an interrupt.
#pragma once

#include "common/interrupts.hpp"
#include "common/progress.hpp"

#include <gsh/reconstruct/observer.hpp>

#include <memory>
#include <optional>

namespace gsh::programs {

/// An observer that shows a line of progress for each stage.
[[nodiscard]] inline Observer shown_progress() {
    const auto line = std::make_shared<std::optional<Progress>>(); // of the present stage
    return {.report =
                [line](const StageReport& report) {
                    if (report.over) return line->reset();
                    if (!*line) line->emplace(report.stage);
                    if (report.share) (*line)->show(*report.share, report.details);
                },
            .stop = [] { return interrupted.load(); }};
}

} // namespace gsh::programs
