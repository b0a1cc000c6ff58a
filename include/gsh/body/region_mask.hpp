// SPDX-License-Identifier: Apache-2.0
/// @file  Face and hand regions of a body, their importance mask, and the number of samples per vertex derived from it.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/geodesic.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

enum class BodyRegion : std::uint8_t { body, face, left_hand, right_hand };

/// Vertex indices of the regions, ascending; empty if the body has no such region or it could not be determined.
struct BodyRegions {
    std::vector<int> face, left_hand, right_hand;

    /// V_high, the union of all three, ascending.
    [[nodiscard]] std::vector<int> high() const;
    /// The region of each vertex [V]. Where lists overlap, the face takes precedence.
    ///
    /// Errors  ValueError for an index that is not below `vertex_count`.
    [[nodiscard]] std::vector<BodyRegion> labels(std::size_t vertex_count) const;
};

/// Regions given by the user (read by io/body/region_file.hpp). Members that are not set are derived from the body.
struct RegionLists {
    std::optional<std::vector<int>> face, left_hand, right_hand;
    std::optional<std::vector<int>> high; ///< V_high itself, instead of the union of the three
    std::vector<double> importance;       ///< [V] in [0, 1], instead of τ; if empty, τ is computed from V_high
};

/// The regions of a body. A user's list takes precedence over one in the model, and that over `derive_regions`. `high`
/// and `importance` of the user's lists are not used here.
///
/// Errors  ValueError for an index that the model does not have; those of derive_regions if it is called.
[[nodiscard]] inline BodyRegions body_regions(const BodyModel& model, const RegionLists& lists = {});

/// The regions derived from weights, joints and expression directions alone.
///
/// Hand  The summed weight of the wrist and all joints below it exceeds the weight of any other joint, and the vertex
///       lies beyond the wrist (less 1 cm) as seen from the elbow.
/// Face  The joint with the largest weight is the head or below it. In addition, either jaw and eyes have more than
///       half of the weight, or the vertex's expression directions have more than 1/20 of the largest norm of any
///       vertex.
///
/// Joints are found by name ("left_wrist", "L_Wrist", "wrist.L", "head", "jaw", "left_eye"), or by number if the tree
/// is that of SMPL, SMPL-H or SMPL-X. A region whose joints are not found stays empty: SMPL (24 joints) has hands and
/// no face.
///
/// Errors  ShapeError for weights or expression directions that do not fit the model's vertices.
[[nodiscard]] inline BodyRegions derive_regions(const BodyModel& model);

struct RegionMaskParams {
    double sigma = 0.03;      ///< metres along the surface; the width of the Gaussian falloff
    double samples_base = 15; ///< K_b, samples per vertex far from V_high
    double samples_high = 20; ///< K_m, within V_high

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("region.sigma", self.sigma, SettingRange::above(0));
        f("region.samples_base", self.samples_base, SettingRange::at_least(0));
        f("region.samples_high", self.samples_high, SettingRange::at_least(0));
    }
};

/// Importance τ in [0, 1] over the surface: τ(x) = exp(-d(x, V_high)² / 2σ²), where d is the distance along the surface
/// to the nearest vertex of V_high; or values painted by a user.
///
/// A part of the mesh without a connection to V_high has τ = 0. Importance therefore never crosses a gap, for instance
/// to eyes and teeth. Beyond 6σ, where τ < 2e-8, τ is set to 0 as well.
///
/// Source  paper §3.3, equation 8 (τ) and equation 10 (K). σ and the cutoff at 6σ are ours; the paper gives neither.
class RegionMask {
public:
    /// Shapes  vertices [V] of the mesh to measure on, in metres; high: vertex indices of V_high; if empty, τ = 0
    ///         everywhere.
    /// Errors  those of GeodesicDistance; ValueError if σ is not positive or K is negative or not finite.
    RegionMask(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces, Span<const int> high,
               RegionMaskParams params = {});

    /// Painted importance [V].
    ///
    /// Errors  ValueError outside [0, 1], and for σ and K as above.
    explicit RegionMask(std::vector<double> importance, RegionMaskParams params = {});

    [[nodiscard]] Span<const double> tau() const { return tau_; } // [V]
    /// [V] metres from V_high, infinite beyond 6σ; empty for painted importance.
    [[nodiscard]] Span<const double> distances() const { return distances_; }
    [[nodiscard]] const RegionMaskParams& params() const { return params_; }

    /// K = K_b + (K_m - K_b) τ for sample_surface [V]. A total given to sample_surface scales K and keeps K_b : K_m.
    [[nodiscard]] std::vector<double> samples_per_vertex() const;

    /// τ at the samples [N], interpolated between the vertices of their triangles.
    ///
    /// Errors  those of interpolate.
    [[nodiscard]] std::vector<double> at(const SurfaceSamples& samples) const { return interpolate(samples, tau_); }

private:
    RegionMaskParams params_;
    std::vector<double> distances_, tau_;

    void check_params() const;
};

/// The mask of a body on its shaped mesh. Painted importance takes precedence; otherwise τ is computed from V_high,
/// which is the user's own list or the union of `body_regions`.
///
/// Shapes  vertices [V] of the model in metres, in its canonical pose.
/// Errors  ShapeError if vertices or importance differ in number from the model's vertices; those of RegionMask and
///         body_regions.
[[nodiscard]] inline RegionMask region_mask(const BodyModel& model, Span<const vec3<double>> vertices,
                                            const RegionLists& lists = {}, RegionMaskParams params = {});

// -------------------------------------------------------------------------------------------------------------

inline std::vector<int> BodyRegions::high() const {
    std::vector<int> all = face;
    all.insert(all.end(), left_hand.begin(), left_hand.end());
    all.insert(all.end(), right_hand.begin(), right_hand.end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
}

inline std::vector<BodyRegion> BodyRegions::labels(std::size_t vertex_count) const {
    std::vector<BodyRegion> result(vertex_count, BodyRegion::body);
    const auto mark = [&](const char* name, const std::vector<int>& list, BodyRegion region) {
        detail::check_index_range("BodyRegions::labels", name, list, vertex_count);
        for (const int v : list) result[static_cast<std::size_t>(v)] = region;
    };
    mark("left_hand", left_hand, BodyRegion::left_hand);
    mark("right_hand", right_hand, BodyRegion::right_hand);
    mark("face", face, BodyRegion::face);
    return result;
}

inline BodyRegions body_regions(const BodyModel& model, const RegionLists& lists) {
    BodyRegions regions;
    std::optional<BodyRegions> derived; // computed only if a region is missing
    const auto choose = [&](const char* name, std::vector<int> BodyRegions::*region,
                            const std::optional<std::vector<int>>& users, const std::vector<int>& models) {
        std::vector<int>& list = regions.*region;
        if (users) {
            list = *users;
        } else if (!models.empty()) {
            list = models;
        } else {
            if (!derived) derived = derive_regions(model);
            list = (*derived).*region;
        }
        detail::check_index_range("body_regions", name, list, model.vertex_count());
        std::sort(list.begin(), list.end());
        list.erase(std::unique(list.begin(), list.end()), list.end());
    };
    choose("face", &BodyRegions::face, lists.face, model.face_vertices);
    choose("left_hand", &BodyRegions::left_hand, lists.left_hand, model.left_hand_vertices);
    choose("right_hand", &BodyRegions::right_hand, lists.right_hand, model.right_hand_vertices);
    return regions;
}

namespace detail {

/// The joints that define the regions; -1 if not found.
struct RegionJoints {
    int left_wrist = -1, right_wrist = -1, head = -1;
    std::vector<int> face; ///< jaw and eyes

    explicit RegionJoints(const BodyModel& model) {
        for (std::size_t j = 0; j < model.joint_names.size(); ++j) {
            std::string name;
            for (const char c : model.joint_names[j])
                if (std::isalpha(static_cast<unsigned char>(c)))
                    name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
            const int joint = static_cast<int>(j);
            if (name == "head") head = joint;
            if (name.find("jaw") != name.npos || name.find("eye") != name.npos) face.push_back(joint);
            if (const std::size_t place = name.find("wrist"); place != name.npos) {
                const char side = name[place > 0 ? 0 : 5]; // "leftwrist", "lwrist", "wristl"; 0 ends a name
                if (side == 'l') left_wrist = joint;
                if (side == 'r') right_wrist = joint;
            }
        }
        // SMPL's tree: hips 1, 2, spine 3, 6, 9, neck 12, collars 13, 14, head 15, arms from 16 and 17 to wrists 20,
        // 21.
        constexpr std::array<int, 22> smpl = {-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19};
        const std::size_t J = model.joint_count();
        if (J < smpl.size() || !std::equal(smpl.begin(), smpl.end(), model.parents.begin())) return;
        if (left_wrist < 0) left_wrist = 20;
        if (right_wrist < 0) right_wrist = 21;
        if (head < 0) head = 15;
        if (face.empty() && J == 55 && model.parents[22] == 15 && model.parents[23] == 15 && model.parents[24] == 15)
            face = {22, 23, 24};
    }
};

/// For each joint, whether it is the given one or one of its descendants [J].
[[nodiscard]] inline std::vector<char> joints_below(Span<const int> parents, int joint) {
    std::vector<char> below(parents.size(), 0);
    for (std::size_t j = 0; j < parents.size(); ++j)
        below[j] = static_cast<int>(j) == joint || (parents[j] >= 0 && below[static_cast<std::size_t>(parents[j])]);
    return below;
}

[[nodiscard]] inline std::vector<int> derive_hand(const BodyModel& model, Span<const vec3<double>> joints, int wrist) {
    std::vector<int> hand;
    if (wrist < 0 || model.parents[static_cast<std::size_t>(wrist)] < 0) return hand;
    const std::size_t J = model.joint_count();
    const auto is_hand = joints_below(model.parents, wrist);
    const vec3<double> origin = joints[static_cast<std::size_t>(wrist)];
    const int elbow = model.parents[static_cast<std::size_t>(wrist)];
    const vec3<double> forearm = origin - joints[static_cast<std::size_t>(elbow)];
    constexpr double margin = 0.01; // metres: the joint is inside the wrist, and the skin above it counts as hand
    for (std::size_t v = 0; v < model.vertex_count(); ++v) {
        double on_hand = 0, elsewhere = 0;
        for (std::size_t j = 0; j < J; ++j) {
            const double w = model.weights[v * J + j];
            if (is_hand[j]) on_hand += w;
            else elsewhere = std::max(elsewhere, w);
        }
        if (on_hand > elsewhere && dot(model.v_template[v] - origin, forearm) > -margin * length(forearm))
            hand.push_back(static_cast<int>(v));
    }
    return hand;
}

[[nodiscard]] inline std::vector<int> derive_face(const BodyModel& model, const RegionJoints& joints) {
    std::vector<int> face;
    if (joints.head < 0) return face;
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    const auto E = static_cast<std::size_t>(model.expression_count);
    const auto is_head = joints_below(model.parents, joints.head);
    std::vector<double> squared(V, 0); // norms of expression directions
    for (std::size_t v = 0; v < V; ++v)
        for (std::size_t k = 0; k < E; ++k) squared[v] += dot(model.exprdirs[v * E + k], model.exprdirs[v * E + k]);
    constexpr double share = 1.0 / 20;
    const double threshold = share * share * *std::max_element(squared.begin(), squared.end());
    for (std::size_t v = 0; v < V; ++v) {
        const double* row = model.weights.data() + v * J;
        double moved = 0;
        for (const int j : joints.face) moved += row[j];
        const auto heaviest = static_cast<std::size_t>(std::max_element(row, row + J) - row);
        if (is_head[heaviest] && (moved > 0.5 || squared[v] > threshold)) face.push_back(static_cast<int>(v));
    }
    return face;
}

} // namespace detail

inline BodyRegions derive_regions(const BodyModel& model) {
    constexpr auto where = "derive_regions";
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    check_size(where, "weights", model.weights.size(), V * J, "store one weight per vertex and joint");
    check_size(where, "exprdirs", model.exprdirs.size(), V * static_cast<std::size_t>(model.expression_count));
    BodyRegions regions;
    if (V == 0) return regions;
    const detail::RegionJoints known(model);
    regions.face = detail::derive_face(model, known);
    if (known.left_wrist < 0 && known.right_wrist < 0) return regions;
    const auto joints = regress_joints(model, model.v_template);
    regions.left_hand = detail::derive_hand(model, joints, known.left_wrist);
    regions.right_hand = detail::derive_hand(model, joints, known.right_wrist);
    return regions;
}

inline RegionMask::RegionMask(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                              Span<const int> high, RegionMaskParams params)
    : params_(params) {
    check_params();
    distances_ = GeodesicDistance(vertices, faces).from(high, 6 * params_.sigma);
    for (const double d : distances_) tau_.push_back(std::exp(-d * d / (2 * params_.sigma * params_.sigma)));
}

inline RegionMask::RegionMask(std::vector<double> importance, RegionMaskParams params)
    : params_(params), tau_(std::move(importance)) {
    check_params();
    for (std::size_t v = 0; v < tau_.size(); ++v)
        if (!(tau_[v] >= 0 && tau_[v] <= 1))
            throw ValueError("RegionMask: importance[" + std::to_string(v) + "] is " + detail::number_text(tau_[v]) +
                             ", expected a number in [0, 1]");
}

inline void RegionMask::check_params() const {
    check_value(params_.sigma > 0 && std::isfinite(params_.sigma), "RegionMask", "sigma must be a positive length");
    for (const double K : {params_.samples_base, params_.samples_high})
        check_value(K >= 0 && std::isfinite(K), "RegionMask", "samples per vertex must be finite and at least 0");
}

inline std::vector<double> RegionMask::samples_per_vertex() const {
    std::vector<double> K;
    for (const double t : tau_) K.push_back(params_.samples_base + (params_.samples_high - params_.samples_base) * t);
    return K;
}

inline RegionMask region_mask(const BodyModel& model, Span<const vec3<double>> vertices, const RegionLists& lists,
                              RegionMaskParams params) {
    constexpr auto where = "region_mask";
    check_size(where, "vertices", vertices.size(), model.vertex_count(), "pass the shaped mesh");
    if (!lists.importance.empty()) {
        check_size(where, "importance", lists.importance.size(), model.vertex_count(), "paint every vertex");
        return RegionMask(lists.importance, params);
    }
    return RegionMask(vertices, model.faces, lists.high ? *lists.high : body_regions(model, lists).high(), params);
}

} // namespace gsh
