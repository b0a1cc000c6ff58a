// SPDX-License-Identifier: Apache-2.0
/// @file  How exposure and white balance of photographs drift, found from the person's surface without training.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/check/capture_looks.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// A colour of a point of the surface in one image.
struct SeenColor {
    std::size_t image = 0;
    vec3<double> normal = vec3<double>(0); ///< of the surface there, in the world
    vec3<double> stops = vec3<double>(0);  ///< logarithms of linear red, green and blue to the base 2
};

/// Exposures of images from colours of the same points. A colour is the point's own, plus light that depends on its
/// normal, plus the exposure of its image:
///
///     stops = a_point + s · Y(normal) + g_image
///
/// Y are the spherical harmonics of bands 1 and 2, and s is the same for all images: a person who turns shows other
/// sides to the lamps, which is no exposure. The sum of absolute residuals is minimised, by weighted least squares from
/// which the points' own colours are eliminated, so shadows and wrong places count little.
///
/// Shapes  points: the colours of each point; camera_of [images]; the result is [images].
/// Units   stops, for red, green and blue; 0 in the mean over the images of a camera that have a colour. No value for
///         images without one.
/// Errors  ValueError for a colour of an image that does not exist.
///
/// A template so that Eigen's solver, which takes seconds to compile, is compiled only where this is called.
template <std::same_as<double> T = double>
[[nodiscard]] std::vector<std::optional<vec3<double>>>
exposures(const std::vector<std::vector<SeenColor>>& points, const std::vector<std::size_t>& camera_of) {
    constexpr std::size_t light = 8; // harmonics of bands 1 and 2
    constexpr int rounds = 6;
    const std::size_t images = camera_of.size(), unknowns = images + light;
    std::vector<char> seen(images, 0);
    for (const auto& point : points)
        for (const SeenColor& color : point) {
            check_value(color.image < images, "exposures", "a colour belongs to an image that does not exist");
            seen[color.image] = 1;
        }
    const auto harmonics = [](const vec3<double>& n) {
        return std::array<double, light>{n.x, n.y, n.z, n.x * n.y, n.y * n.z, n.z * n.x, n.x * n.x - n.y * n.y,
                                         3 * n.z * n.z - 1};
    };
    using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
    using Row = Eigen::Matrix<T, 1, Eigen::Dynamic>;
    Matrix found = Matrix::Zero(static_cast<Eigen::Index>(unknowns), 3);
    std::vector<std::vector<double>> weights(points.size());
    for (std::size_t p = 0; p < points.size(); ++p) weights[p].assign(points[p].size(), 1.0);
    for (int round = 0; round < rounds; ++round) {
        Matrix normal = Matrix::Zero(found.rows(), found.rows()), right = Matrix::Zero(found.rows(), 3);
        const auto at = [](std::size_t i) { return static_cast<Eigen::Index>(i); };
        for (std::size_t p = 0; p < points.size(); ++p) {
            // A row (1 at the image, Y) for each colour, less the weighted mean of the rows.
            const std::size_t count = points[p].size();
            if (count < 2) continue;
            Matrix Y(at(count), at(light)), stops(at(count), 3);
            Eigen::Matrix<T, Eigen::Dynamic, 1> weight(at(count));
            for (std::size_t i = 0; i < count; ++i) {
                const auto own = harmonics(points[p][i].normal);
                for (std::size_t k = 0; k < light; ++k) Y(at(i), at(k)) = own[k];
                for (int c = 0; c < 3; ++c) stops(at(i), c) = points[p][i].stops[c];
                weight(at(i)) = weights[p][i];
            }
            const double sum = weight.sum();
            const Matrix weighted = weight.asDiagonal() * Y;
            const Row mean_Y = weight.transpose() * Y / sum, mean = weight.transpose() * stops / sum;
            stops.rowwise() -= mean;
            for (std::size_t i = 0; i < count; ++i) {
                const Eigen::Index row = at(points[p][i].image);
                normal(row, row) += weight(at(i));
                for (std::size_t j = 0; j < count; ++j)
                    normal(row, at(points[p][j].image)) -= weight(at(i)) * weight(at(j)) / sum;
                const Row across = weighted.row(at(i)) - weight(at(i)) * mean_Y;
                normal.row(row).tail(at(light)) += across;
                normal.col(row).tail(at(light)) += across.transpose();
                right.row(row) += weight(at(i)) * stops.row(at(i));
            }
            normal.bottomRightCorner(at(light), at(light)) +=
                Y.transpose() * weighted - sum * mean_Y.transpose() * mean_Y;
            right.bottomRows(at(light)) += weighted.transpose() * stops;
        }
        // Weak pulls to 0 determine what no colour does, such as what all images have in common.
        normal.diagonal().array() += 1e-6 * std::max(1.0, normal.diagonal().maxCoeff());
        found = normal.ldlt().solve(right);
        for (std::size_t p = 0; p < points.size(); ++p) {
            const auto residual = [&](std::size_t i) {
                const SeenColor& color = points[p][i];
                const auto Y = harmonics(color.normal);
                double left = color.stops[1] - found(at(color.image), 1);
                for (std::size_t k = 0; k < light; ++k) left -= Y[k] * found(at(images + k), 1);
                return left;
            };
            double mean = 0, sum = 0;
            for (std::size_t i = 0; i < points[p].size(); ++i)
                mean += weights[p][i] * residual(i), sum += weights[p][i];
            for (std::size_t i = 0; i < points[p].size(); ++i)
                weights[p][i] = 1 / std::max(0.03, std::abs(residual(i) - mean / sum));
        }
    }
    std::vector<std::optional<vec3<double>>> result(images);
    for (std::size_t i = 0; i < images; ++i) {
        if (!seen[i]) continue;
        vec3<double> stops(0), count(0);
        for (std::size_t j = 0; j < images; ++j)
            for (int c = 0; c < 3 && seen[j] && camera_of[j] == camera_of[i]; ++c)
                stops[c] -= found(static_cast<Eigen::Index>(j), c), count[c] += 1;
        for (int c = 0; c < 3; ++c) stops[c] = found(static_cast<Eigen::Index>(i), c) + stops[c] / count[c];
        result[i] = stops;
    }
    return result;
}

/// The colours of points of the bodies' surfaces in views of a capture: vertices that an image shows in front, facing
/// the camera, inside the mask, and neither nearly black nor overexposed. At most about `most_points` vertices of each
/// person are looked up.
template <HostExecutor E>
[[nodiscard]] std::vector<std::vector<SeenColor>> seen_colors(CaptureLooks<E>& looks,
                                                                    const std::vector<CaptureView>& views,
                                                                    std::size_t most_points = 2000) {
    const Capture& capture = looks.capture();
    const std::vector<CheckedPerson>& people = looks.people();
    std::vector<std::size_t> steps, starts{0}; // of each person
    for (const CheckedPerson& person : people) {
        const std::size_t vertices = person.body->v_template.size();
        steps.push_back(std::max<std::size_t>(1, vertices / std::max<std::size_t>(1, most_points)));
        starts.push_back(starts.back() + (vertices + steps.back() - 1) / steps.back());
    }
    struct Seen {
        std::size_t point;
        SeenColor color;
    };
    std::vector<std::vector<Seen>> of_views(views.size());
    const CaptureReading as_given{std::vector<MotionReading>(people.size()),
                                  std::vector<CameraReading>(capture.cameras.size())};
    looks.start_from(as_given.motions);
    looks.for_views(views, as_given, [&](std::size_t i, const std::vector<Span<const vec3<double>>>& everybody) {
        const Camera<double>& camera = capture.cameras[views[i].camera].camera;
        const PixelImage image = capture.read_image(views[i]);
        cpu::Serial serial;
        std::vector<MeshImage> bodies;
        for (std::size_t p = 0; p < people.size(); ++p)
            bodies.push_back(rasterize_mesh(serial, everybody[p], people[p].body->faces, camera));
        for (std::size_t p = 0; p < people.size(); ++p) {
            const auto normals = vertex_normals(everybody[p], people[p].body->faces);
            for (std::size_t v = 0; v < everybody[p].size(); v += steps[p]) {
                const vec3<double> place = to_camera(camera, everybody[p][v]);
                if (place.z <= 0.01) continue;
                if (dot(normals[v], normalize(camera.center() - everybody[p][v])) < 0.4) continue;
                const vec2<double> pixel = to_pixel(camera, place);
                const int x = static_cast<int>(std::floor(pixel.x)), y = static_cast<int>(std::floor(pixel.y));
                if (pixel.x < 1 || pixel.y < 1 || x >= camera.width - 1 || y >= camera.height - 1) continue;
                const std::size_t index = whole_picture(camera.height, camera.width).index(x, y);
                const auto hidden = [&](const MeshImage& body) {
                    return body.covers(index) && body.depth[index] < place.z - 0.01;
                };
                if (std::any_of(bodies.begin(), bodies.end(), hidden)) continue;
                vec3<double> sum(0);
                bool usable = true;
                for (int row = y - 1; row <= y + 1; ++row)
                    for (int column = x - 1; column <= x + 1; ++column) {
                        const std::uint8_t* rgba = image.pixel(row, column);
                        usable = usable && rgba[3] == 255;
                        for (int c = 0; c < 3; ++c) {
                            usable = usable && rgba[c] >= 8 && rgba[c] <= 247;
                            sum[c] += srgb_to_linear(rgba[c] / 255.0);
                        }
                    }
                if (!usable) continue;
                SeenColor color{.image = i, .normal = normals[v]};
                for (int c = 0; c < 3; ++c) color.stops[c] = std::log2(sum[c] / 9);
                of_views[i].push_back({starts[p] + v / steps[p], color});
            }
        }
    });
    std::vector<std::vector<SeenColor>> points(starts.back());
    for (const auto& seen : of_views)
        for (const auto& [point, color] : seen) points[point].push_back(color);
    return points;
}

} // namespace gsh
