// SPDX-License-Identifier: Apache-2.0
/// @file  Tells a user how far a long job is, and asks whether to stop.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>

namespace gsh {

/// How far a stage of a job is.
struct StageReport {
    std::string stage;           ///< "registering poses"
    std::optional<double> share; ///< of the stage that is done, in [0, 1]; nothing if it is not known
    std::string details;         ///< "frame 12"; may be empty
    bool over = false;           ///< the last report of this stage
};

/// What a job calls while it runs, on the thread that started it. Either function may be empty.
struct Observer {
    std::function<void(const StageReport&)> report = {};
    std::function<bool()> stop = {}; ///< asked between pieces of work: true ends the job early

    [[nodiscard]] bool stopped() const { return stop && stop(); }
};

/// A stage of a job: reports its beginning, its progress, and its end when it goes out of scope.
class ObservedStage {
public:
    ObservedStage(const Observer& observer, std::string name) : observer_(&observer), name_(std::move(name)) {
        tell({}, {});
    }
    ObservedStage(const ObservedStage&) = delete;
    ObservedStage& operator=(const ObservedStage&) = delete;
    ~ObservedStage() {
        if (observer_->report) observer_->report({name_, {}, {}, true});
    }

    void tell(std::optional<double> share, std::string details) const {
        if (observer_->report) observer_->report({name_, share, std::move(details), false});
    }

private:
    const Observer* observer_;
    std::string name_;
};

} // namespace gsh
