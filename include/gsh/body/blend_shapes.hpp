// SPDX-License-Identifier: Apache-2.0
/// @file  Blend shapes: offsets of mesh vertices (or joints) that are linear in a few hundred coefficients.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <initializer_list>
#include <vector>

namespace gsh {

/// Private storage of a backend in backward, for instance partial sums. Each backend specialises it beside its
/// overloads.
template <Backend B, std::floating_point T>
struct BlendShapesScratch {
    static_assert(detail::overload_is_included<B>,
                  "BlendShapes: include its backend's overloads, <gsh/body/cpu/blend_shapes.hpp> or <gsh/cpu.hpp>");
};

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void blend_shapes_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "BlendShapes: include its backend's overloads, <gsh/body/cpu/blend_shapes.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void blend_shapes_backward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "BlendShapes: include its backend's overloads, <gsh/body/cpu/blend_shapes.hpp> or <gsh/cpu.hpp>");
}

/// offsets[v] += Σ_k directions[v, k] coefficients[k]: shape, expression and pose directions of a mesh, or their effect
/// on the joints (joint_directions, body_model.hpp).
///
/// The directions are constants and are stored once per vertex, not per Gaussian: a body with 486 pose directions has 5
/// million of them, and its 170,000 Gaussians would have 83 million. SurfaceInterpolation carries the summed offsets to
/// the Gaussians. Directions are stored one after the other, so that a pass streams each of them once, and a zero
/// coefficient costs nothing.
///
/// Shapes  coefficients [C], in the order of the blocks given; offsets [V].
/// Source  Loper et al., "SMPL", 2015, equations 8 and 9.
template <Backend B, std::floating_point T = float>
class BlendShapes {
public:
    /// The workspace of backward. The caller keeps it, so that steps of equal sizes allocate nothing.
    using Workspace = BlendShapesScratch<B, T>;

    /// Blocks of directions, each [V, its count] as in the body model: {shapedirs, exprdirs, posedirs}. Empty blocks
    /// are skipped.
    ///
    /// Errors  ShapeError where a block does not divide into vertex_count rows.
    BlendShapes(B& backend, std::size_t vertex_count, std::initializer_list<Span<const vec3<double>>> blocks)
        : backend_(&backend), vertex_count_(vertex_count) {
        for (const auto& block : blocks) {
            const std::size_t count = vertex_count ? block.size() / vertex_count : 0;
            check_size("BlendShapes", "directions", block.size(), vertex_count * count,
                       "store the same number of directions for each vertex");
            coefficient_count_ += count;
        }
        directions_.resize(vertex_count * coefficient_count_);
        std::vector<vec3<T>> one(vertex_count);
        std::size_t k = 0;
        for (const auto& block : blocks) {
            const std::size_t count = vertex_count ? block.size() / vertex_count : 0;
            for (std::size_t column = 0; column < count; ++column, ++k) {
                for (std::size_t v = 0; v < vertex_count; ++v) one[v] = vec3<T>(block[v * count + column]);
                backend.upload(Span<const vec3<T>>(one),
                               Span<vec3<T>>(directions_).subspan(k * vertex_count, vertex_count));
            }
        }
    }

    [[nodiscard]] std::size_t vertex_count() const { return vertex_count_; }
    [[nodiscard]] std::size_t coefficient_count() const { return coefficient_count_; }

    /// Adds to offsets, which start as zeros or as the points to be offset.
    void forward(Span<const T> coefficients, Span<vec3<T>> offsets) const {
        check_size("BlendShapes::forward", "coefficients", coefficients.size(), coefficient_count_);
        check_size("BlendShapes::forward", "offsets", offsets.size(), vertex_count_, "store one per vertex");
        check_memory(*backend_, "BlendShapes::forward", "coefficients", coefficients);
        check_memory(*backend_, "BlendShapes::forward", "offsets", offsets);
        if (vertex_count_ == 0 || coefficient_count_ == 0) return;
        blend_shapes_forward(*backend_, Span<const vec3<T>>(directions_), coefficients, offsets);
    }

    /// Adds to dL_dcoefficients.
    void backward(Span<const vec3<T>> dL_doffsets, Span<T> dL_dcoefficients, Workspace& workspace) const {
        check_size("BlendShapes::backward", "dL_doffsets", dL_doffsets.size(), vertex_count_, "store one per vertex");
        check_size("BlendShapes::backward", "dL_dcoefficients", dL_dcoefficients.size(), coefficient_count_);
        check_memory(*backend_, "BlendShapes::backward", "dL_doffsets", dL_doffsets);
        check_memory(*backend_, "BlendShapes::backward", "dL_dcoefficients", dL_dcoefficients);
        if (vertex_count_ == 0 || coefficient_count_ == 0) return;
        blend_shapes_backward(*backend_, Span<const vec3<T>>(directions_), dL_doffsets, dL_dcoefficients, workspace);
    }

private:
    B* backend_;
    std::size_t vertex_count_ = 0;
    std::size_t coefficient_count_ = 0;
    typename B::template Buffer<vec3<T>> directions_; // [C, V]
};

} // namespace gsh
