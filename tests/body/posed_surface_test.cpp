// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"
#include "support/gradient.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/posed_surface.hpp>

#include <cstring>
#include <type_traits>

namespace gsh {
namespace {

/// A bent tube: bones that blend visibly, and random canonical offsets of up to a centimetre.
struct BentTube {
    BodyModel body;
    std::vector<Affine<double>> bones;
    std::vector<vec3<double>> offsets;

    explicit BentTube(std::size_t joints = 4, std::size_t rings = 20, std::uint64_t seed = 3)
        : body(test::tube(joints, rings)) {
        test::Rng rng(seed);
        const auto pose = rng.vecs(joints, -0.5, 0.5);
        bones = pose_body(body, pose, {0.3, -0.2, 0.5}).bones;
        offsets = rng.vecs(body.vertex_count(), -0.01, 0.01);
    }
};

using TubeSurface = PosedSurface<cpu::Serial, double>;

TEST_CASE("the posed surface is that of pose_body, with its vertex normals") {
    const BodyModel body = test::tube();
    test::Rng rng(1);
    const auto pose = rng.vecs(4, -0.6, 0.6);
    const std::vector<double> betas{0.5, -1, 2}, expression{1, -0.7};
    const PosedBody expected = pose_body(body, pose, {0.1, 0.2, -0.3}, betas, expression);
    const auto expected_normals = vertex_normals(expected.vertices, body.faces);

    std::vector<double> feature(body.pose_feature_count());
    for (std::size_t j = 1; j < 4; ++j) pose_feature<double>(j, rotation_from_axis_angle(pose[j]), feature);
    std::vector<vec3<double>> offsets(body.vertex_count(), vec3<double>(0));
    for (std::size_t v = 0; v < offsets.size(); ++v) {
        for (std::size_t k = 0; k < 2; ++k) offsets[v] += body.exprdirs[v * 2 + k] * expression[k];
        for (std::size_t k = 0; k < feature.size(); ++k)
            offsets[v] += body.posedirs[v * feature.size() + k] * feature[k];
    }
    cpu::Serial backend;
    const TubeSurface surface(backend, body, betas);
    TubeSurface::Cache cache;
    surface.forward(expected.bones, offsets, cache);
    REQUIRE(cache.vertices.size() == body.vertex_count());
    CHECK(surface.triangle_count() == body.faces.size());
    for (std::size_t v = 0; v < offsets.size(); ++v) {
        CHECK(length(cache.vertices[v] - expected.vertices[v]) < 1e-12);
        CHECK(length(cache.normals[v] - expected_normals[v]) < 1e-9);
        CHECK(length(cache.normals[v]) == doctest::Approx(1).epsilon(1e-12));
    }
}

TEST_CASE("PosedSurface::backward is the gradient of forward, and adds") {
    BentTube scene;
    test::Rng rng(4);
    const std::size_t V = scene.body.vertex_count();
    cpu::Serial backend;
    const TubeSurface surface(backend, scene.body, {});
    for (const int through : {1, 2, 3}) { // vertices, normals, both
        CAPTURE(through);
        const auto dL_dvertices = through & 1 ? rng.vecs(V) : std::vector<vec3<double>>();
        const auto dL_dnormals = through & 2 ? rng.vecs(V) : std::vector<vec3<double>>();
        TubeSurface::Cache cache;
        surface.forward(scene.bones, scene.offsets, cache);
        std::vector<Affine<double>> dL_dbones(scene.bones.size(), Affine<double>::zero());
        std::vector<vec3<double>> dL_doffsets(V, vec3<double>(0));
        surface.backward(scene.bones, scene.offsets, dL_dvertices, dL_dnormals, cache, dL_dbones, dL_doffsets);
        const auto loss = [&] {
            TubeSurface::Cache other;
            surface.forward(scene.bones, scene.offsets, other);
            double sum = 0;
            for (std::size_t v = 0; v < dL_dvertices.size(); ++v) sum += dot(other.vertices[v], dL_dvertices[v]);
            for (std::size_t v = 0; v < dL_dnormals.size(); ++v) sum += dot(other.normals[v], dL_dnormals[v]);
            return sum;
        };
        test::check_gradient(loss, test::scalars(scene.bones), test::scalars(dL_dbones), {.step = 1e-6});
        test::check_gradient(loss, test::scalars(scene.offsets), test::scalars(dL_doffsets),
                             {.step = 1e-6, .stride = 13});

        const auto once_bones = dL_dbones;
        const auto once_offsets = dL_doffsets;
        surface.backward(scene.bones, scene.offsets, dL_dvertices, dL_dnormals, cache, dL_dbones, dL_doffsets);
        for (std::size_t j = 0; j < dL_dbones.size(); ++j)
            CHECK(dL_dbones[j].translation == once_bones[j].translation * 2.0);
        for (std::size_t v = 0; v < V; ++v) CHECK(dL_doffsets[v] == once_offsets[v] * 2.0);

        // Each output alone is the same.
        std::vector<Affine<double>> bones_alone(scene.bones.size(), Affine<double>::zero());
        std::vector<vec3<double>> offsets_alone(V, vec3<double>(0));
        surface.backward(scene.bones, scene.offsets, dL_dvertices, dL_dnormals, cache, bones_alone, {});
        surface.backward(scene.bones, scene.offsets, dL_dvertices, dL_dnormals, cache, {}, offsets_alone);
        CHECK(offsets_alone == once_offsets);
        CHECK(bones_alone[2].linear == once_bones[2].linear);
    }
}

TEST_CASE("normals with offsets turn with the skin, and their adjoint is the gradient") {
    BentTube scene;
    test::Rng rng(7);
    const std::size_t V = scene.body.vertex_count();
    cpu::Serial backend;
    const TubeSurface surface(backend, scene.body, {});
    TubeSurface::Cache cache;
    auto normal_offsets = rng.vecs(V, -0.5, 0.5);
    const auto dL_dresult = rng.vecs(V);
    const auto result = [&] {
        std::vector<vec3<double>> normals(V);
        surface.forward(scene.bones, scene.offsets, cache);
        surface.offset_normals(scene.bones, normal_offsets, cache, normals);
        return normals;
    };
    const auto loss = [&] {
        double sum = 0;
        const auto normals = result();
        for (std::size_t v = 0; v < V; ++v) sum += dot(normals[v], dL_dresult[v]);
        return sum;
    };
    loss();
    std::vector<Affine<double>> dL_dbones(scene.bones.size(), Affine<double>::zero());
    std::vector<vec3<double>> dL_doffsets(V, vec3<double>(0)), dL_dnormal_offsets(V, vec3<double>(0));
    surface.offset_normals_backward(scene.bones, normal_offsets, dL_dresult, cache, dL_dbones, dL_dnormal_offsets);
    surface.backward(scene.bones, scene.offsets, {}, dL_dresult, cache, dL_dbones, dL_doffsets);
    test::check_gradient(loss, test::scalars(scene.bones), test::scalars(dL_dbones), {.step = 1e-6});
    test::check_gradient(loss, test::scalars(normal_offsets), test::scalars(dL_dnormal_offsets), {.stride = 13});
    test::check_gradient(loss, test::scalars(scene.offsets), test::scalars(dL_doffsets), {.step = 1e-6, .stride = 13});

    // A turn of the whole body turns the normals.
    const auto before = result();
    const mat3<double> turn = rotation_from_axis_angle(vec3<double>(0.4, -0.8, 0.3));
    for (Affine<double>& bone : scene.bones) bone = {turn * bone.linear, turn * bone.translation};
    const auto after = result();
    for (std::size_t v = 0; v < V; ++v) CHECK(length(after[v] - turn * before[v]) < 1e-9);
    // Offsets of zero leave the mesh's normals.
    normal_offsets.assign(V, vec3<double>(0));
    const auto plain = result();
    CHECK(std::equal(plain.begin(), plain.end(), cache.normals.begin()));
    std::vector<vec3<double>> few(3);
    CHECK_THROWS_AS(surface.offset_normals(scene.bones, few, cache, few), ShapeError);
    CHECK_THROWS_AS(surface.offset_normals_backward(scene.bones, normal_offsets, few, cache, dL_dbones, {}),
                    ShapeError);
}

TEST_CASE("a surface without area has normal zero and passes no gradient to it") {
    BodyModel body = test::tube();
    body.v_template.push_back({0.2, 0.3, 0.4}); // a vertex without triangles
    const auto lone = static_cast<int>(body.vertex_count()) - 1;
    body.v_template.push_back({0.5, 0.3, 0.4}); // a vertex with a degenerate triangle
    body.faces.push_back({lone + 1, 0, 0});
    for (int n = 0; n < 2; ++n) body.weights.insert(body.weights.end(), {1, 0, 0, 0});
    body.shapedirs.clear(), body.exprdirs.clear(), body.posedirs.clear();
    body.shape_count = body.expression_count = 0;
    const std::size_t V = body.vertex_count();
    cpu::Serial backend;
    const TubeSurface surface(backend, body, {});
    const std::vector<Affine<double>> bones(4);
    const std::vector<vec3<double>> offsets(V, vec3<double>(0)), ones(V, vec3<double>(1));
    TubeSurface::Cache cache;
    surface.forward(bones, offsets, cache);
    CHECK(cache.normals[V - 2] == vec3<double>(0));
    CHECK(cache.normals[V - 1] == vec3<double>(0));
    CHECK(length(cache.normals[0]) > 0.99);
    std::vector<vec3<double>> dL_doffsets(V, vec3<double>(0));
    surface.backward(bones, offsets, {}, ones, cache, {}, dL_doffsets);
    CHECK(dL_doffsets[V - 2] == vec3<double>(0));
    for (std::size_t v = 0; v < V; ++v) CHECK(std::isfinite(dL_doffsets[v].x));
}

TEST_CASE_TEMPLATE("both passes of PosedSurface are bit-identical on Threads and Serial", T, float, double) {
    const BentTube scene(6, 160); // several chunks of the backend
    test::Rng rng(5);
    const std::size_t V = scene.body.vertex_count(), J = scene.bones.size();
    std::vector<Affine<T>> bones(J);
    for (std::size_t j = 0; j < J; ++j)
        bones[j] = {mat3<T>(scene.bones[j].linear), vec3<T>(scene.bones[j].translation)};
    const auto cast = [](const std::vector<vec3<double>>& values) {
        return std::vector<vec3<T>>(values.begin(), values.end());
    };
    const auto offsets = cast(scene.offsets), dL_dvertices = cast(rng.vecs(V)), dL_dnormals = cast(rng.vecs(V));
    const auto run = [&](auto&& backend) {
        using B = std::remove_reference_t<decltype(backend)>;
        const PosedSurface<B, T> surface(backend, scene.body, {});
        typename PosedSurface<B, T>::Cache cache;
        surface.forward(bones, offsets, cache);
        std::vector<vec3<T>> out(V + 4 * J, vec3<T>(T(0)));
        const auto dL_dbones = view_as<Affine<T>>(Span<vec3<T>>(out).subspan(V, 4 * J));
        surface.backward(bones, offsets, dL_dvertices, dL_dnormals, cache, dL_dbones,
                         Span<vec3<T>>(out).subspan(0, V));
        out.insert(out.end(), cache.vertices.begin(), cache.vertices.end());
        out.insert(out.end(), cache.normals.begin(), cache.normals.end());
        return out;
    };
    const auto expected = run(cpu::Serial());
    for (const std::size_t threads : {1, 2, 3, 7}) {
        const auto found = run(cpu::Threads(threads));
        CHECK(std::memcmp(found.data(), expected.data(), expected.size() * sizeof(expected[0])) == 0);
    }
}

TEST_CASE("PosedSurface refuses arrays of the wrong size and a body that is inconsistent") {
    const BentTube scene;
    cpu::Serial backend;
    const TubeSurface surface(backend, scene.body, {});
    const std::size_t V = scene.body.vertex_count();
    TubeSurface::Cache cache;
    std::vector<vec3<double>> few(3), right(V, vec3<double>(0));
    std::vector<Affine<double>> few_bones(1), dL_dbones(4);
    CHECK_THROWS_AS(surface.forward(few_bones, right, cache), ShapeError);
    CHECK_THROWS_AS(surface.forward(scene.bones, few, cache), ShapeError);
    CHECK_THROWS_AS(surface.backward(scene.bones, right, right, {}, cache, dL_dbones, right), ShapeError);
    surface.forward(scene.bones, right, cache);
    CHECK_THROWS_AS(surface.backward(scene.bones, right, few, {}, cache, dL_dbones, {}), ShapeError);
    CHECK_THROWS_AS(surface.backward(scene.bones, right, {}, few, cache, dL_dbones, {}), ShapeError);
    CHECK_THROWS_AS(surface.backward(scene.bones, right, right, {}, cache, few_bones, {}), ShapeError);
    CHECK_THROWS_AS(surface.backward(scene.bones, right, right, {}, cache, dL_dbones, few), ShapeError);
    CHECK_NOTHROW(surface.backward(scene.bones, right, {}, {}, cache, dL_dbones, {}));

    BodyModel body = test::tube();
    body.faces[0][1] = static_cast<int>(body.vertex_count());
    CHECK_THROWS_AS(TubeSurface(backend, body, {}), ValueError);
    body = test::tube();
    body.weights.pop_back();
    CHECK_THROWS_AS(TubeSurface(backend, body, {}), ShapeError);
    CHECK_THROWS_AS(TubeSurface(backend, test::tube(), std::vector<double>(4)), ShapeError);
}

} // namespace
} // namespace gsh
