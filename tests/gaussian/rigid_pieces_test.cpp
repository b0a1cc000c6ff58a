// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/gaussian/rigid_pieces.hpp>
#include <gsh/math/rotation.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

using namespace gsh;

namespace {

/// Two clumps of points that turn about their own axes and drift apart.
struct TwoClumps {
    static constexpr std::size_t each = 300;
    std::vector<std::vector<vec3<float>>> frames;
    std::vector<std::uint32_t> order = std::vector<std::uint32_t>(2 * each);
    std::vector<Affine<double>> truth[2]; // of each clump and frame

    TwoClumps() {
        test::Rng rng(2);
        std::vector<vec3<double>> rest;
        for (std::size_t i = 0; i < 2 * each; ++i)
            rest.push_back(rng.vec(-0.2, 0.2) + vec3<double>(i < each ? 0 : 0.5, 0, 0));
        std::iota(order.begin(), order.end(), 0u);
        for (int t = 0; t < 4; ++t) {
            for (int c = 0; c < 2; ++c)
                truth[c].push_back({rotation_from_axis_angle(vec3<double>(0.2, c ? 0.3 : -0.4, 0.1) * double(t)),
                                    vec3<double>(c ? 0.2 : -0.2, 0, 0.1) * double(t)});
            std::vector<vec3<float>>& frame = frames.emplace_back();
            for (std::size_t i = 0; i < 2 * each; ++i)
                frame.push_back(vec3<float>(truth[i < each ? 0 : 1].back()(rest[i])));
        }
    }
};

} // namespace

TEST_CASE("clumps that move rigidly are found, with their motions") {
    const TwoClumps s;
    cpu::Serial serial;
    const RigidPieces pieces = rigid_pieces(serial, Span<const std::vector<vec3<float>>>(s.frames), s.order, 2);
    REQUIRE(pieces.count == 2);
    for (std::size_t i = 0; i < pieces.piece.size(); ++i)
        CHECK(pieces.piece[i] == pieces.piece[i < TwoClumps::each ? 0 : TwoClumps::each]);
    CHECK(pieces.piece[0] != pieces.piece[TwoClumps::each]);
    for (std::size_t t = 0; t < 4; ++t) {
        const auto motions = piece_motions(pieces, s.frames[0], s.frames[t]);
        for (int c = 0; c < 2; ++c) {
            const Affine<double>& found = motions[pieces.piece[c ? TwoClumps::each : 0]];
            for (int column = 0; column < 3; ++column)
                CHECK(length(found.linear[column] - s.truth[c][t].linear[column]) < 1e-5);
            CHECK(length(found.translation - s.truth[c][t].translation) < 1e-5);
        }
    }
}

TEST_CASE("more pieces fit a bending motion better, on any number of threads alike") {
    // A rod that bends: each point turns by an angle that grows along the rod.
    std::vector<std::vector<vec3<float>>> frames;
    test::Rng rng(3);
    const auto across = rng.vecs(2000, -0.002, 0.002);
    for (int t = 0; t < 3; ++t) {
        std::vector<vec3<float>>& frame = frames.emplace_back();
        for (std::size_t i = 0; i < across.size(); ++i) {
            const double along = static_cast<double>(i) / 2000, angle = 0.7 * t * along;
            frame.push_back(vec3<float>(rotation_from_axis_angle(vec3<double>(0, 0, angle)) *
                                        vec3<double>(across[i].x, along, across[i].z)));
        }
    }
    std::vector<std::uint32_t> order(2000);
    std::iota(order.begin(), order.end(), 0u);
    cpu::Serial serial;
    cpu::Threads threads(3);
    double before = HUGE_VAL;
    for (const std::size_t count : {1, 4, 16}) {
        const Span<const std::vector<vec3<float>>> all(frames);
        const RigidPieces pieces = rigid_pieces(serial, all, order, count);
        CHECK(rigid_pieces(threads, all, order, count).piece == pieces.piece);
        const auto motions = piece_motions(pieces, frames[0], frames[2]);
        double worst = 0;
        for (std::size_t i = 0; i < 2000; ++i)
            worst = std::max(worst,
                             length(motions[pieces.piece[i]](vec3<double>(frames[0][i])) - vec3<double>(frames[2][i])));
        CHECK(worst < 0.6 * before);
        before = worst;
    }
    CHECK(before < 0.03); // a piece does not stretch as the rod does
}

TEST_CASE("few points, or none") {
    cpu::Serial serial;
    const std::vector<std::vector<vec3<float>>> frames{{{0, 0, 0}, {1, 0, 0}}, {{0, 1, 0}, {1, 2, 0}}};
    const std::vector<std::uint32_t> order{0, 1};
    const Span<const std::vector<vec3<float>>> all(frames);
    const RigidPieces pieces = rigid_pieces(serial, all, order, 100);
    CHECK(pieces.count == 2);
    const auto motions = piece_motions(pieces, frames[0], frames[1]);
    CHECK(length(motions[pieces.piece[1]](vec3<double>(1, 0, 0)) - vec3<double>(1, 2, 0)) < 1e-6);
    CHECK_THROWS_AS((void)rigid_pieces(serial, Span<const std::vector<vec3<float>>>(), order, 2), ValueError);
    CHECK_THROWS_AS((void)rigid_pieces(serial, all, order, 0), ValueError);
    CHECK_THROWS_AS((void)rigid_pieces(serial, all, Span<const std::uint32_t>(order).subspan(0, 1), 2), ShapeError);
}
