// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"
#include "support/skip.hpp"

#include <gsh/body/region_mask.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/synthetic/actor.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <set>
#include <string>

namespace gsh {
namespace {

const BodyModel& actor() {
    static const BodyModel body = make_actor({.edge_scale = 1.5});
    return body;
}
/// The body as a file without lists and names would store it.
BodyModel bare_actor() {
    BodyModel body = actor();
    body.face_vertices.clear(), body.left_hand_vertices.clear(), body.right_hand_vertices.clear();
    body.joint_names.clear();
    return body;
}

/// A body with fewer joints: joint j of the old one becomes `into[j]`.
BodyModel merged(const BodyModel& model, const std::vector<std::size_t>& into, std::size_t joint_count) {
    BodyModel result = model;
    result.parents.assign(joint_count, -1), result.J_regressor.assign(joint_count, {});
    result.weights.assign(model.vertex_count() * joint_count, 0);
    result.joint_names.clear();
    for (std::size_t j = model.joint_count(); j-- > 0;) {
        result.J_regressor[into[j]] = model.J_regressor[j];
        if (j > 0 && into[static_cast<std::size_t>(model.parents[j])] != into[j])
            result.parents[into[j]] = static_cast<int>(into[static_cast<std::size_t>(model.parents[j])]);
        for (std::size_t v = 0; v < model.vertex_count(); ++v)
            result.weights[v * joint_count + into[j]] += model.weights[v * model.joint_count() + j];
    }
    return result;
}

/// Number of vertices in both lists, divided by the number in either.
double overlap(const std::vector<int>& a, const std::vector<int>& b) {
    std::set<int> all(a.begin(), a.end());
    std::size_t both = 0;
    for (const int v : b) both += !all.insert(v).second;
    return all.empty() ? 1 : static_cast<double>(both) / static_cast<double>(all.size());
}

TEST_CASE("regions from the model alone: hands of every SMPL tree, a face where something moves it") {
    const BodyModel body = bare_actor(), &listed = actor();
    const BodyRegions regions = derive_regions(body);
    MESSAGE("overlap with the actor's own lists: face " << overlap(regions.face, listed.face_vertices) << ", hands "
            << overlap(regions.left_hand, listed.left_hand_vertices) << ", "
            << overlap(regions.right_hand, listed.right_hand_vertices));
    CHECK(overlap(regions.face, listed.face_vertices) > 0.5);
    CHECK(overlap(regions.left_hand, listed.left_hand_vertices) > 0.9);
    CHECK(overlap(regions.right_hand, listed.right_hand_vertices) > 0.9);
    for (const int v : regions.left_hand) CHECK(body.v_template[static_cast<std::size_t>(v)].x > 0.65);
    for (const int v : regions.right_hand) CHECK(body.v_template[static_cast<std::size_t>(v)].x < -0.65);
    for (const int v : regions.face) CHECK(body.v_template[static_cast<std::size_t>(v)].z > 0);

    // SMPL-H has no jaw and no eyes. Without expression directions the face cannot be found.
    std::vector<std::size_t> into(55);
    for (std::size_t j = 0; j < 55; ++j) into[j] = j < 22 ? j : j < 25 ? 15 : j - 3;
    BodyModel smplh = merged(body, into, 52);
    CHECK(derive_regions(smplh).left_hand == regions.left_hand);
    CHECK(!derive_regions(smplh).face.empty());
    smplh.expression_count = 0, smplh.exprdirs.clear();
    CHECK(derive_regions(smplh).face.empty());

    // SMPL: all fingers are one joint, 22 and 23.
    for (std::size_t j = 22; j < 55; ++j) into[j] = j < 25 ? 15 : j < 40 ? 22 : 23;
    BodyModel smpl = merged(body, into, 24);
    smpl.expression_count = 0, smpl.exprdirs.clear();
    const BodyRegions hands = derive_regions(smpl);
    CHECK(hands.left_hand == regions.left_hand);
    CHECK(hands.right_hand == regions.right_hand);
    CHECK(hands.face.empty());

    // In another joint tree, regions are found by names or not at all.
    const BodyModel tube = test::tube(6);
    CHECK(derive_regions(tube).high().empty());
    BodyModel named = tube;
    named.joint_names = {"root", "a", "Head", "b", "L_Wrist", "c"};
    const BodyRegions found = derive_regions(named);
    CHECK(!found.left_hand.empty());
    CHECK(found.right_hand.empty());
    CHECK(!found.face.empty()); // the tube's expression moves everything
    const double wrist = 1.6 * 4 / 6;
    for (const int v : found.left_hand) CHECK(named.v_template[static_cast<std::size_t>(v)].y > wrist - 0.1);
    named.joint_names[4] = "wrist.R";
    CHECK(derive_regions(named).left_hand.empty());
    CHECK(derive_regions(named).right_hand == found.left_hand);

    CHECK(derive_regions(BodyModel()).high().empty());
    BodyModel broken = tube;
    broken.weights.pop_back();
    CHECK_THROWS_AS((void)derive_regions(broken), ShapeError);
}

TEST_CASE("the user's lists win over the model's, those over the derivation") {
    BodyModel body = bare_actor();
    const BodyRegions derived = derive_regions(body);
    body.left_hand_vertices = {9, 3, 9};
    body.right_hand_vertices = {4};
    RegionLists lists;
    lists.right_hand = std::vector<int>{7, 5};
    const BodyRegions regions = body_regions(body, lists);
    CHECK(regions.face == derived.face);
    CHECK(regions.left_hand == std::vector<int>{3, 9});
    CHECK(regions.right_hand == std::vector<int>{5, 7});
    const auto high = regions.high();
    CHECK(high.size() == derived.face.size() + 4);
    CHECK(std::is_sorted(high.begin(), high.end()));
    lists.face = std::vector<int>{};
    CHECK(body_regions(body, lists).face.empty()); // an empty list is kept, not replaced by what is found
    const auto labels = body_regions(body, lists).labels(body.vertex_count());
    CHECK(labels[3] == BodyRegion::left_hand);
    CHECK(labels[7] == BodyRegion::right_hand);
    CHECK(labels[4] == BodyRegion::body);
    CHECK_THROWS_AS((void)regions.labels(5), ValueError);
    lists.face = std::vector<int>{static_cast<int>(body.vertex_count())};
    CHECK_THROWS_AS((void)body_regions(body, lists), ValueError);
}

TEST_CASE("along a limb importance follows the closed form, and the density of samples rises smoothly") {
    const BodyModel limb = test::tube(4, 80, 12); // rings every 2 cm, straight: distance is height
    RegionLists lists;
    lists.high.emplace();
    for (std::size_t v = 0; v < limb.vertex_count(); ++v)
        if (limb.v_template[v].y > 1.2 - 1e-9) lists.high->push_back(static_cast<int>(v));
    const RegionMask mask = region_mask(limb, limb.v_template, lists);
    for (std::size_t v = 0; v < limb.vertex_count(); ++v) {
        const double below = std::max(1.2 - limb.v_template[v].y, 0.0);
        if (below > 0.18 + 1e-9) {
            CHECK(mask.tau()[v] == 0);
        } else if (below < 0.18 - 1e-9) {
            CHECK(mask.distances()[v] == doctest::Approx(below));
            CHECK(mask.tau()[v] == doctest::Approx(std::exp(-below * below / (2 * 0.03 * 0.03))));
        }
    }
    const auto K = mask.samples_per_vertex();
    CHECK(*std::min_element(K.begin(), K.end()) == 15);
    CHECK(*std::max_element(K.begin(), K.end()) == 20);

    const auto samples = sample_surface(limb, limb.v_template, K, 5);
    double expected = 0;
    for (const double k : K) expected += k;
    CHECK(std::abs(static_cast<double>(samples.size()) - expected) < 1);
    std::vector<double> rings(81, 0);
    for (const int v : samples.sources)
        if (v < 81 * 12) rings[static_cast<std::size_t>(v) / 12] += 1;
    for (std::size_t r = 0; r <= 80; ++r) {
        double ring = 0; // each run of vertices has its expected number, to within one
        for (std::size_t s = 0; s < 12; ++s) ring += K[12 * r + s];
        CHECK(std::abs(rings[r] - ring) < 1);
        if (r > 0) CHECK(rings[r] - rings[r - 1] > -1.5); // never falls, apart from rounding
        if (r > 0) CHECK(rings[r] - rings[r - 1] < 12 * 5 * 0.4 + 1.5); // 2 cm are 2/3 σ: τ rises by less than 0.4
    }
    CHECK(rings[59] > rings[56] + 12);

    // τ at samples lies between that of their triangles' corners, and is exact where τ is flat.
    const auto tau = mask.at(samples);
    REQUIRE(tau.size() == samples.size());
    for (std::size_t i = 0; i < tau.size(); ++i) {
        double low = 1, high = 0;
        for (const int v : samples.triangles[i]) {
            low = std::min(low, mask.tau()[static_cast<std::size_t>(v)]);
            high = std::max(high, mask.tau()[static_cast<std::size_t>(v)]);
        }
        CHECK(tau[i] >= low - 1e-15);
        CHECK(tau[i] <= high + 1e-15);
    }

    // With a given total, the ratio stays 3 : 4.
    const auto scaled = sample_surface(limb, limb.v_template, K, 5, {.total = 50000});
    CHECK(scaled.size() == 50000);
    std::vector<double> counts(limb.vertex_count(), 0);
    for (const int v : scaled.sources) counts[static_cast<std::size_t>(v)] += 1;
    double low = 0, high = 0; // 20 rings each, far away and inside
    for (std::size_t v = 0; v < 20 * 12; ++v) low += counts[v], high += counts[12 * 60 + v];
    CHECK(low / high == doctest::Approx(0.75).epsilon(2e-3));
}

TEST_CASE("density along the actor's arm rises from K_b at the shoulder to K_m at the wrist, and never falls") {
    const BodyModel& body = actor();
    const RegionMask mask = region_mask(body, body.v_template); // K_b = 15, K_m = 20
    const auto joints = regress_joints(body, body.v_template);  // in T-pose the bones lie along x
    const double shoulder = joints[16].x + 0.05, wrist = joints[20].x, width = (wrist - shoulder) / 12; // 3.7 cm
    // The mesh is finer towards the hand, so densities are relative to those of K = 1 on the same area. Only the arm is
    // sampled, with forty times the usual number, to reduce noise.
    const auto counts = [&](std::vector<double> K, std::uint64_t seed) {
        for (std::size_t v = 0; v < K.size(); ++v) {
            const double x = body.v_template[v].x;
            K[v] = x > shoulder - 0.05 && x < wrist + 0.15 ? 40 * K[v] : 0;
        }
        std::vector<double> bins(14, 0); // two beyond the wrist, where V_high begins
        for (const vec3<double>& p : sample_surface(body, body.v_template, K, seed).positions) {
            const double bin = std::floor((p.x - shoulder) / width);
            if (bin >= 0 && bin < 14) bins[static_cast<std::size_t>(bin)] += 1;
        }
        return bins;
    };
    const auto masked = counts(mask.samples_per_vertex(), 5),
               uniform = counts(std::vector<double>(body.vertex_count(), 15.0), 6);
    std::vector<double> density, noise; // three standard deviations of independent draws
    for (std::size_t b = 0; b < masked.size(); ++b) {
        density.push_back(15 * masked[b] / uniform[b]);
        noise.push_back(3 * density[b] * std::sqrt(1 / masked[b] + 1 / uniform[b]));
    }
    for (std::size_t b = 0; b < density.size(); ++b) {
        CAPTURE(b);
        CHECK(noise[b] < 1);
        if (b > 0) CHECK(density[b] > density[b - 1] - std::hypot(noise[b], noise[b - 1]));
        if (b < 8) CHECK(std::abs(density[b] - 15) < noise[b]); // more than 4 σ from the hand
    }
    CHECK(density[10] > 15.1);
    CHECK(density[11] > density[10] + 1);
    CHECK(density[12] > density[11] + 0.5);
    CHECK(std::abs(density[13] - 20) < noise[13]);
}

TEST_CASE("parts without a vertex of V_high stay at 0, others have their own seed; nothing leaks through the air") {
    BodyModel body = test::tube(4, 40, 12);
    const std::size_t V = body.vertex_count();
    for (std::size_t part = 1; part < 3; ++part) { // two more tubes inside the first, each 1 mm smaller, as eyeballs
        const int first = static_cast<int>(part * V);
        for (std::size_t v = 0; v < V; ++v) {
            const auto& p = body.v_template[v];
            const double shrink = 1 - 0.005 * static_cast<double>(part);
            body.v_template.push_back({p.x * shrink, p.y, p.z * shrink});
        }
        const auto faces = body.faces;
        for (std::size_t f = 0; f < faces.size() / part; ++f)
            body.faces.push_back({faces[f][0] + first, faces[f][1] + first, faces[f][2] + first});
    }
    std::vector<int> high;
    for (std::size_t v = 0; v < 60; ++v) high.push_back(static_cast<int>(v));
    high.push_back(static_cast<int>(2 * V));
    const RegionMask mask(body.v_template, body.faces, high);
    double first = 0, second = 0, third = 0;
    for (std::size_t v = 0; v < V; ++v)
        first += mask.tau()[v], second += mask.tau()[V + v], third += mask.tau()[2 * V + v];
    CHECK(first > 60);
    CHECK(second == 0);
    CHECK(third >= 1);
    CHECK(third < 20);
    CHECK(mask.tau()[2 * V] == 1);
    CHECK(mask.distances()[V] == GeodesicDistance::unreachable);
    const RegionMask none(body.v_template, body.faces, {});
    for (const double t : none.tau()) CHECK(t == 0);
}

TEST_CASE("painted importance replaces tau") {
    const BodyModel body = test::tube();
    RegionLists lists;
    test::Rng rng(9);
    lists.importance = rng.numbers(body.vertex_count(), 0, 1);
    lists.importance[3] = 0, lists.importance[4] = 1;
    lists.high = std::vector<int>{0};
    const RegionMask mask = region_mask(body, body.v_template, lists, {.samples_base = 6, .samples_high = 30});
    CHECK(std::vector<double>(mask.tau().begin(), mask.tau().end()) == lists.importance);
    CHECK(mask.distances().empty());
    const auto K = mask.samples_per_vertex();
    for (std::size_t v = 0; v < K.size(); ++v) CHECK(K[v] == doctest::Approx(6 + 24 * lists.importance[v]));
    CHECK(mask.params().samples_high == 30);
}

TEST_CASE("uniform K is a number; values are interpolated as the samples lie") {
    const BodyModel body = test::tube();
    const auto vector = sample_surface(body, body.v_template, std::vector<double>(body.vertex_count(), 7.5), 3),
               number = sample_surface(body, body.v_template, 7.5, 3);
    CHECK(vector.positions == number.positions);
    std::vector<double> heights;
    for (const auto& p : body.v_template) heights.push_back(p.y);
    const auto at = interpolate(number, heights);
    for (std::size_t i = 0; i < at.size(); ++i) CHECK(at[i] == doctest::Approx(number.positions[i].y));
    CHECK(interpolate(SurfaceSamples(), heights).empty());
    heights.resize(5);
    CHECK_THROWS_AS((void)interpolate(number, heights), ValueError);
}

TEST_CASE("errors") {
    const BodyModel body = test::tube();
    const std::vector<int> high{0}, beyond{static_cast<int>(body.vertex_count())};
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS(RegionMask(body.v_template, body.faces, beyond), ValueError);
    for (const double sigma : {0.0, -0.03, nan, 1 / 0.0})
        CHECK_THROWS_AS(RegionMask(body.v_template, body.faces, high, {.sigma = sigma}), ValueError);
    for (const double K : {-1.0, nan, 1 / 0.0}) {
        CHECK_THROWS_AS(RegionMask(body.v_template, body.faces, high, {.samples_base = K}), ValueError);
        CHECK_THROWS_AS(RegionMask(body.v_template, body.faces, high, {.samples_high = K}), ValueError);
    }
    for (const double t : {-0.1, 1.1, nan}) CHECK_THROWS_AS(RegionMask(std::vector<double>{0, t}), ValueError);
    RegionLists lists;
    lists.importance = {0.5};
    CHECK_THROWS_AS((void)region_mask(body, body.v_template, lists), ShapeError);
    CHECK_THROWS_AS((void)region_mask(body, std::vector<vec3<double>>(3)), ShapeError);
    CHECK(RegionMask(std::vector<double>()).samples_per_vertex().empty());
}

TEST_CASE("a real body: derived regions beside the file's, and where 170,000 samples go") {
    const auto path = test::shared_data("body/cc0_body_x.npz");
    if (test::skip_without({path})) return;
    const BodyModel body = load_body_model(path);
    const BodyRegions derived = derive_regions(body), regions = body_regions(body);
    MESSAGE("overlap: face " << overlap(derived.face, regions.face) << " (" << derived.face.size() << " and "
            << regions.face.size() << " vertices), hands " << overlap(derived.left_hand, regions.left_hand) << " and "
            << overlap(derived.right_hand, regions.right_hand) << "; V_high " << regions.high().size());
    CHECK(overlap(derived.left_hand, regions.left_hand) > 0.98);
    CHECK(overlap(derived.right_hand, regions.right_hand) > 0.98);
    CHECK(overlap(derived.face, regions.face) > 0.5);
    const RegionMask mask = region_mask(body, body.v_template);
    const auto labels = regions.labels(body.vertex_count());
    const auto count = [&](const std::vector<double>& K) {
        std::array<std::size_t, 4> n{};
        for (const int v : sample_surface(body, body.v_template, K, 0, {.total = 170000}).sources)
            ++n[static_cast<std::size_t>(labels[static_cast<std::size_t>(v)])];
        return n;
    };
    const auto uniform = count(std::vector<double>(body.vertex_count(), 1.0));
    const auto masked = count(mask.samples_per_vertex());
    double sum = 0;
    for (const double K : mask.samples_per_vertex()) sum += K;
    MESSAGE("body, face, left, right: uniform " << uniform[0] << ", " << uniform[1] << ", " << uniform[2] << ", "
            << uniform[3] << "; with K(x) " << masked[0] << ", " << masked[1] << ", " << masked[2] << ", " << masked[3]
            << "; K(x) adds up to " << sum);
    for (std::size_t region = 1; region < 4; ++region) CHECK(masked[region] > uniform[region]);
}

} // namespace
} // namespace gsh
