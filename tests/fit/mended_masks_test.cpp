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
    MaskChange mend(MaskMender& mender, std::size_t t, std::vector<std::uint8_t>& mask) const {
        return mend_mask({claim(mender, t)}, mask);
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
            CHECK(change.filled < 0.002);
        }
    }
}

TEST_CASE("a thing beside the person is cut off, a lost limb is filled in, in the photographs that have them") {
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
    for (const std::size_t t : {3, 4, 9}) {
        const double before = wrong(t);
        const MaskChange change = scene.mend(mender, t, scene.masks[t]);
        CAPTURE(t);
        CHECK((t == 9 ? change.filled : change.removed) > 0.02);
        CHECK(wrong(t) < (t == 9 ? 0.75 : 0.5) * before); // within 2.5 cm of its outline, a limb is not filled in
    }
    // Where the body is not where the mask is, nothing is cut off.
    std::vector<std::uint8_t> elsewhere(whole[0].size(), 0);
    for (std::size_t i = 0; i + 40 < elsewhere.size(); ++i) elsewhere[i] = whole[0][i + 40];
    CHECK(scene.mend(mender, 0, elsewhere).removed == 0);
}

TEST_CASE("a mask of two people keeps both, loses what belongs to neither, and gets back what either lacks") {
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
    std::vector<std::uint8_t> mask = both;
    CHECK(mend_mask({ann, bob}, mask).removed < 0.03);
    CHECK(mask == both);
    // Ann alone would cut him off.
    CHECK(mend_mask({ann}, mask).removed > 0.5);
    CHECK(count(mask) < count(both) - bobs / 2);
    // A box above both is cut off; a stripe through Bob's trunk is filled in, unless he is not believed.
    mask = both;
    for (int y = 5; y < 25; ++y)
        for (int x = 20; x < 60; ++x) {
            added += !mask[static_cast<std::size_t>(200 * y + x)];
            mask[static_cast<std::size_t>(200 * y + x)] = 255;
        }
    CHECK(mend_mask({ann, bob}, mask).removed > 0);
    CHECK(count(mask) == count(both));
    std::vector<std::uint8_t> striped = both;
    for (std::size_t i = 0; i < striped.size(); ++i)
        if (bob.core[i] && !ann.body[i] && i / 200 % 8 < 2) striped[i] = 0;
    mask = striped;
    mend_mask({ann, bob}, mask);
    CHECK(mask == both);
    bob.believed = false;
    mask = striped;
    mend_mask({ann, bob}, mask);
    CHECK(mask == striped); // and he is still not cut off
    // Who may be anywhere: nothing is cut.
    mask = both;
    CHECK(mend_mask({ann}, mask, false).removed == 0);
}
