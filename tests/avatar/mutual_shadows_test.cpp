// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/mutual_shadows.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace {

using namespace gsh;

/// The people whose meshes each person receives, for people at these roots; those in `unlit` have no mesh.
std::vector<std::vector<std::size_t>> others_of(const std::vector<vec3<double>>& roots,
                                                const std::vector<std::size_t>& unlit = {}) {
    const std::vector<vec3<std::uint32_t>> triangles(1);
    std::vector<std::vector<vec3<float>>> vertices(roots.size(), std::vector<vec3<float>>(1));
    std::vector<std::vector<std::size_t>> result;
    const auto caster = [&](std::size_t p) {
        ShadowCaster<float> mesh{vertices[p], triangles};
        for (const std::size_t person : unlit)
            if (person == p) mesh.triangles = {};
        return mesh;
    };
    pose_people<float>(roots, caster, [&](std::size_t p, Span<const ShadowCaster<float>> others) {
        CHECK(p == result.size());
        std::vector<std::size_t>& of = result.emplace_back();
        for (const ShadowCaster<float>& mesh : others)
            for (std::size_t k = 0; k < vertices.size(); ++k)
                if (mesh.vertices.data() == vertices[k].data()) of.push_back(k);
    });
    return result;
}
using People = std::vector<std::vector<std::size_t>>;

} // namespace

TEST_CASE("people within reach receive each other's meshes, but not their own") {
    CHECK(others_of({{0, 0, 0}, {1, 0, 0}, {0, 0, 3.9}}) == People{{1, 2}, {0}, {0}});
    CHECK(others_of({{0, 0, 0}, {0, 0, shadow_reach}}) == People{{}, {}});
}

TEST_CASE("people without a light cast no shadow and may receive those of others") {
    CHECK(others_of({{0, 0, 0}, {1, 0, 0}}, {1}) == People{{}, {0}});
}

TEST_CASE("the mesh of a person alone is not computed") {
    std::size_t posed = 0;
    const std::vector<vec3<double>> roots(1, vec3<double>(0.0));
    pose_people<float>(
        roots, [](std::size_t) -> ShadowCaster<float> { throw 1; },
        [&](std::size_t, Span<const ShadowCaster<float>> others) { posed += 1 + others.size(); });
    CHECK(posed == 1);
    pose_people<float>(
        Span<const vec3<double>>(), [](std::size_t) { return ShadowCaster<float>(); },
        [&](std::size_t, Span<const ShadowCaster<float>>) { ++posed; });
    CHECK(posed == 1);
}
