// SPDX-License-Identifier: Apache-2.0
/// @file  The increments with which a frame is posed: its own and those that all frames share, with adjoint.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/span.hpp>
#include <gsh/refine/estimated_motion.hpp>
#include <gsh/refine/refinement_params.hpp>
#include <gsh/refine/refinement_tables.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <vector>

namespace gsh {

/// Groups with a row for each frame.
inline constexpr std::array frame_groups{RefinementGroup::pose, RefinementGroup::transl, RefinementGroup::expression};

/// The sum of a frame's increments and the bias, w = w[frame] + bias, for pose and transl. Betas belong to all frames
/// anyway, and expression has no bias. Without a bias, nothing is copied.
template <Backend B, std::floating_point T>
class FrameIncrements {
public:
    explicit FrameIncrements(B& backend) : backend_(&backend) {}

    /// The result is valid until the next call.
    [[nodiscard]] PoseIncrements<const T> forward(const RefinementTables<B, T>& tables, std::size_t frame) {
        const auto sum = [&](RefinementGroup group, RefinementGroup bias, Buffer& buffer) {
            const Span<const T> own = tables.increments(group, frame);
            if (tables.rows(bias) == 0) return own;
            buffer.resize(own.size());
            const Span<T> result(buffer.data(), own.size());
            backend_->for_each(own.size(), detail::Incremented<T>{own, tables.increments(bias, 0), result});
            return Span<const T>(result);
        };
        return {sum(RefinementGroup::pose, RefinementGroup::pose_bias, pose_),
                sum(RefinementGroup::transl, RefinementGroup::transl_bias, transl_),
                tables.increments(RefinementGroup::expression, frame), tables.increments(RefinementGroup::betas, 0)};
    }

    /// Calls backward(increments, dL_dincrements), which adds the gradient with respect to forward's result, and adds
    /// that gradient to the frame's rows and to those of the bias.
    template <class Backward>
    void backward(RefinementTables<B, T>& tables, std::size_t frame, const Backward& backward) {
        const auto zeros = [&](RefinementGroup group, RefinementGroup bias, Buffer& buffer) {
            if (tables.rows(bias) == 0) return tables.gradient(group, frame);
            buffer.resize(tables.width(group));
            const Span<T> gradient(buffer.data(), tables.width(group));
            backend_->fill(gradient, T(0));
            return gradient;
        };
        const PoseIncrements<T> gradient{
            zeros(RefinementGroup::pose, RefinementGroup::pose_bias, dL_dpose_),
            zeros(RefinementGroup::transl, RefinementGroup::transl_bias, dL_dtransl_),
            tables.gradient(RefinementGroup::expression, frame), tables.gradient(RefinementGroup::betas, 0)};
        backward(forward(tables, frame), gradient);
        const auto add = [&](Span<const T> sum, RefinementGroup group, RefinementGroup bias) {
            if (tables.rows(bias) == 0) return;
            for (const Span<T> to : {tables.gradient(group, frame), tables.gradient(bias, 0)})
                backend_->for_each(sum.size(), detail::Accumulate<T>{sum, to});
        };
        add(gradient.pose, RefinementGroup::pose, RefinementGroup::pose_bias);
        add(gradient.transl, RefinementGroup::transl, RefinementGroup::transl_bias);
    }

private:
    using Buffer = typename B::template Buffer<T>;
    B* backend_;
    Buffer pose_, transl_, dL_dpose_, dL_dtransl_; // one frame's
};

/// Gives frames that are left out the increments of their neighbours in time that are not: linear between two
/// neighbours, those of the nearer one at the ends.
///
/// Shapes  times, left_out [frames]; times in seconds.
template <Backend B, std::floating_point T>
void carry_increments(RefinementTables<B, T>& tables, const std::vector<double>& times,
                      const std::vector<bool>& left_out) {
    std::vector<std::size_t> kept;
    for (std::size_t t = 0; t < times.size(); ++t)
        if (!left_out[t]) kept.push_back(t);
    if (kept.empty()) return;
    std::sort(kept.begin(), kept.end(), [&](std::size_t a, std::size_t b) { return times[a] < times[b]; });
    auto host = tables.host_increments();
    for (std::size_t t = 0; t < times.size(); ++t) {
        if (!left_out[t]) continue;
        const auto later = std::find_if(kept.begin(), kept.end(), [&](std::size_t k) { return times[k] > times[t]; });
        const std::size_t b = later == kept.end() ? kept.back() : *later, a = later == kept.begin() ? b : *(later - 1);
        const double share = a == b ? 0 : (times[t] - times[a]) / (times[b] - times[a]);
        for (const auto group : frame_groups) {
            const Span<T> mine = host(group, t), before = host(group, a), after = host(group, b);
            for (std::size_t i = 0; i < mine.size(); ++i) mine[i] = T(1 - share) * before[i] + T(share) * after[i];
        }
    }
    tables.set_increments(host);
}

} // namespace gsh
