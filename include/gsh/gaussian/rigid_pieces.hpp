// SPDX-License-Identifier: Apache-2.0
/// @file  Divides points that move into pieces that move nearly rigidly, and finds the rigid motion of each piece.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace gsh {

/// Which piece each point belongs to.
struct RigidPieces {
    std::vector<std::uint32_t> piece; // [N], below count
    std::size_t count = 0;            ///< K; each piece has at least one point
};

/// How points are divided.
struct RigidPiecesParams {
    int rounds = 8;    ///< of k-means over the points' ways
    int exchanges = 3; ///< rounds in which a point changes to a neighbouring piece whose motion fits it better
};

/// The rigid motions from `rest` that are nearest to where the points of each piece are in `moved`, in the sum of the
/// squared distances.
///
/// Shapes  rest, moved [N]; result [K].
/// Source  Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976; the rotation is that of the
///         polar decomposition.
[[nodiscard]] inline std::vector<Affine<double>> piece_motions(const RigidPieces& pieces, Span<const vec3<float>> rest,
                                                               Span<const vec3<float>> moved) {
    struct Sums {
        vec3<double> rest = vec3<double>(0), moved = vec3<double>(0);
        mat3<double> cross = mat3<double>(0.0); // Σ moved restᵀ about the middles
        double count = 0;
    };
    check_size("piece_motions", "rest", rest.size(), pieces.piece.size());
    check_size("piece_motions", "moved", moved.size(), pieces.piece.size());
    std::vector<Sums> sums(pieces.count);
    for (std::size_t i = 0; i < rest.size(); ++i) {
        Sums& s = sums[pieces.piece[i]];
        s.rest += vec3<double>(rest[i]), s.moved += vec3<double>(moved[i]), ++s.count;
    }
    for (Sums& s : sums) s.rest = s.rest * (1 / s.count), s.moved = s.moved * (1 / s.count);
    for (std::size_t i = 0; i < rest.size(); ++i) {
        Sums& s = sums[pieces.piece[i]];
        s.cross += outer(vec3<double>(moved[i]) - s.moved, vec3<double>(rest[i]) - s.rest);
    }
    std::vector<Affine<double>> motions;
    for (const Sums& s : sums) {
        // A single point has no direction: it then moves without turning.
        const mat3<double> R = s.count > 1 ? polar_rotation(s.cross) : mat3<double>(1.0);
        motions.push_back({R, s.moved - R * s.rest});
    }
    return motions;
}

namespace detail {

/// k-means over ways, one row of coordinates for each point, with the nearest few pieces of each point.
class WayClusters {
public:
    static constexpr std::size_t near_count = 6;
    using Near = std::array<std::uint32_t, near_count>; ///< the nearest pieces, nearest first

    WayClusters(Span<const std::vector<vec3<float>>> frames, std::size_t count)
        : dims_(3 * frames.size()), count_(count), ways_(frames[0].size() * dims_), centers_(dims_ * count),
          near_(frames[0].size()) {
        for (std::size_t i = 0; i < near_.size(); ++i)
            for (std::size_t d = 0; d < dims_; ++d) ways_[i * dims_ + d] = frames[d / 3][i][static_cast<int>(d % 3)];
    }

    /// Starts from points that are evenly spread over an order of the points.
    void start(Span<const std::uint32_t> order) {
        for (std::size_t k = 0; k < count_; ++k) {
            const std::size_t i = order[(2 * k + 1) * order.size() / (2 * count_)];
            for (std::size_t d = 0; d < dims_; ++d) centers_[d * count_ + k] = ways_[i * dims_ + d];
        }
    }

    template <HostExecutor E>
    void assign(E& executor) {
        executor.for_chunks(near_.size(), 512, [&](std::size_t, std::size_t begin, std::size_t end) {
            std::vector<float> distances(count_);
            for (std::size_t i = begin; i < end; ++i) {
                std::fill(distances.begin(), distances.end(), 0.0f);
                for (std::size_t d = 0; d < dims_; ++d) {
                    const float x = ways_[i * dims_ + d];
                    const float* const row = centers_.data() + d * count_;
                    for (std::size_t k = 0; k < count_; ++k) distances[k] += (x - row[k]) * (x - row[k]);
                }
                std::array<float, near_count> best;
                best.fill(std::numeric_limits<float>::infinity());
                near_[i].fill(0);
                for (std::size_t k = 0; k < count_; ++k) {
                    if (!(distances[k] < best.back())) continue;
                    std::size_t place = near_count - 1;
                    for (; place > 0 && distances[k] < best[place - 1]; --place)
                        best[place] = best[place - 1], near_[i][place] = near_[i][place - 1];
                    best[place] = distances[k], near_[i][place] = static_cast<std::uint32_t>(k);
                }
            }
        });
    }

    /// Moves each centre to the mean of its points; a centre without points stays.
    void update() {
        std::vector<double> sums(dims_ * count_), counts(count_);
        for (std::size_t i = 0; i < near_.size(); ++i) {
            ++counts[near_[i][0]];
            for (std::size_t d = 0; d < dims_; ++d) sums[d * count_ + near_[i][0]] += ways_[i * dims_ + d];
        }
        for (std::size_t d = 0; d < dims_; ++d)
            for (std::size_t k = 0; k < count_; ++k)
                if (counts[k] > 0) centers_[d * count_ + k] = static_cast<float>(sums[d * count_ + k] / counts[k]);
    }

    [[nodiscard]] const std::vector<Near>& near() const { return near_; }

private:
    std::size_t dims_, count_;
    std::vector<float> ways_;    // [N, dims]
    std::vector<float> centers_; // [dims, K], so that a loop over pieces reads neighbours
    std::vector<Near> near_;
};

inline constexpr std::uint32_t no_piece = std::numeric_limits<std::uint32_t>::max();

/// Numbers the pieces that have points, without gaps. Returns the new numbers [K]; no_piece for pieces without points.
inline std::vector<std::uint32_t> drop_empty_pieces(RigidPieces& pieces) {
    std::vector<std::uint32_t> number(pieces.count, no_piece);
    for (const std::uint32_t piece : pieces.piece) number[piece] = 0;
    std::uint32_t next = 0;
    for (std::uint32_t& n : number)
        if (n != no_piece) n = next++;
    for (std::uint32_t& piece : pieces.piece) piece = number[piece];
    pieces.count = next;
    return number;
}

} // namespace detail

/// Divides N points into at most `count` pieces, so that points of a piece stay near each other and move together:
/// first by k-means over the points' positions in all frames, then by exchanges between neighbouring pieces.
///
/// `order` lists the points so that neighbours are near in space; the first pieces are spread evenly over it.
///
/// Shapes  frames [T] of N positions each; order [N].
/// Errors  ShapeError for frames of different sizes; ValueError without frames, points or pieces.
template <HostExecutor E>
[[nodiscard]] RigidPieces rigid_pieces(E& executor, Span<const std::vector<vec3<float>>> frames,
                                       Span<const std::uint32_t> order, std::size_t count,
                                       const RigidPiecesParams& params = {}) {
    constexpr auto where = "rigid_pieces";
    check_value(!frames.empty() && !frames[0].empty() && count > 0, where,
                "there must be a frame, a point and a piece");
    const std::size_t N = frames[0].size();
    for (const auto& frame : frames) check_size(where, "a frame", frame.size(), N, "as many points as in the first");
    check_size(where, "order", order.size(), N);
    detail::WayClusters clusters(frames, std::min(count, N));
    clusters.start(order);
    for (int round = 0; round < params.rounds; ++round) clusters.assign(executor), clusters.update();
    clusters.assign(executor);
    RigidPieces pieces{std::vector<std::uint32_t>(N), std::min(count, N)};
    for (std::size_t i = 0; i < N; ++i) pieces.piece[i] = clusters.near()[i][0];

    for (int exchange = 0; exchange < params.exchanges; ++exchange) {
        // A piece that lost all of its points keeps its number until the end; nothing is near to its motion.
        RigidPieces filled = pieces;
        const std::vector<std::uint32_t> number = detail::drop_empty_pieces(filled);
        std::vector<std::vector<Affine<double>>> motions;
        for (const auto& frame : frames) motions.push_back(piece_motions(filled, frames[0], frame));
        executor.for_chunks(N, 512, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                double least = std::numeric_limits<double>::infinity();
                for (const std::uint32_t k : clusters.near()[i]) {
                    if (number[k] == detail::no_piece) continue;
                    double error = 0;
                    for (std::size_t t = 0; t < frames.size(); ++t) {
                        const vec3<double> difference =
                            motions[t][number[k]](vec3<double>(frames[0][i])) - vec3<double>(frames[t][i]);
                        error += dot(difference, difference);
                    }
                    if (error < least) least = error, pieces.piece[i] = k;
                }
            }
        });
    }
    detail::drop_empty_pieces(pieces);
    return pieces;
}

} // namespace gsh
