// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/setup/canonical_setup.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t tube_count = 3000;

/// A tube with more joints than trunk and limbs. Its upper end is the region of high detail.
struct Tube {
    BodyModel body = test::tube(24, 48, 8);
    Motion motion;
    RegionLists regions;
    cpu::Serial backend;

    Tube() {
        test::Rng rng(4);
        motion.joint_count = 24, motion.expression_count = 2;
        motion.betas = {0.4, -0.2, 0.1};
        motion.pose = rng.vecs(2 * 24, -0.2, 0.2);
        motion.expression = {0.1, 0.2, 0.3, 0.4};
        motion.transl = {{0, 0, 0}, {0, 0.1, 0}};
        motion.timestamps = {0, 1};
        regions.high.emplace();
        for (std::size_t v = 0; v < body.vertex_count(); ++v)
            if (upper(body.v_template[v])) regions.high->push_back(static_cast<int>(v));
    }
    static bool upper(const vec3<double>& point) { return point.y > 1.2; }

    [[nodiscard]] CanonicalSetup setup(std::string_view name, std::uint64_t seed = 7,
                                       const EstimatedPriors& estimated = {}) {
        return make_canonical_setup(backend, body, motion, named_configuration(name), tube_count, seed, regions,
                                    estimated);
    }
};

/// Checks that the parts of a setup have matching sizes and that an AvatarModel accepts them.
void check_consistent(Tube& tube, const CanonicalSetup& setup, const Configuration& config) {
    CHECK(setup.samples.size() == tube_count);
    CHECK(setup.rig.point_count() == tube_count);
    CHECK(setup.rig.joint_count() == setup.motion.joint_count);
    validate(setup.motion, setup.rig.body, "test");
    ConfiguredAvatarParams avatar = config.avatar;
    avatar.appearance.field.grid.base = 3, avatar.appearance.field.grid.growth = 1.5,
    avatar.appearance.field.grid.table_size = 256, avatar.occlusion.grid.table_size = 256;
    const auto model = make_avatar(tube.backend, setup.rig, setup.samples, setup.motion.frame_count(), 1, avatar,
                                   setup.priors);
    CHECK(model.size() == tube_count);
}

double share_above(const CanonicalSetup& setup) {
    return static_cast<double>(
               std::count_if(setup.samples.positions.begin(), setup.samples.positions.end(), Tube::upper)) /
           static_cast<double>(tube_count);
}

/// Depth `value` everywhere in front of the body.
PriorView flat_depth(const std::vector<vec3<double>>& vertices, double value) {
    PriorView view{side_camera(vertices, BodySide::front), {}, {}};
    const auto& camera = std::get<OrthographicCamera>(view.camera);
    view.map = {Image<double>(1, camera.height, camera.width), Image<std::uint8_t>(1, camera.height, camera.width)};
    std::fill(view.map.values.data.begin(), view.map.values.data.end(), value);
    std::fill(view.map.mask.data.begin(), view.map.mask.data.end(), std::uint8_t(1));
    return view;
}

} // namespace

TEST_CASE("every configuration's setup is of the size asked for, and a model takes it") {
    Tube tube;
    for (const std::string_view name : configuration_names) {
        CAPTURE(name);
        const Configuration config = named_configuration(name);
        const CanonicalSetup setup = tube.setup(name);
        check_consistent(tube, setup, config);
        CHECK(setup.priors.region.size() == (config.fine_levels == FineLevels::everywhere ? 0 : tube_count));
        const std::size_t features = (config.depth_prior ? 4u : 0u) + (config.normal_prior ? 6u : 0u);
        CHECK(setup.priors.features.size() == tube_count * features);
    }
}

TEST_CASE("the baseline moves with 22 joints and knows no expression, on the whole body's surface") {
    Tube tube;
    const CanonicalSetup setup = tube.setup("baseline"), whole = tube.setup("baseline-x");
    CHECK(setup.rig.joint_count() == 22);
    CHECK(setup.motion.joint_count == 22);
    CHECK(setup.motion.expression_count == 0);
    CHECK(setup.motion.expression.empty());
    CHECK(setup.rig.body.expression_count == 0);
    CHECK(setup.motion.frame_count() == 2);
    for (std::size_t j = 0; j < 22; ++j) CHECK(setup.motion.pose_at(1)[j] == tube.motion.pose_at(1)[j]);
    CHECK(setup.samples.positions == whole.samples.positions); // merging joints moves no vertex
    CHECK(whole.rig.joint_count() == 24);
    CHECK(whole.motion.expression == tube.motion.expression);
}

TEST_CASE("without fine levels no point has a share in the region") {
    const CanonicalSetup coarse = Tube().setup("coarse-only");
    CHECK(coarse.priors.region == std::vector<double>(tube_count, 0.0));
    // coarse-only also has more Gaussians in the region.
    CHECK(coarse.samples.positions == Tube().setup("paper").samples.positions);
}

TEST_CASE("regions get more Gaussians, fine levels, and a smooth edge") {
    Tube tube;
    const CanonicalSetup even = tube.setup("baseline-x"), paper = tube.setup("paper"), merged = tube.setup("smpl-init");
    // K_b : K_m = 15 : 20 on an even mesh, apart from the edge between both.
    const double share = share_above(even);
    CHECK(share_above(paper) == doctest::Approx(20 * share / (20 * share + 15 * (1 - share))).epsilon(0.03));
    CHECK(share_above(merged) == doctest::Approx(share).epsilon(0.03)); // fine levels without additional samples
    for (const CanonicalSetup* setup : {&paper, &merged}) {
        std::size_t between = 0;
        for (std::size_t i = 0; i < tube_count; ++i) {
            const double tau = setup->priors.region[i], y = setup->samples.positions[i].y;
            CHECK((tau >= 0 && tau <= 1));
            if (y > 1.25) CHECK(tau == doctest::Approx(1));
            if (y < 0.95) CHECK(tau == 0); // exactly 0, so that no fine level is read there
            between += tau > 0 && tau < 1;
        }
        CHECK(between > 0);
    }
    // An importance per vertex replaces the lists.
    RegionLists painted;
    painted.importance.assign(tube.body.vertex_count(), 0.5);
    const CanonicalSetup half =
        make_canonical_setup(tube.backend, tube.body, tube.motion, named_configuration("paper"), tube_count, 7,
                             painted);
    for (const double tau : half.priors.region) CHECK(tau == doctest::Approx(0.5).epsilon(2e-3));
}

TEST_CASE("importance below a thousandth is none at all, and what is left begins there without a step") {
    constexpr double epsilon = 1e-3;
    Tube tube;
    const auto region = [&](const RegionLists& lists) {
        return make_canonical_setup(tube.backend, tube.body, tube.motion, named_configuration("paper"), tube_count, 7,
                                    lists);
    };
    RegionLists painted; // the same everywhere, so that each sample has exactly this value
    for (const double tau : {1e-9, 5e-4, epsilon, 1.001e-3, 0.25, 1.0}) {
        CAPTURE(tau);
        painted.importance.assign(tube.body.vertex_count(), tau);
        for (const double found : region(painted).priors.region)
            CHECK((tau < epsilon ? found == 0 : std::abs(found - (tau - epsilon) / 0.999) < 1e-12));
    }

    // Down a straight tube: τ = exp(-d² / 2σ²) falls below ε at σ √(2 ln 1000) = 11.15 cm and is positive up to 18 cm.
    tube.motion.betas.clear();
    tube.regions.high->clear();
    const double edge = 1.6 * 37 / 48; // the lowest ring of vertices in V_high; the next ones are 3.3 cm apart
    for (std::size_t v = 0; v < tube.body.vertex_count(); ++v)
        if (tube.body.v_template[v].y > edge - 0.01) tube.regions.high->push_back(static_cast<int>(v));
    const CanonicalSetup setup = region(tube.regions);
    const RegionMask mask = region_mask(tube.body, tube.body.v_template, tube.regions);
    const std::vector<double> raw = mask.at(setup.samples);
    std::size_t cut = 0, faint = 0;
    for (std::size_t i = 0; i < tube_count; ++i) {
        const double below = edge - setup.samples.positions[i].y, tau = setup.priors.region[i];
        if (below < -0.001) CHECK(tau == doctest::Approx(1).epsilon(1e-12));
        if (below > 0.1334 && below < 0.1666) { // between rings, 13.3 and 16.7 cm away
            CHECK(raw[i] > 0);
            CHECK(tau == 0);
            ++cut;
        }
        CHECK(std::abs(tau - std::max(0.0, (raw[i] - epsilon) / 0.999)) < 1e-12);
        if (raw[i] > epsilon && raw[i] < 2 * epsilon) {
            CHECK(tau < 1.002e-3);
            ++faint;
        }
    }
    CHECK(cut > 30);
    CHECK(faint > 0);
}

TEST_CASE("features are the mesh's depths, then its normals, row by row") {
    Tube tube;
    const CanonicalSetup both = tube.setup("paper"), depths = tube.setup("no-normals"),
                         normals = tube.setup("no-depth");
    CHECK(both.samples.positions == depths.samples.positions);
    bool equal = true;
    for (std::size_t i = 0; i < tube_count; ++i) {
        for (std::size_t k = 0; k < 4; ++k)
            equal = equal && both.priors.features[10 * i + k] == depths.priors.features[4 * i + k];
        for (std::size_t k = 0; k < 6; ++k)
            equal = equal && both.priors.features[10 * i + 4 + k] == normals.priors.features[6 * i + k];
    }
    CHECK(equal);
    // On the surface that the front view shows, the depth difference is 0 and the normal faces the viewer.
    std::size_t front = 0;
    for (std::size_t i = 0; i < tube_count; ++i) {
        const vec3<double> &p = both.samples.positions[i], &n = both.samples.normals[i];
        if (n.z < 0.8 || p.y < 0.1 || p.y > 1.5) continue;
        ++front;
        CHECK(std::abs(both.priors.features[10 * i]) < 0.1);    // a centimetre
        CHECK(both.priors.features[10 * i + 4 + 2] > 0.7);      // the front view's normal, canonical z
        CHECK(both.priors.features[10 * i + 1] < -1);           // the back is a tube's thickness away
    }
    CHECK(front > 100);
}

TEST_CASE("an estimator's views take the place of the mesh's") {
    Tube tube;
    const auto vertices = shaped_vertices(tube.body, tube.motion.betas);
    EstimatedPriors estimated;
    estimated.depths = {flat_depth(vertices, 2.0)};
    Configuration config = named_configuration("paper");
    config.prior = {.depth = DepthFeature::raw, .depth_unit = 0.5};
    const CanonicalSetup setup =
        make_canonical_setup(tube.backend, tube.body, tube.motion, config, tube_count, 7, tube.regions, estimated);
    REQUIRE(setup.priors.features.size() == 7 * tube_count); // one depth, and the two normals of the mesh
    const CanonicalSetup own = tube.setup("no-depth");
    for (std::size_t i = 0; i < tube_count; ++i) {
        CHECK(setup.priors.features[7 * i] == doctest::Approx(4));
        CHECK(setup.priors.features[7 * i + 1] == own.priors.features[6 * i]);
    }
    check_consistent(tube, setup, config);

    estimated.depths.clear();
    estimated.normals = {two_normal_views(tube.backend, vertices, tube.body.faces)[1]}; // the back alone
    const CanonicalSetup back = tube.setup("no-depth", 7, estimated);
    REQUIRE(back.priors.features.size() == 3 * tube_count);
    for (std::size_t i = 0; i < tube_count; ++i) CHECK(back.priors.features[3 * i] == own.priors.features[6 * i + 3]);

    estimated.normals = {flat_depth(vertices, 2.0)}; // a depth map in place of normals
    CHECK_THROWS_AS((void)tube.setup("paper", 7, estimated), ShapeError);
    CHECK(tube.setup("baseline", 7, estimated).priors.features.empty()); // this configuration does not use them
}

TEST_CASE("a setup is its seed's, whatever the number of threads") {
    Tube tube;
    const CanonicalSetup one = tube.setup("paper"), other = tube.setup("paper", 8);
    CHECK(one.samples.positions != other.samples.positions);
    cpu::Threads threads(3);
    const CanonicalSetup again =
        make_canonical_setup(threads, tube.body, tube.motion, named_configuration("paper"), tube_count, 7,
                             tube.regions);
    CHECK(again.samples.positions == one.samples.positions);
    CHECK(again.priors.region == one.priors.region);
    CHECK(again.priors.features == one.priors.features);
}

TEST_CASE("what does not fit is refused") {
    Tube tube;
    const auto make = [&](const RegionLists& lists, std::size_t wanted = tube_count) {
        return make_canonical_setup(tube.backend, tube.body, tube.motion, named_configuration("paper"), wanted, 7,
                                    lists);
    };
    RegionLists lists;
    lists.high = {1'000'000};
    CHECK_THROWS_AS((void)make(lists), ValueError);
    lists.high.reset();
    lists.importance = {0.5};
    CHECK_THROWS_AS((void)make(lists), Error);
    Configuration config = named_configuration("paper");
    config.region.sigma = 0;
    CHECK_THROWS_AS(
        (void)make_canonical_setup(tube.backend, tube.body, tube.motion, config, tube_count, 7, tube.regions),
        ValueError);
    config = named_configuration("paper");
    config.prior.depth_unit = 0;
    CHECK_THROWS_AS(
        (void)make_canonical_setup(tube.backend, tube.body, tube.motion, config, tube_count, 7, tube.regions),
        ValueError);
}
