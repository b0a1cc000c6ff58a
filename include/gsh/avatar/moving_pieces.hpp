// SPDX-License-Identifier: Apache-2.0
/// @file  A motion of an avatar as rigid pieces: still Gaussians on frames that move, for formats without skinning.
#pragma once

#include <gsh/avatar/still_frames.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/ordered_indices.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/gaussian/rigid_pieces.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace gsh {

/// K pieces of N Gaussians over T frames.
///
/// Shapes  cloud [N], the Gaussians of a piece one after the other and in its frame; begins [K + 1]; poses [T, K], the
///         rigid maps from a piece's frame to the world.
struct MovingPieces {
    GaussianCloud<float> cloud;
    std::vector<std::size_t> begins;
    std::vector<std::vector<Affine<double>>> poses;
};

/// How a motion becomes rigid pieces.
struct MovingPiecesParams {
    std::size_t pieces = 512;         ///< K at most
    std::size_t division_frames = 12; ///< frames by which the Gaussians are divided, evenly spread
    std::size_t color_frames = 32;    ///< frames over which shapes and colours are averaged, evenly spread
};

namespace detail {

/// At most `most` of the frames, and at least one, evenly spread.
inline std::vector<std::size_t> spread_frames(Span<const std::size_t> frames, std::size_t most) {
    std::vector<std::size_t> some;
    const std::size_t count = std::min(std::max<std::size_t>(most, 1), frames.size());
    for (std::size_t k = 0; k < count; ++k)
        some.push_back(frames[count > 1 ? k * (frames.size() - 1) / (count - 1) : 0]);
    return some;
}

/// Means over frames of the Gaussians, each turned back by the motion of its piece.
class PieceMeans {
public:
    explicit PieceMeans(std::size_t count) : means_(count, vec3<double>(0)), covariances_(count, mat3<double>(0.0)) {}

    /// A frame, and the motions of the pieces that lead to it.
    template <CpuBackend B>
    void add(B& backend, const RigidPieces& pieces, const std::vector<Affine<double>>& motions,
             GaussianCloud<float> cloud) {
        const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        sh_.resize(cloud.sh.size(), vec3<double>(0));
        backend.for_chunks(cloud.size(), 512, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                const Affine<double>& pose = motions[pieces.piece[i]];
                const mat3<double> back = transpose(pose.linear);
                means_[i] += back * (vec3<double>(cloud.means[i]) - pose.translation);
                const quat<float>& q = cloud.quats[i];
                const mat3<double> F =
                    back * covariance_factor(quat<double>{q.w, q.x, q.y, q.z}, vec3<double>(cloud.log_scales[i]));
                covariances_[i] += F * transpose(F);
                with_sh_degree(cloud.sh_degree, [&](auto degree) {
                    turn_sh<decltype(degree)::value>(back, cloud.sh.data() + i * basis);
                });
                for (std::size_t k = 0; k < basis; ++k) sh_[i * basis + k] += vec3<double>(cloud.sh[i * basis + k]);
            }
        });
        cloud_ = std::move(cloud);
        ++frames_;
    }

    /// The means as Gaussians; opacities are those of the last frame, as of all.
    [[nodiscard]] GaussianCloud<float> cloud() && {
        const double share = 1 / static_cast<double>(frames_);
        for (std::size_t i = 0; i < cloud_.size(); ++i) {
            cloud_.means[i] = vec3<float>(means_[i] * share);
            const auto axes = principal_axes(covariances_[i] * share); // of a symmetric matrix: lengths are eigenvalues
            const quat<double> q = quat_from_rotation(axes.R);
            cloud_.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
            for (int k = 0; k < 3; ++k)
                cloud_.log_scales[i][k] = static_cast<float>(0.5 * std::log(std::max(axes.lengths[k], 1e-12)));
        }
        for (std::size_t k = 0; k < sh_.size(); ++k) cloud_.sh[k] = vec3<float>(sh_[k] * share);
        return std::move(cloud_);
    }

private:
    std::vector<vec3<double>> means_;
    std::vector<mat3<double>> covariances_;
    std::vector<vec3<double>> sh_;
    GaussianCloud<float> cloud_; // of the last frame
    std::size_t frames_ = 0;
};

/// Sets the cloud and the begins of `result`: sorted by pieces, each in a frame with its origin in the middle of the
/// piece. Returns the middles.
inline std::vector<vec3<double>> sort_by_pieces(const RigidPieces& pieces, GaussianCloud<float> cloud,
                                                MovingPieces& result) {
    const std::vector<std::uint32_t> order = ordered_indices(
        cloud.size(), [&](std::uint32_t a, std::uint32_t b) { return pieces.piece[a] < pieces.piece[b]; });
    std::vector<vec3<double>> middles(pieces.count, vec3<double>(0));
    result.begins.assign(pieces.count + 1, 0);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        middles[pieces.piece[i]] += vec3<double>(cloud.means[i]);
        ++result.begins[pieces.piece[i] + 1];
    }
    for (std::size_t k = 0; k < pieces.count; ++k) {
        middles[k] = middles[k] * (1 / static_cast<double>(result.begins[k + 1]));
        result.begins[k + 1] += result.begins[k];
    }
    for (std::size_t i = 0; i < cloud.size(); ++i)
        cloud.means[i] = vec3<float>(vec3<double>(cloud.means[i]) - middles[pieces.piece[i]]);
    result.cloud = reordered(cloud, Span<const std::uint32_t>(order));
    return middles;
}

} // namespace detail

/// Divides the Gaussians of an avatar into pieces that move nearly rigidly in the given frames of a motion
/// (RigidPieces). Place, shape and colour of a Gaussian in its piece are means over the frames, turned back by the
/// motion of the piece; so the light of the motion is its mean.
///
/// `proceed` is called before each frame with the share that is done; if it returns false, the result is empty.
///
/// Errors  ValueError without frames; those of StillFrames.
template <CpuBackend B>
[[nodiscard]] MovingPieces moving_pieces(
    B& backend, StillFrames<B>& still, const Motion& motion, Span<const std::size_t> frames,
    const MovingPiecesParams& params = {}, const std::function<bool(double)>& proceed = [](double) { return true; }) {
    check_value(!frames.empty(), "moving_pieces", "there must be a frame");
    std::vector<std::vector<vec3<float>>> ways;
    for (const std::size_t frame : detail::spread_frames(frames, params.division_frames))
        ways.push_back(still.means(motion, frame));
    GaussianCloud<float> places;
    places.means = ways[0];
    const RigidPieces pieces =
        rigid_pieces(backend, Span<const std::vector<vec3<float>>>(ways), morton_order(places), params.pieces);

    const std::vector<std::size_t> averaged = detail::spread_frames(frames, params.color_frames);
    const double steps = static_cast<double>(averaged.size() + frames.size());
    detail::PieceMeans sums(still.size());
    for (std::size_t n = 0; n < averaged.size(); ++n) {
        if (!proceed(static_cast<double>(n) / steps)) return {};
        GaussianCloud<float> cloud = still.frame(motion, averaged[n]);
        const auto motions = piece_motions(pieces, ways[0], cloud.means);
        sums.add(backend, pieces, motions, std::move(cloud));
    }
    GaussianCloud<float> cloud = std::move(sums).cloud();
    // The motions are those of the mean places, which are nearer to the frames than the first frame's.
    const std::vector<vec3<float>> rest = cloud.means;
    MovingPieces result;
    const std::vector<vec3<double>> middles = detail::sort_by_pieces(pieces, std::move(cloud), result);
    for (std::size_t n = 0; n < frames.size(); ++n) {
        if (!proceed(static_cast<double>(averaged.size() + n) / steps)) return {};
        result.poses.push_back(piece_motions(pieces, rest, still.means(motion, frames[n])));
        for (std::size_t k = 0; k < pieces.count; ++k) {
            Affine<double>& pose = result.poses.back()[k];
            pose.translation = pose(middles[k]);
        }
    }
    return result;
}

} // namespace gsh
