// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/mended_masks.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

using namespace gsh;

namespace {

/// A body that turns once, with its own silhouettes as masks, each widened by `cloth` metres.
struct Turning {
    const BodyModel& model = test::fitted_actor();
    FittedBody body{model, 0};
    OutlineSamples samples{model, body};
    Camera<double> camera = look_at<double>({0, 0.2, 3.2}, {0, -0.1, 0}, {0, 1, 0}, 0.75, 200, 260);
    std::vector<FrameNumbers> frames;
    std::vector<std::vector<vec3<double>>> vertices;
    std::vector<std::vector<std::uint8_t>> masks;

    explicit Turning(double cloth) {
        cpu::Serial backend;
        for (int t = 0; t < 16; ++t) {
            FrameNumbers frame{.root = rotation_from_axis_angle(vec3<double>(0, 2 * std::numbers::pi * t / 16, 0)),
                               .angles = {}};
            for (const PoseAxis& axis : body.axes) frame.angles.push_back(axis.mean);
            std::vector<vec3<double>> pose = body.pose(frame.angles);
            pose[0] = axis_angle_from_rotation(frame.root);
            vertices.push_back(pose_body(model, pose).vertices);
            const MeshImage image =
                rasterize_mesh(backend, Span<const vec3<double>>(vertices.back()), model.faces, camera);
            const int radius = static_cast<int>(std::lround(cloth * camera.fx / 3.2));
            std::vector<std::uint8_t> mask(image.size(), 0);
            for (int y = 0; y < 260; ++y)
                for (int x = 0; x < 200; ++x)
                    for (int v = std::max(0, y - radius); v <= std::min(259, y + radius); ++v)
                        for (int u = std::max(0, x - radius); u <= std::min(199, x + radius); ++u)
                            if ((u - x) * (u - x) + (v - y) * (v - y) <= radius * radius &&
                                image.covers(static_cast<std::size_t>(200 * v + u)))
                                mask[static_cast<std::size_t>(200 * y + x)] = 255;
            masks.push_back(mask);
            frames.push_back(frame);
        }
    }
    [[nodiscard]] static MaskView view(const std::vector<std::uint8_t>& mask) { return {260, 200, mask.data()}; }
    [[nodiscard]] MaskMender watched() const {
        MaskMender mender(model, body, samples);
        for (std::size_t t = 0; t < 16; ++t) mender.watch(frames[t], {}, camera, view(masks[t]));
        return mender;
    }
    mutable std::vector<std::uint8_t> hidden = std::vector<std::uint8_t>(260 * 200); // of the last mask
    MaskChange mend(MaskMender& mender, std::size_t t, std::vector<std::uint8_t>& mask) const {
        return mend_mask({claim(mender, t)}, mask, hidden);
    }
    [[nodiscard]] MaskClaim claim(MaskMender& mender, std::size_t t) const {
        return mender.claim(frames[t], {}, camera, Span<const vec3<double>>(vertices[t]));
    }
};

} // namespace

TEST_CASE("masks of bare skin and of thick clothes stay as they are") {
    for (const double cloth : {0.0, 0.05}) {
        const Turning scene(cloth);
        MaskMender mender = scene.watched();
        for (std::size_t t = 0; t < 16; ++t) {
            std::vector<std::uint8_t> mask = scene.masks[t];
            const MaskChange change = scene.mend(mender, t, mask);
            CAPTURE(cloth);
            CHECK(change.removed < 0.03);
            CHECK(change.hidden < 0.005);
        }
    }
}

TEST_CASE("a claim tells where masks usually end: at the body of bare skin, beyond it in thick clothes") {
    for (const double cloth : {0.0, 0.05}) {
        const Turning scene(cloth);
        MaskMender mender = scene.watched();
        for (const std::size_t t : {0, 5, 11}) {
            CAPTURE(cloth);
            const MaskClaim claim = scene.claim(mender, t);
            const std::vector<std::uint8_t> image = image_of_claims({claim});
            double differ = 0, mask_area = 0, beyond_body = 0;
            for (std::size_t i = 0; i < image.size(); ++i) {
                const bool usual = image[i] >= 170, masked = scene.masks[t][i] >= 128;
                differ += usual != masked, mask_area += masked, beyond_body += usual && !claim.body[i];
                CHECK((!claim.core[i] || image[i] == 255));
                CHECK((image[i] != 85 || (claim.allowed[i] && !claim.usual[i])));
            }
            CHECK(differ < 0.12 * mask_area);
            CHECK((beyond_body > 0.1 * mask_area) == (cloth > 0));
        }
    }
    CHECK(image_of_claims({}).empty());
}

TEST_CASE("of several people, the image of claims has the surest") {
    MaskClaim left, right;
    left.body = left.usual = left.allowed = left.core = {1, 0, 0, 0};
    right.body = right.core = {0, 0, 0, 0};
    right.usual = {0, 1, 0, 0}, right.allowed = {1, 1, 1, 0};
    CHECK(image_of_claims({left, right}) == std::vector<std::uint8_t>{255, 170, 85, 0});
}

TEST_CASE("a thing beside the person is cut off, a lost limb is hidden, in the photographs that have them") {
    Turning scene(0.02);
    const auto whole = scene.masks;
    for (const std::size_t t : {3, 4}) // a box beside the legs
        for (int y = 150; y < 210; ++y)
            for (int x = 110; x < 150; ++x) scene.masks[t][static_cast<std::size_t>(200 * y + x)] = 255;
    for (int y = 180; y < 196; ++y) // a stripe through the shins
        for (int x = 0; x < 200; ++x) scene.masks[9][static_cast<std::size_t>(200 * y + x)] = 0;
    MaskMender mender = scene.watched();
    const auto wrong = [&](std::size_t t) {
        std::size_t count = 0;
        for (std::size_t i = 0; i < whole[t].size(); ++i) count += scene.masks[t][i] != whole[t][i];
        return static_cast<double>(count);
    };
    for (const std::size_t t : {3, 4}) {
        const double before = wrong(t);
        CHECK(scene.mend(mender, t, scene.masks[t]).removed > 0.02);
        CHECK(wrong(t) < 0.5 * before);
    }
    const std::vector<std::uint8_t> striped = scene.masks[9];
    CHECK(scene.mend(mender, 9, scene.masks[9]).hidden > 0.02);
    CHECK(scene.masks[9] == striped);
    double compared = 0;
    for (std::size_t i = 0; i < striped.size(); ++i) {
        compared += striped[i] != whole[9][i] && !scene.hidden[i];
        if (scene.hidden[i]) CHECK(striped[i] == 0);
        if (i < 200 * 175 || i >= 200 * 201) CHECK(scene.hidden[i] == 0); // around the stripe alone
    }
    CHECK(compared < 0.1 * wrong(9));
    // Where the body is not where the mask is, nothing is cut off.
    std::vector<std::uint8_t> elsewhere(whole[0].size(), 0);
    for (std::size_t i = 0; i + 40 < elsewhere.size(); ++i) elsewhere[i] = whole[0][i + 40];
    CHECK(scene.mend(mender, 0, elsewhere).removed == 0);
}

TEST_CASE("a mask of two people keeps both, loses what belongs to neither; what either lacks is hidden") {
    const Turning scene(0.02);
    MaskMender mender = scene.watched();
    // The same person once more, to the right, partly behind: people overlap by an arm.
    const std::size_t t = 0;
    FrameNumbers beside = scene.frames[t];
    const vec3<double> step(0.62, 0, -0.3);
    beside.transl += step;
    std::vector<vec3<double>> vertices = scene.vertices[t];
    for (vec3<double>& vertex : vertices) vertex += step;
    const MaskClaim ann = scene.claim(mender, t);
    MaskClaim bob = mender.claim(beside, {}, scene.camera, Span<const vec3<double>>(vertices));
    std::vector<std::uint8_t> both = scene.masks[t];
    std::size_t bobs = 0, added = 0;
    for (std::size_t i = 0; i < both.size(); ++i) {
        bobs += bob.body[i] && !both[i];
        if (bob.body[i]) both[i] = 255;
    }
    REQUIRE(bobs > 1000);
    const auto count = [](const std::vector<std::uint8_t>& mask) {
        return static_cast<std::size_t>(std::count(mask.begin(), mask.end(), 255));
    };
    std::vector<std::uint8_t> mask = both, hidden(mask.size());
    CHECK(mend_mask({ann, bob}, mask, hidden).removed < 0.03);
    CHECK(mask == both);
    CHECK(count(hidden) < bobs / 200);
    // Ann alone would cut him off.
    CHECK(mend_mask({ann}, mask, hidden).removed > 0.5);
    CHECK(count(mask) < count(both) - bobs / 2);
    // A box above both is cut off; stripes through Bob's trunk are hidden, unless he is not believed.
    mask = both;
    for (int y = 5; y < 25; ++y)
        for (int x = 20; x < 60; ++x) {
            added += !mask[static_cast<std::size_t>(200 * y + x)];
            mask[static_cast<std::size_t>(200 * y + x)] = 255;
        }
    REQUIRE(added > 100);
    CHECK(mend_mask({ann, bob}, mask, hidden).removed > 0);
    CHECK(count(mask) == count(both));
    std::vector<std::uint8_t> striped = both;
    std::size_t lost = 0;
    for (std::size_t i = 0; i < striped.size(); ++i)
        if (bob.core[i] && !ann.body[i] && i / 200 % 8 < 2) lost += striped[i] != 0, striped[i] = 0;
    REQUIRE(lost > 100);
    mask = striped;
    CHECK(mend_mask({ann, bob}, mask, hidden).hidden > 0);
    CHECK(mask == striped);
    for (std::size_t i = 0; i < striped.size(); ++i) CHECK((hidden[i] != 0 || striped[i] == both[i]));
    bob.believed = false;
    mask = striped;
    CHECK(mend_mask({ann, bob}, mask, hidden).hidden < 0.005);
    CHECK(mask == striped); // and he is still not cut off
    // Who may be anywhere: nothing is cut.
    mask = both;
    CHECK(mend_mask({ann}, mask, hidden, false).removed == 0);
    std::vector<std::uint8_t> small(5);
    CHECK_THROWS_AS((void)mend_mask({ann}, mask, small), ShapeError);
}
