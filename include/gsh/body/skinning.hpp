// SPDX-License-Identifier: Apache-2.0
/// @file  Skinning: sparse weights, bones blended as matrices or as dual quaternions, and the adjoint to the bones.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/quat.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Skinning weights of N points, each with the same number of (joint, weight) slots.
///
/// Shapes  joints, weights [N, influences]; the weights of a point are sorted, largest first, and sum to 1. Unused
///         slots come last and have weight 0.
template <std::floating_point T>
struct SkinWeights {
    Span<const std::uint16_t> joints;
    Span<const T> weights;
    std::size_t influences = 0;

    [[nodiscard]] GSH_HD std::size_t size() const { return influences ? weights.size() / influences : 0; }
};

/// The weight of bone `joint` in a blend whose heaviest bone is `heaviest`. Unlike a dual quaternion, a matrix
/// represents its motion uniquely, so the weight is unchanged.
template <std::floating_point T>
[[nodiscard]] GSH_HD T blend_weight(Span<const Affine<T>>, std::size_t, std::size_t, T weight) {
    return weight;
}
/// Dual quaternions q and -q represent the same motion. Each bone takes the sign for which its rotation is nearer to
/// that of the heaviest bone, so that a blend takes the shorter way.
template <std::floating_point T>
[[nodiscard]] GSH_HD T blend_weight(Span<const dual_quat<T>> bones, std::size_t heaviest, std::size_t joint, T weight) {
    return dot(bones[heaviest].real, bones[joint].real) < T(0) ? -weight : weight;
}

/// Calls visit(joint, weight) for each bone that moves point i, the heaviest first; weights are those of blend_weight.
template <std::floating_point T, class Bone, class Visit>
GSH_INLINE GSH_HD void for_each_influence(const SkinWeights<T>& skin, std::size_t i, Span<const Bone> bones,
                                          const Visit& visit) {
    const std::size_t first = i * skin.influences;
    for (std::size_t k = first; k < first + skin.influences; ++k) {
        if (skin.weights[k] == T(0)) break; // sorted: the rest is padding
        visit(skin.joints[k], blend_weight(bones, skin.joints[first], skin.joints[k], skin.weights[k]));
    }
}

/// M = Σ_k weight_k bone_k, the transform of point i; dual quaternions are not normalised yet.
///
/// Sum     type in which the sum is kept: Bone, or one that holds the same numbers in registers. It has zero(),
///         add_scaled() and conversions from and to Bone.
template <class Sum, std::floating_point T, class Bone>
[[nodiscard]] GSH_INLINE GSH_HD Bone blend_in(const SkinWeights<T>& skin, std::size_t i, Span<const Bone> bones) {
    Sum blended = Sum::zero();
    for_each_influence(skin, i, bones, [&](std::size_t joint, T weight) {
        blended.add_scaled(static_cast<Sum>(bones[joint]), weight);
    });
    return static_cast<Bone>(blended);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD Affine<T> blend(const SkinWeights<T>& skin, std::size_t i, Span<const Affine<T>> bones) {
    return blend_in<Affine<T>>(skin, i, bones);
}
template <std::floating_point T>
[[nodiscard]] GSH_HD dual_quat<T> blend(const SkinWeights<T>& skin, std::size_t i, Span<const dual_quat<T>> bones) {
    return blend_in<dual_quat<T>>(skin, i, bones);
}

/// Adjoint of blend: adds to dL_dbones. The caller ensures that no other point writes there at the same time. The blend
/// is discontinuous where the sign of a dual quaternion changes (bones half a turn apart); near such a place, this is
/// the gradient on the side of the argument.
template <class Sum, std::floating_point T, class Bone>
GSH_INLINE GSH_HD void blend_backward_in(const SkinWeights<T>& skin, std::size_t i, Span<const Bone> bones,
                                         const Bone& dL_dblended, Span<Bone> dL_dbones) {
    const Sum term = static_cast<Sum>(dL_dblended);
    for_each_influence(skin, i, bones, [&](std::size_t joint, T weight) {
        Sum sum = static_cast<Sum>(dL_dbones[joint]);
        sum.add_scaled(term, weight);
        dL_dbones[joint] = static_cast<Bone>(sum);
    });
}
template <std::floating_point T>
GSH_HD void blend_backward(const SkinWeights<T>& skin, std::size_t i, Span<const Affine<T>> bones,
                           const Affine<T>& dL_dblended, Span<Affine<T>> dL_dbones) {
    blend_backward_in<Affine<T>>(skin, i, bones, dL_dblended, dL_dbones);
}
template <std::floating_point T>
GSH_HD void blend_backward(const SkinWeights<T>& skin, std::size_t i, Span<const dual_quat<T>> bones,
                           const dual_quat<T>& dL_dblended, Span<dual_quat<T>> dL_dbones) {
    blend_backward_in<dual_quat<T>>(skin, i, bones, dL_dblended, dL_dbones);
}

/// Skinning weights on the host, ready for upload: an owning array with the layout of SkinWeights.
template <std::floating_point T>
struct SkinWeightTable {
    std::vector<std::uint16_t> joints; // [N, influences]
    std::vector<T> weights;            // [N, influences]
    std::size_t influences = 0;

    [[nodiscard]] std::size_t size() const { return influences ? weights.size() / influences : 0; }
    [[nodiscard]] SkinWeights<T> view() const { return {joints, weights, influences}; }

    /// The same weights in another scalar type. They sum to 1 there, too: the largest weight absorbs the rounding.
    template <std::floating_point U>
    [[nodiscard]] SkinWeightTable<U> cast() const {
        SkinWeightTable<U> result{joints, std::vector<U>(weights.begin(), weights.end()), influences};
        for (std::size_t i = 0; i < size(); ++i) {
            U others = 0;
            for (std::size_t k = influences; k-- > 1;) others += result.weights[i * influences + k];
            result.weights[i * influences] = U(1) - others;
        }
        return result;
    }
};

/// Collects the weights of one point in sorted slots, then those of all points in a table.
class SkinWeightBuilder {
public:
    /// Keeps at most max_influences weights for each point (the largest, renormalised); 0 keeps all.
    explicit SkinWeightBuilder(std::size_t max_influences = 0) : max_influences_(max_influences) {}

    /// Adds `scale` times a dense row of weights to the current point.
    void add(Span<const double> row, double scale = 1) {
        sums_.resize(std::max(sums_.size(), row.size()), 0);
        for (std::size_t j = 0; j < row.size(); ++j) {
            if (!(row[j] * scale > 0)) continue;
            if (sums_[j] == 0) current_.push_back(static_cast<std::uint16_t>(j));
            sums_[j] += row[j] * scale;
        }
    }

    /// Closes the current point.
    ///
    /// Errors  ValueError if it has no positive weight.
    void finish_point() {
        check_value(!current_.empty(), "SkinWeightBuilder", "a point has no positive skinning weight");
        std::sort(current_.begin(), current_.end(), [&](std::uint16_t a, std::uint16_t b) {
            return sums_[a] != sums_[b] ? sums_[a] > sums_[b] : a < b;
        });
        const std::size_t kept = max_influences_ ? std::min(max_influences_, current_.size()) : current_.size();
        double total = 0;
        for (std::size_t k = 0; k < kept; ++k) total += sums_[current_[k]];
        for (std::size_t k = 0; k < kept; ++k) entries_.push_back({current_[k], sums_[current_[k]] / total});
        ends_.push_back(entries_.size());
        for (const std::uint16_t joint : current_) sums_[joint] = 0;
        current_.clear();
    }

    [[nodiscard]] SkinWeightTable<double> table() const {
        std::size_t influences = 0;
        for (std::size_t i = 0; i < ends_.size(); ++i) influences = std::max(influences, ends_[i] - begin(i));
        SkinWeightTable<double> result;
        result.influences = influences;
        result.joints.assign(ends_.size() * influences, 0);
        result.weights.assign(ends_.size() * influences, 0);
        for (std::size_t i = 0; i < ends_.size(); ++i)
            for (std::size_t k = begin(i); k < ends_[i]; ++k) {
                result.joints[i * influences + k - begin(i)] = entries_[k].first;
                result.weights[i * influences + k - begin(i)] = entries_[k].second;
            }
        return result;
    }

private:
    [[nodiscard]] std::size_t begin(std::size_t i) const { return i ? ends_[i - 1] : 0; }

    std::size_t max_influences_;
    std::vector<double> sums_;                              // dense row of the current point
    std::vector<std::uint16_t> current_;                    // its non-zero joints
    std::vector<std::pair<std::uint16_t, double>> entries_; // joints and weights of all finished points
    std::vector<std::size_t> ends_;
};

/// The weights of a dense [N, joint_count] matrix without its zeros.
///
/// Errors  ShapeError if the matrix is not rectangular, ValueError for a row without a positive weight.
[[nodiscard]] inline SkinWeightTable<double> sparse_weights(Span<const double> dense, std::size_t joint_count,
                                                            std::size_t max_influences = 0) {
    const std::size_t rows = joint_count ? dense.size() / joint_count : 0;
    check_size("sparse_weights", "dense", dense.size(), rows * joint_count, "store one weight per point and joint");
    SkinWeightBuilder builder(max_influences);
    for (std::size_t i = 0; i < rows; ++i) {
        builder.add(dense.subspan(i * joint_count, joint_count));
        builder.finish_point();
    }
    return builder.table();
}

/// Throws ShapeError unless joints and weights hold `count` points.
template <std::floating_point T>
void check_skin(std::string_view where, const SkinWeights<T>& skin, std::size_t count) {
    check_size(where, "weights.weights", skin.weights.size(), count * skin.influences,
               "store one weight per Gaussian and influence");
    check_size(where, "weights.joints", skin.joints.size(), skin.weights.size(), "store one joint per weight");
}

} // namespace gsh
