// SPDX-License-Identifier: Apache-2.0
/// @file  Estimates the light of a capture from its photographs and the posed mesh, before an avatar is trained.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/photo.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Settings of a light estimate.
struct LightEstimateParams {
    std::size_t points = 4, directions = 12; ///< of the result
    std::size_t candidates = 128;            ///< places among which the points are found, on a sphere about the people
    double distance = 4;                     ///< metres; its radius
    std::size_t frames = 24;                 ///< at most this many are read, evenly spread over the photographed ones
    std::size_t photos_per_frame = 4;        ///< at most
    std::size_t vertices = 3000;             ///< at most, of each person
    bool shadows = true;                     ///< LightData::shadows of the result
    int rounds = 12;                         ///< of light and albedo in turns
    std::uint64_t seed = 0;
};

/// The light of a capture, and how well it explains the samples.
struct LightEstimate {
    LightData light;
    std::size_t samples = 0; ///< colours of mesh vertices that were read from photographs
    double psnr = 0;         ///< of these colours in sRGB, albedo times light against the photographs
    double psnr_even = 0;    ///< the same with one colour per vertex and no light
};

/// One person whose mesh is lit, and casts shadows.
struct LitPerson {
    const RigData* rig = nullptr;
    const Motion* motion = nullptr;
};

namespace detail {

/// Minimises xᵀ A x / 2 - bᵀ x over x >= 0 by descent along one coordinate at a time. A is symmetric and positive
/// definite; x is the start.
inline void solve_nonnegative(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, Eigen::VectorXd& x) {
    Eigen::VectorXd gradient = A * x - b;
    for (int sweep = 0; sweep < 500; ++sweep) {
        double moved = 0;
        for (Eigen::Index k = 0; k < x.size(); ++k) {
            const double next = std::max(0.0, x[k] - gradient[k] / A(k, k)), change = next - x[k];
            if (change == 0) continue;
            gradient += change * A.col(k);
            x[k] = next;
            moved = std::max(moved, std::abs(change));
        }
        if (moved <= 1e-9 * x.maxCoeff()) break;
    }
}

/// Colours of mesh vertices in photographs, and the irradiance that each light of unit intensity gives them.
struct LightSamples {
    struct Color {
        std::uint32_t vertex, row; ///< of the albedo; of the irradiances
        vec3<float> linear;
        float weight; ///< squared slope of the sRGB curve, so that errors count as they do on a display
    };
    std::vector<Color> colors;
    std::vector<vec3<float>> positions, normals; // [rows]
    std::vector<float> visibility;               // [rows, lights]
    std::size_t vertices = 0;

    [[nodiscard]] Eigen::MatrixXf irradiances(const LightData& light) const {
        const auto rows = static_cast<Eigen::Index>(positions.size());
        const std::size_t lights = light.size(), P = light.points.size();
        Eigen::MatrixXf G(static_cast<Eigen::Index>(lights), rows);
        for (std::size_t r = 0; r < positions.size(); ++r)
            for (std::size_t k = 0; k < lights; ++k) {
                vec3<float> l(k < P ? vec3<float>(light.points[k]) - positions[r]
                                    : vec3<float>(light.directions[k - P]));
                const float squared = dot(l, l);
                G(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(r)) =
                    visibility[r * lights + k] * std::max(0.0f, dot(normals[r], l)) / (squared * std::sqrt(squared));
            }
        return G;
    }
};

/// Albedos and intensities in turns, each by weighted least squares. Returns the intensities; the mean irradiance of
/// all colours is 1. psnr receives the fit's.
inline Eigen::VectorXd fit_intensities(const LightSamples& samples, const Eigen::MatrixXf& G, int rounds,
                                       double& psnr) {
    const Eigen::Index lights = G.rows();
    Eigen::VectorXd x = Eigen::VectorXd::Ones(lights);
    std::vector<vec3<double>> albedo(samples.vertices), numerator(samples.vertices);
    std::vector<double> denominator(samples.vertices);
    Eigen::VectorXf E;
    for (int round = 0;; ++round) {
        E = G.transpose() * x.cast<float>();
        double mean = 0;
        for (const auto& color : samples.colors) mean += E[color.row];
        mean /= static_cast<double>(samples.colors.size());
        x /= mean, E /= static_cast<float>(mean);
        std::fill(numerator.begin(), numerator.end(), vec3<double>(0));
        std::fill(denominator.begin(), denominator.end(), 1e-12);
        for (const auto& color : samples.colors) {
            const double e = E[color.row], w = color.weight;
            numerator[color.vertex] += vec3<double>(color.linear) * (w * e);
            denominator[color.vertex] += w * e * e;
        }
        for (std::size_t v = 0; v < samples.vertices; ++v) albedo[v] = numerator[v] * (1 / denominator[v]);
        if (round == rounds) break;

        const auto rows = static_cast<std::size_t>(G.cols());
        Eigen::VectorXf alpha = Eigen::VectorXf::Zero(G.cols()), beta = alpha;
        for (const auto& color : samples.colors) {
            const vec3<double>& a = albedo[color.vertex];
            alpha[color.row] += static_cast<float>(color.weight * dot(a, a));
            beta[color.row] += static_cast<float>(color.weight * dot(a, vec3<double>(color.linear)));
        }
        Eigen::MatrixXd A = Eigen::MatrixXd::Zero(lights, lights);
        constexpr std::size_t block = 4096; // sums of blocks in float, then in double
        for (std::size_t first = 0; first < rows; first += block) {
            const auto begin = static_cast<Eigen::Index>(first);
            const auto count = static_cast<Eigen::Index>(std::min(block, rows - first));
            const Eigen::MatrixXf scaled =
                G.middleCols(begin, count) * alpha.segment(begin, count).cwiseSqrt().asDiagonal();
            A += (scaled * scaled.transpose()).cast<double>();
        }
        A.diagonal().array() += 1e-6 * A.diagonal().mean() + 1e-12;
        solve_nonnegative(A, (G * beta).cast<double>(), x);
        if (!(x.maxCoeff() > 0)) x.setOnes();
    }
    double squared = 0;
    for (const auto& color : samples.colors)
        for (int c = 0; c < 3; ++c) {
            const double predicted = std::clamp(albedo[color.vertex][c] * static_cast<double>(E[color.row]), 0.0, 1.0);
            const double error = linear_to_srgb(predicted) - linear_to_srgb(static_cast<double>(color.linear[c]));
            squared += error * error;
        }
    psnr = -10 * std::log10(std::max(squared / (3 * static_cast<double>(samples.colors.size())), 1e-12));
    return x;
}

/// The places of the strongest points: the strongest candidate, moved to the centre of the light within half a radian
/// of it, then the strongest of the rest, and so on. Fewer candidates with light give fewer places; the rest are even.
inline std::vector<vec3<double>> strongest_places(const std::vector<vec3<double>>& directions,
                                                  const Eigen::VectorXd& strength, std::size_t count) {
    std::vector<double> left(directions.size());
    for (std::size_t k = 0; k < left.size(); ++k) left[k] = strength[static_cast<Eigen::Index>(k)];
    std::vector<vec3<double>> places;
    const std::vector<vec3<double>> even = even_directions(count);
    while (places.size() < count) {
        const auto best = static_cast<std::size_t>(std::max_element(left.begin(), left.end()) - left.begin());
        if (!(left[best] > 0)) {
            places.push_back(even[places.size()]);
            continue;
        }
        vec3<double> sum(0);
        for (std::size_t k = 0; k < left.size(); ++k)
            if (dot(directions[k], directions[best]) > std::cos(0.5)) sum += directions[k] * left[k], left[k] = 0;
        places.push_back(normalize(sum));
    }
    return places;
}

/// The meshes of all people in one frame, and the vertices of them that are sampled.
template <Backend B>
class PosedPeople {
public:
    PosedPeople(B& backend, Span<const LitPerson> people, const LightEstimateParams& params)
        : backend_(&backend), people_(people), maps_(backend), casters_(people.size()) {
        for (std::size_t p = 0; p < people.size(); ++p) {
            const BodyModel& body = people[p].rig->body;
            check_value(!body.faces.empty(), "estimate_light", "a body has no triangles, expected a mesh");
            std::vector<std::uint32_t> order =
                shuffled_indices(static_cast<std::uint32_t>(body.vertex_count()), mix_bits(params.seed + p));
            order.resize(std::min<std::size_t>(order.size(), params.vertices));
            chosen_.push_back(std::move(order));
            std::vector<vec3<std::uint32_t>> triangles;
            for (const auto& face : body.faces)
                triangles.push_back({static_cast<std::uint32_t>(face[0]), static_cast<std::uint32_t>(face[1]),
                                     static_cast<std::uint32_t>(face[2])});
            casters_[p].triangles.resize(triangles.size());
            backend.upload(Span<const vec3<std::uint32_t>>(triangles), casters_[p].triangles);
        }
    }

    [[nodiscard]] std::size_t sample_count() const { return total(chosen_); }
    [[nodiscard]] const std::vector<vec3<float>>& positions() const { return positions_; }
    [[nodiscard]] const std::vector<vec3<float>>& normals() const { return normals_; }

    void pose(std::size_t frame) {
        positions_.clear(), normals_.clear();
        for (std::size_t p = 0; p < people_.size(); ++p) {
            const auto& [rig, motion] = people_[p];
            const std::vector<double>& betas = motion->betas.empty() ? rig->betas : motion->betas;
            const std::vector<vec3<double>> vertices =
                pose_body(rig->body, motion->pose_at(frame), motion->transl[frame], betas,
                          motion->expression_at(frame), rig->joints)
                    .vertices;
            const std::vector<vec3<double>> normals = vertex_normals(vertices, rig->body.faces);
            std::vector<vec3<float>> all;
            for (const vec3<double>& vertex : vertices) all.push_back(vec3<float>(vertex));
            casters_[p].vertices.resize(all.size());
            backend_->upload(Span<const vec3<float>>(all), casters_[p].vertices);
            for (const std::uint32_t v : chosen_[p])
                positions_.push_back(all[v]), normals_.push_back(vec3<float>(normals[v]));
        }
        receivers_.resize(positions_.size()), receiver_normals_.resize(normals_.size());
        backend_->upload(Span<const vec3<float>>(positions_), receivers_);
        backend_->upload(Span<const vec3<float>>(normals_), receiver_normals_);
    }

    /// [samples, lights] on the host.
    [[nodiscard]] std::vector<float> visibility(const LightData& light) {
        std::vector<vec3<float>> points(light.points.begin(), light.points.end()),
            directions(light.directions.begin(), light.directions.end());
        std::vector<float> intensities(light.size(), 0);
        points_.resize(points.size()), directions_.resize(directions.size()), intensities_.resize(light.size());
        backend_->upload(Span<const vec3<float>>(points), points_);
        backend_->upload(Span<const vec3<float>>(directions), directions_);
        backend_->upload(Span<const float>(intensities), intensities_);
        std::vector<ShadowCaster<float>> casters;
        for (const Caster& caster : casters_) casters.push_back({caster.vertices, caster.triangles});
        visibility_.resize(positions_.size() * light.size());
        if (!light.shadows) return std::vector<float>(visibility_.size(), 1.0f);
        maps_.forward(casters, {.points = points_, .directions = directions_, .log_intensities = intensities_},
                      receivers_, receiver_normals_, visibility_, cache_);
        std::vector<float> result(visibility_.size());
        backend_->download(Span<const float>(visibility_), Span<float>(result));
        return result;
    }

private:
    template <class T>
    using Buffer = typename B::template Buffer<T>;
    struct Caster {
        Buffer<vec3<float>> vertices;
        Buffer<vec3<std::uint32_t>> triangles;
    };
    static std::size_t total(const std::vector<std::vector<std::uint32_t>>& lists) {
        std::size_t sum = 0;
        for (const auto& list : lists) sum += list.size();
        return sum;
    }

    B* backend_;
    Span<const LitPerson> people_;
    ShadowMaps<B, float> maps_;
    typename ShadowMaps<B, float>::Cache cache_;
    std::vector<Caster> casters_;
    std::vector<std::vector<std::uint32_t>> chosen_; // vertices of each person
    std::vector<vec3<float>> positions_, normals_;   // of the samples, on the host
    Buffer<vec3<float>> receivers_, receiver_normals_, points_, directions_;
    Buffer<float> intensities_, visibility_;
};

/// The colour of a photograph at a pixel position, bilinear in linear light. False near the mask's edge, where the
/// nearest pixels in any direction are not the person's, and where a channel is overexposed.
[[nodiscard]] inline bool read_color(const Photo& photo, const vec2<double>& pixel, vec3<float>& linear) {
    constexpr int margin = 2;
    const int x = static_cast<int>(std::floor(pixel.x - 0.5)), y = static_cast<int>(std::floor(pixel.y - 0.5));
    const int width = photo.camera.width, height = photo.camera.height;
    if (x < margin || y < margin || x + 1 + margin >= width || y + 1 + margin >= height) return false;
    const auto at = [&](int column, int row) {
        return photo.rgba.data() + 4 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                                        static_cast<std::size_t>(column));
    };
    for (const int dy : {-margin, 0, 1, 1 + margin})
        for (const int dx : {-margin, 0, 1, 1 + margin})
            if (at(x + dx, y + dy)[3] != 255) return false;
    const double u = pixel.x - 0.5 - x, v = pixel.y - 0.5 - y;
    for (int c = 0; c < 3; ++c) {
        const auto value = [&](int dx, int dy) { return srgb_to_linear(at(x + dx, y + dy)[c] / 255.0); };
        const double mixed = (value(0, 0) * (1 - u) + value(1, 0) * u) * (1 - v) +
                             (value(0, 1) * (1 - u) + value(1, 1) * u) * v;
        if (mixed > 0.95) return false;
        linear[c] = static_cast<float>(mixed);
    }
    return true;
}

/// Reads colours of the samples in all chosen frames, and their visibilities from a light.
template <Backend B>
[[nodiscard]] LightSamples read_samples(PosedPeople<B>& people, Span<const Photo> photos,
                                        const std::vector<std::size_t>& frames, const LightData& light,
                                        const LightEstimateParams& params) {
    LightSamples samples;
    samples.vertices = people.sample_count();
    const std::size_t S = samples.vertices, K = light.size();
    for (const std::size_t frame : frames) {
        std::vector<const Photo*> views;
        for (const Photo& photo : photos)
            if (photo.frame == frame) views.push_back(&photo);
        if (views.size() > params.photos_per_frame) { // evenly spread, beginning elsewhere in each frame
            std::vector<const Photo*> some;
            for (std::size_t k = 0; k < params.photos_per_frame; ++k)
                some.push_back(views[(frame + k * views.size() / params.photos_per_frame) % views.size()]);
            views = std::move(some);
        }
        people.pose(frame);
        LightData eyes; // a camera sees what a light at its centre would reach
        for (const Photo* photo : views) eyes.points.push_back(photo->camera.center());
        const std::vector<float> seen = people.visibility(eyes), lit = people.visibility(light);
        for (std::size_t s = 0; s < S; ++s) {
            const vec3<double> position(people.positions()[s]), normal(people.normals()[s]);
            std::uint32_t row = UINT32_MAX; // made when the first colour of the sample is read
            for (std::size_t k = 0; k < views.size(); ++k) {
                const Camera<double>& camera = views[k]->camera;
                const vec3<double> to_eye = eyes.points[k] - position, local = to_camera(camera, position);
                vec3<float> linear;
                if (seen[s * views.size() + k] < 0.95f || dot(normal, to_eye) < 0.3 * length(to_eye) || local.z <= 0 ||
                    !read_color(*views[k], to_pixel(camera, local), linear))
                    continue;
                if (row == UINT32_MAX) {
                    row = static_cast<std::uint32_t>(samples.positions.size());
                    samples.positions.push_back(people.positions()[s]);
                    samples.normals.push_back(people.normals()[s]);
                    samples.visibility.insert(samples.visibility.end(),
                                              lit.begin() + static_cast<std::ptrdiff_t>(s * K),
                                              lit.begin() + static_cast<std::ptrdiff_t>((s + 1) * K));
                }
                double slope = 0;
                linear_to_srgb_backward(std::max(0.01, static_cast<double>(linear.x + linear.y + linear.z) / 3), 1.0,
                                        slope);
                samples.colors.push_back(
                    {static_cast<std::uint32_t>(s), row, linear, static_cast<float>(slope * slope)});
            }
        }
    }
    return samples;
}

} // namespace detail

/// Finds the light under which people were photographed. Colours of mesh vertices are read from the photographs in
/// which they are seen, and explained as albedo(vertex) times Σ light_k visibility · cosine / distance², by least
/// squares with intensities that are not negative. The strongest of many candidates become the points; points and
/// directions are then fitted again. The light is the same in all frames and for all people.
///
/// Units   the mean irradiance of the colours is 1, so that albedos are about the colours in the photographs.
/// Errors  ValueError if no vertex is seen in any photograph.
/// Source  our own; the inverse problem is that of "inverse rendering" with known geometry, solved in turns.
template <Backend B>
[[nodiscard]] LightEstimate estimate_light(B& backend, Span<const LitPerson> people, Span<const Photo> photos,
                                           const LightEstimateParams& params = {}) {
    constexpr std::string_view where = "estimate_light";
    check_value(!people.empty() && !photos.empty(), where, "there are no people or no photographs");
    // Frames: evenly spread over the photographed ones.
    std::vector<std::size_t> frames;
    for (const Photo& photo : photos) frames.push_back(photo.frame);
    std::sort(frames.begin(), frames.end());
    frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    if (frames.size() > params.frames) {
        std::vector<std::size_t> some;
        for (std::size_t k = 0; k < params.frames; ++k) some.push_back(frames[k * frames.size() / params.frames]);
        frames = std::move(some);
    }
    vec3<double> center(0);
    for (const std::size_t frame : frames)
        for (const LitPerson& person : people)
            center += (person.motion->transl[frame] + person.rig->joints[0]) *
                      (1 / static_cast<double>(frames.size() * people.size()));

    const std::vector<vec3<double>> around = even_directions(params.candidates);
    LightData candidates{.points = {},
                         .directions = even_directions(params.directions),
                         .log_intensities = std::vector<double>(params.candidates + params.directions, 0),
                         .gloss = {},
                         .shadows = params.shadows};
    for (const vec3<double>& direction : around) candidates.points.push_back(center + direction * params.distance);

    LightEstimate estimate;
    detail::PosedPeople<B> posed(backend, people, params);
    detail::LightSamples samples = detail::read_samples(posed, photos, frames, candidates, params);
    check_value(!samples.colors.empty(), where,
                "no mesh vertex is seen within the mask of any photograph; check cameras, poses and masks");
    Eigen::MatrixXf G = samples.irradiances(candidates);
    const Eigen::VectorXd found = detail::fit_intensities(samples, G, params.rounds, estimate.psnr);
    const Eigen::VectorXd strength = found.cwiseProduct(G.rowwise().mean().cast<double>());

    LightData& light = estimate.light;
    for (const vec3<double>& place : detail::strongest_places(around, strength, params.points))
        light.points.push_back(center + place * params.distance);
    light.directions = candidates.directions;
    light.shadows = params.shadows;
    light.log_intensities.assign(light.size(), 0);
    samples = detail::read_samples(posed, photos, frames, light, params);
    G = samples.irradiances(light);
    const Eigen::VectorXd fitted = detail::fit_intensities(samples, G, params.rounds, estimate.psnr);
    estimate.samples = samples.colors.size();
    detail::fit_intensities(samples, Eigen::MatrixXf::Ones(1, G.cols()), 0, estimate.psnr_even);

    // An intensity of zero has no logarithm: the least is a thousandth of the mean irradiance. The strongest point
    // comes first, for it is the unit of a LearnedLight.
    for (std::size_t k = 0; k < light.size(); ++k) {
        const double reach = k < light.points.size() ? params.distance * params.distance : 1;
        light.log_intensities[k] = std::log(std::max(fitted[static_cast<Eigen::Index>(k)], 1e-3 * reach));
    }
    if (params.points > 0) {
        const auto points_end = light.log_intensities.begin() + static_cast<std::ptrdiff_t>(params.points);
        const auto strongest = std::max_element(light.log_intensities.begin(), points_end);
        std::swap(light.points[0], light.points[static_cast<std::size_t>(strongest - light.log_intensities.begin())]);
        std::swap(light.log_intensities[0], *strongest);
    }
    light.gloss = even_light(1, 0, center, params.distance).gloss;
    return estimate;
}

} // namespace gsh
