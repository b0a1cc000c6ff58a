// SPDX-License-Identifier: Apache-2.0
/// @file  MakeHuman's adults in T-pose: the mean, its targets as displacements, and the directions of random adults.
#pragma once

#include <gsh/body/shape_directions.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/makehuman_people.hpp>
#include <gsh/io/body/makehuman_skeleton.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Displacements of the body's vertices and joints in T-pose.
struct TurnedShape {
    std::vector<float> vertices;      // [3 V]
    std::vector<vec3<double>> joints; // [55]
};

/// The mean of random adults in T-pose, and what each of MakeHuman's targets changes.
struct MakeHumanShapes {
    std::vector<vec3<double>> vertices; // [V] of the mean
    std::vector<vec3<double>> joints;   // [55]
    std::vector<double> areas;          // [V] of the skin around each vertex of the mean; 0 for eyes, teeth and tongue
    std::vector<std::vector<float>> targets;              // [T][3 V]
    std::vector<std::vector<vec3<double>>> target_joints; // [T][55]
    std::vector<double> mean;                             // [T] coefficients of the targets
    std::vector<double> covariance;                       // [T, T], block by block: body and face are independent
    std::size_t body_count = 0;                           ///< targets of the body; those of the face follow
    std::vector<TurnedShape> expressions;                 // [10]
};

/// The coefficients of all targets for a person, whose measures are given in the order of data.body_measures and
/// data.face_measures, or are 0 where the list ends.
[[nodiscard]] inline std::vector<double> target_coefficients(const MakeHumanData& data, const MakeHumanPerson& person,
                                                             Span<const double> measures = {});

/// A random adult's.
[[nodiscard]] inline std::vector<double> random_coefficients(const MakeHumanData& data, Rng& rng);

/// Draws `people` adults, and turns their mean, all targets and all expressions to a T-pose by the same rotations.
[[nodiscard]] inline MakeHumanShapes makehuman_shapes(const MakeHumanData& data, std::size_t people,
                                                      std::uint64_t seed);

/// A shape direction: the displacement for one standard deviation.
struct MakeHumanDirection {
    double variance = 0; ///< of the skin, m⁴: summed over its area
    TurnedShape shape;
};

/// The `body` directions in which random adults vary most, by area of the skin, and the `face` directions in which
/// random heads do, in order of variance. Growth is positive.
[[nodiscard]] inline std::vector<MakeHumanDirection> makehuman_directions(const MakeHumanShapes& shapes,
                                                                          std::size_t body, std::size_t face);

// -------------------------------------------------------------------------------------------------------------

inline std::vector<double> target_coefficients(const MakeHumanData& data, const MakeHumanPerson& person,
                                               Span<const double> measures) {
    std::vector<double> coefficients(data.targets.size(), 0.0);
    add_macro_targets(
        person, [&](const std::string& name, double share) { coefficients[data.macros.find(name)->second] += share; });
    for (std::size_t k = 0; k < measures.size(); ++k) {
        const std::size_t bodies = data.body_measures.size();
        const MakeHumanData::Measure& measure = k < bodies ? data.body_measures[k] : data.face_measures[k - bodies];
        coefficients[measures[k] > 0 ? measure.more : measure.less] += std::abs(measures[k]);
    }
    return coefficients;
}

inline std::vector<double> random_coefficients(const MakeHumanData& data, Rng& rng) {
    const MakeHumanPerson person = random_person(rng);
    std::vector<double> measures(data.body_measures.size() + data.face_measures.size());
    for (double& measure : measures) measure = random_measure(rng);
    return target_coefficients(data, person, measures);
}

namespace detail {

/// Means of coefficients, and the covariances of those of [first, last) with each other.
class CoefficientStatistics {
public:
    explicit CoefficientStatistics(std::size_t count) : mean(count, 0.0), covariance(count * count, 0.0) {}

    std::vector<double> mean, covariance;

    void measure(const std::vector<std::vector<double>>& rows, std::size_t body_count) {
        const std::size_t T = mean.size(), N = rows.size();
        for (const auto& row : rows)
            for (std::size_t t = 0; t < T; ++t) mean[t] += row[t] / static_cast<double>(N);
        for (const auto& [first, last] : {std::pair{std::size_t(0), body_count}, {body_count, T}}) {
            const auto size = static_cast<Eigen::Index>(last - first);
            Eigen::MatrixXd centred(static_cast<Eigen::Index>(N), size);
            for (std::size_t n = 0; n < N; ++n)
                for (std::size_t t = first; t < last; ++t)
                    centred(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(t - first)) = rows[n][t] - mean[t];
            const Eigen::MatrixXd products = centred.transpose() * centred / static_cast<double>(N);
            for (std::size_t t = first; t < last; ++t)
                for (std::size_t u = first; u < last; ++u)
                    covariance[t * T + u] =
                        products(static_cast<Eigen::Index>(t - first), static_cast<Eigen::Index>(u - first));
        }
    }
};

inline std::vector<double> skin_areas(const std::vector<vec3<double>>& vertices, const MakeHumanSurface& surface) {
    std::vector<double> areas(vertices.size(), 0.0);
    for (const auto& face : surface.faces) {
        const auto at = [&](int k) { return static_cast<std::size_t>(face[static_cast<std::size_t>(k)]); };
        if (surface.parts[at(0)] != 0) continue;
        const double area = length(cross(vertices[at(1)] - vertices[at(0)], vertices[at(2)] - vertices[at(0)])) / 2;
        for (int k = 0; k < 3; ++k) areas[at(k)] += area / 3;
    }
    return areas;
}

/// A block of a square matrix.
inline std::vector<double> square_block(const std::vector<double>& matrix, std::size_t width, std::size_t first,
                                        std::size_t last) {
    std::vector<double> block;
    for (std::size_t row = first; row < last; ++row)
        for (std::size_t column = first; column < last; ++column) block.push_back(matrix[row * width + column]);
    return block;
}

} // namespace detail

inline MakeHumanShapes makehuman_shapes(const MakeHumanData& data, std::size_t people, std::uint64_t seed) {
    check_value(people >= 2, "makehuman_shapes", "fewer than two people have no variance");
    MakeHumanShapes shapes;
    shapes.body_count = data.macros.size() + 2 * data.body_measures.size();
    std::vector<std::vector<double>> rows;
    for (std::size_t n = 0; n < people; ++n) {
        Rng rng(random_bits(seed, n));
        rows.push_back(random_coefficients(data, rng));
    }
    detail::CoefficientStatistics statistics(data.targets.size());
    statistics.measure(rows, shapes.body_count);
    shapes.mean = std::move(statistics.mean), shapes.covariance = std::move(statistics.covariance);

    std::vector<vec3<double>> rest = data.mesh.vertices;
    for (std::size_t t = 0; t < data.targets.size(); ++t)
        for (const MakeHumanOffset& row : data.targets[t])
            rest[static_cast<std::size_t>(row.vertex)] += row.offset * shapes.mean[t];
    const std::vector<mat3<double>> rotations = t_pose_rotations(data.skeleton, rest);
    const std::vector<vec3<double>> all = turned(data.skeleton, rotations, rest);
    for (const int v : data.surface.vertices) shapes.vertices.push_back(all[static_cast<std::size_t>(v)]);
    shapes.joints = turned_joints(data.skeleton, rotations, rest);
    shapes.areas = detail::skin_areas(shapes.vertices, data.surface);

    std::vector<vec3<double>> offsets(rest.size(), vec3<double>(0));
    const auto turn = [&](const std::vector<MakeHumanOffset>& target) {
        std::fill(offsets.begin(), offsets.end(), vec3<double>(0));
        for (const MakeHumanOffset& row : target) offsets[static_cast<std::size_t>(row.vertex)] += row.offset;
        const std::vector<vec3<double>> moved = turned(data.skeleton, rotations, offsets);
        TurnedShape shape{{}, turned_joints(data.skeleton, rotations, offsets)};
        for (const int v : data.surface.vertices)
            for (int axis = 0; axis < 3; ++axis)
                shape.vertices.push_back(static_cast<float>(moved[static_cast<std::size_t>(v)][axis]));
        return shape;
    };
    for (const auto& target : data.targets) {
        TurnedShape shape = turn(target);
        shapes.targets.push_back(std::move(shape.vertices));
        shapes.target_joints.push_back(std::move(shape.joints));
    }
    for (const auto& expression : data.expressions) shapes.expressions.push_back(turn(expression));
    return shapes;
}

inline std::vector<MakeHumanDirection> makehuman_directions(const MakeHumanShapes& shapes, std::size_t body,
                                                            std::size_t face) {
    const std::size_t T = shapes.targets.size();
    std::vector<MakeHumanDirection> directions;
    const auto add = [&](std::size_t first, std::size_t last, std::size_t count) {
        const std::vector<std::vector<float>> targets(shapes.targets.begin() + static_cast<std::ptrdiff_t>(first),
                                                      shapes.targets.begin() + static_cast<std::ptrdiff_t>(last));
        const ShapeMixture mixture =
            principal_mixture<double>(target_products(targets, shapes.areas),
                                      detail::square_block(shapes.covariance, T, first, last), last - first, count);
        for (std::size_t k = 0; k < mixture.count; ++k) {
            MakeHumanDirection direction{mixture.variances[k],
                                         {{}, std::vector<vec3<double>>(shapes.joints.size(), vec3<double>(0))}};
            std::vector<double> moved(3 * shapes.vertices.size(), 0.0);
            for (std::size_t t = first; t < last; ++t) {
                const double factor = mixture.mixing[(t - first) * mixture.count + k];
                for (std::size_t i = 0; i < moved.size(); ++i)
                    moved[i] += factor * static_cast<double>(shapes.targets[t][i]);
                for (std::size_t j = 0; j < shapes.joints.size(); ++j)
                    direction.shape.joints[j] += shapes.target_joints[t][j] * factor;
            }
            double growth = 0;
            for (std::size_t v = 0; v < shapes.vertices.size(); ++v)
                for (int axis = 0; axis < 3; ++axis)
                    growth +=
                        shapes.areas[v] * moved[3 * v + static_cast<std::size_t>(axis)] * shapes.vertices[v][axis];
            const double sign = growth < 0 ? -1 : 1;
            for (const double x : moved) direction.shape.vertices.push_back(static_cast<float>(sign * x));
            for (auto& joint : direction.shape.joints) joint *= sign;
            directions.push_back(std::move(direction));
        }
    };
    add(0, shapes.body_count, body);
    add(shapes.body_count, T, face);
    std::stable_sort(directions.begin(), directions.end(),
                     [](const auto& a, const auto& b) { return a.variance > b.variance; });
    return directions;
}

} // namespace gsh
