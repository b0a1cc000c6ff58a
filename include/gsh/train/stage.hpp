// SPDX-License-Identifier: Apache-2.0
/// @file  The stages of a training step, and a clock that measures their time.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace gsh {

/// The stages of a training step, in order.
enum class Stage : std::size_t { photo, field_forward, pose, render, loss, render_backward, model_backward, update };
inline constexpr std::array<std::string_view, 8> stage_names{
    "photo", "field forward", "pose", "render", "loss", "render backward", "model backward", "update"};

/// An observer of steps that does nothing.
struct NoObserver {
    void enter(Stage) {}
    void leave() {}
};

/// Adds up the host's time in each stage, which is the time of the stage on backends that do their work at once.
class StageClock {
public:
    void enter(Stage stage) {
        const auto now = Clock::now();
        if (running_) add(now);
        stage_ = stage, entered_ = now, running_ = true;
    }
    /// Ends the step.
    void leave() {
        add(Clock::now());
        running_ = false;
        ++steps_;
    }

    /// Seconds in each stage over all steps, in the order of Stage.
    [[nodiscard]] const std::array<double, stage_names.size()>& seconds() const { return seconds_; }
    [[nodiscard]] std::uint64_t steps() const { return steps_; }

private:
    using Clock = std::chrono::steady_clock;

    void add(Clock::time_point now) {
        seconds_[static_cast<std::size_t>(stage_)] += std::chrono::duration<double>(now - entered_).count();
    }

    std::array<double, stage_names.size()> seconds_{};
    Stage stage_ = Stage::photo;
    Clock::time_point entered_;
    bool running_ = false;
    std::uint64_t steps_ = 0;
};

/// An observer that measures the stages of steps on a backend. A backend that queues its work specialises it; then pass
/// the observer to every step, and sample() adds the times of the last step.
template <class B>
class StageTimer : public StageClock {
public:
    explicit StageTimer(B&) {}
    void sample() {}
};

} // namespace gsh
