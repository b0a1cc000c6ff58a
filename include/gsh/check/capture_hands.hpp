// SPDX-License-Identifier: Apache-2.0
/// @file  Tests whether a capture's hand poses include the body's mean hand, from the pixels around the hands.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/check/capture_looks.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

namespace detail {

/// 1 for each vertex of a hand; empty for a body without hands or without a mean hand.
inline std::vector<std::uint8_t> hand_vertices(const BodyModel& body) {
    const auto first = first_hand_joint(body.joint_count());
    if (!first || (body.hands_mean_left.empty() && body.hands_mean_right.empty())) return {};
    std::vector<std::uint8_t> result;
    for (std::size_t v = 0; v < body.vertex_count(); ++v) {
        double weight = 0;
        for (std::size_t j = *first; j < *first + 30; ++j) weight += body.weights[v * body.joint_count() + j];
        result.push_back(weight > 0.5);
    }
    return result;
}

} // namespace detail

/// For each person three overlaps of mask and bodies: with the poses as read, with the mean hand added to that person's
/// poses, and with it subtracted. They count the pixels where at least one of the three shows the person's hands. All
/// are empty for a body without hands or without a mean hand.
template <HostExecutor E>
[[nodiscard]] std::vector<std::array<Overlap, 3>>
hand_overlaps(CaptureLooks<E>& looks, const std::vector<CaptureView>& views, const CaptureReading& reading, int size) {
    constexpr std::array<int, 3> times{0, 1, -1};
    constexpr std::uint8_t hand = 1 << times.size();
    const std::size_t P = looks.people().size();
    std::vector<std::vector<std::uint8_t>> of_hand; // [person, vertex] whether the vertex is part of a hand
    for (const CheckedPerson& person : looks.people()) of_hand.push_back(detail::hand_vertices(*person.body));
    std::vector<std::array<Overlap, 3>> sums(P);
    if (std::all_of(of_hand.begin(), of_hand.end(), [](const auto& v) { return v.empty(); })) return sums;

    // [view, person, pixel] bits 0 to 2: covered under each of the three hypotheses; bit 3: one of them shows a hand.
    std::vector<std::vector<std::vector<std::uint8_t>>> seen(views.size());
    for (std::size_t h = 0; h < times.size(); ++h) {
        CaptureReading tried = reading;
        for (MotionReading& motion : tried.motions) motion.mean_hands += times[h];
        looks.for_views(views, tried, [&](std::size_t i, const auto& everybody) {
            const Camera<double> camera = looks.camera(views[i].camera, tried, size);
            seen[i].resize(P);
            for (std::size_t p = 0; p < P; ++p) {
                std::vector<std::uint8_t>& own = seen[i][p];
                own.resize(static_cast<std::size_t>(camera.height) * static_cast<std::size_t>(camera.width));
                if (everybody[p].empty() || (h > 0 && of_hand[p].empty())) continue; // absent, or no difference
                const auto& faces = looks.people()[p].body->faces;
                cpu::Serial serial;
                const MeshImage image = rasterize_mesh(serial, everybody[p], faces, camera);
                for (std::size_t pixel = 0; pixel < image.size(); ++pixel) {
                    if (!image.covers(pixel)) continue;
                    const auto& face = faces[static_cast<std::size_t>(image.triangle[pixel])];
                    own[pixel] |= static_cast<std::uint8_t>(1 << h);
                    if (!of_hand[p].empty() && of_hand[p][static_cast<std::size_t>(face[0])]) own[pixel] |= hand;
                }
            }
        });
    }
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (seen[i].empty()) continue; // the view has no pose
        const Silhouette mask = looks.mask(views[i], reading, size);
        for (std::size_t p = 0; p < P; ++p)
            for (std::size_t pixel = 0; pixel < mask.inside.size(); ++pixel) {
                if (!(seen[i][p][pixel] & hand)) continue;
                bool other = false;
                for (std::size_t q = 0; q < P; ++q) other = other || (q != p && seen[i][q][pixel] & 1);
                for (std::size_t h = 0; h < times.size(); ++h) {
                    const bool body = other || seen[i][p][pixel] >> h & 1, person = mask.inside[pixel] != 0;
                    sums[p][h] += {std::size_t(body && person), std::size_t(body || person)};
                }
            }
    }
    return sums;
}

} // namespace gsh
