// SPDX-License-Identifier: Apache-2.0
/// @file  The increments with which a frame is posed: the frame's own and those that all frames share, with adjoint.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/span.hpp>
#include <gsh/train/estimated_motion.hpp>
#include <gsh/train/refinement_config.hpp>
#include <gsh/train/refinement_tables.hpp>

#include <array>
#include <concepts>
#include <cstddef>

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

} // namespace gsh
