// SPDX-License-Identifier: Apache-2.0
/// @file  Whether a capture's hands were posed with the body's mean hand, judged by the pixels around them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/train/capture_looks.hpp>
#include <gsh/train/capture_reading.hpp>
#include <gsh/train/silhouette.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

/// Overlap of mask and body as read, with the mean hand added to the poses, and with it taken away, over the pixels
/// where one of the three shows a hand. All are empty for a body that has no hands or no mean hand.
template <CpuBackend B>
[[nodiscard]] std::array<Overlap, 3> hand_overlaps(CaptureLooks<B>& looks, const std::vector<CaptureView>& views,
                                                   const CaptureReading& reading, int size) {
    constexpr std::array<int, 3> times{0, 1, -1};
    const BodyModel& body = looks.body();
    const auto first = first_hand_joint(body.joint_count());
    if (!first || (body.hands_mean_left.empty() && body.hands_mean_right.empty())) return {};
    std::vector<bool> of_hand; // per vertex
    for (std::size_t v = 0; v < body.vertex_count(); ++v) {
        double weight = 0;
        for (std::size_t j = *first; j < *first + 30; ++j) weight += body.weights[v * body.joint_count() + j];
        of_hand.push_back(weight > 0.5);
    }
    struct Seen {
        std::vector<std::uint8_t> body, hand; // [height, width]
    };
    std::array<std::vector<Seen>, 3> seen;
    for (std::size_t h = 0; h < 3; ++h) {
        seen[h].resize(views.size());
        CaptureReading tried = reading;
        tried.motion.mean_hands += times[h];
        looks.for_views(views, tried, [&](std::size_t i, const std::vector<vec3<double>>& vertices) {
            cpu::Serial serial;
            const MeshImage image = rasterize_mesh(serial, Span<const vec3<double>>(vertices), body.faces,
                                                   looks.camera(views[i].camera, tried, size));
            Seen& result = seen[h][i];
            result.body.resize(image.size()), result.hand.resize(image.size());
            for (std::size_t pixel = 0; pixel < image.size(); ++pixel) {
                if (!image.covers(pixel)) continue;
                const auto& face = body.faces[static_cast<std::size_t>(image.triangle[pixel])];
                result.body[pixel] = 1;
                result.hand[pixel] = of_hand[static_cast<std::size_t>(face[0])];
            }
        });
    }
    std::array<Overlap, 3> sums;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (seen[0][i].body.empty()) continue; // no pose
        const Silhouette person = looks.mask(views[i], reading, size);
        for (std::size_t pixel = 0; pixel < person.inside.size(); ++pixel) {
            if (!seen[0][i].hand[pixel] && !seen[1][i].hand[pixel] && !seen[2][i].hand[pixel]) continue;
            for (std::size_t h = 0; h < 3; ++h)
                sums[h] += {std::size_t(seen[h][i].body[pixel] & person.inside[pixel]),
                            std::size_t(seen[h][i].body[pixel] | person.inside[pixel])};
        }
    }
    return sums;
}

} // namespace gsh
