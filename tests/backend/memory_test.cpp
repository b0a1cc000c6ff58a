// SPDX-License-Identifier: Apache-2.0
/// @file  check_memory in every component, on the guarded backend; and that backend itself.
#include "support/contains.hpp"
#include "support/guarded.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/posed_surface.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/light/coarse_caster.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/loss/motion_terms.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/bodies.hpp"
#include "support/skinned_scene.hpp"

#include <doctest/doctest.h>

#include <sys/wait.h>

#include <array>
#include <csignal>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace memory_test { // joined builds: other tests use the same names

using namespace gsh;
using test::Guarded;
template <class T>
using Buffer = Guarded::Buffer<T>;

namespace {

template <class T>
std::vector<T> on_host(Guarded& backend, const Buffer<T>& buffer) {
    return downloaded(backend, Span<const T>(buffer));
}

/// The outcome of `work` in a child process: whether it crashed, and its output.
struct Crash {
    bool crashed = false;
    std::string output;
};
template <class Work>
Crash crash_of(const Work& work) {
    int ends[2];
    REQUIRE(pipe(ends) == 0);
    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
        close(ends[0]);
        dup2(ends[1], STDERR_FILENO);
        std::signal(SIGSEGV, SIG_DFL); // without doctest's handler, which would report a failure of this test
        Guarded backend;
        work(backend);
        _exit(0);
    }
    close(ends[1]);
    Crash crash;
    char bytes[4096];
    for (ssize_t count; (count = read(ends[0], bytes, sizeof bytes)) > 0;)
        crash.output.append(bytes, static_cast<std::size_t>(count));
    close(ends[0]);
    int status = 0;
    waitpid(child, &status, 0);
    crash.crashed = !WIFEXITED(status) || WEXITSTATUS(status) != 0;
    return crash;
}

/// Expects a MemoryError that names the function, the argument and the remedy.
template <class Work>
void check_refused(std::string_view function, std::string_view argument, const Work& work) {
    const std::string expected =
        std::string(function).append(": ").append(argument) +
        " is not memory of the backend 'guarded'; upload it into a Buffer of the backend first";
    CAPTURE(expected);
    std::string found = "nothing was thrown";
    try {
        work();
    } catch (const MemoryError& error) {
        found = error.what();
    }
    CHECK(found == expected);
}

struct Twice {
    Span<const float> from;
    Span<float> to;
    void operator()(std::size_t i) const { to[i] = 2 * from[i]; }
};

} // namespace

static_assert(Backend<Guarded> && !CpuBackend<Guarded>);
static_assert(cpu::Serial::host_memory && cpu::Threads::host_memory && !Guarded::host_memory);

TEST_CASE("numbers go in, are worked on and come back") {
    Guarded backend;
    const std::vector<float> numbers{1, 2, 3};
    const auto from = uploaded(backend, numbers);
    Buffer<float> to(3);
    backend.for_each(3, Twice{from, to});
    CHECK(on_host(backend, to) == std::vector<float>{2, 4, 6});
    backend.copy(Span<const float>(from), to);
    CHECK(on_host(backend, to) == numbers);
    backend.fill(Span<float>(to), 7.0f);
    CHECK(on_host(backend, to) == std::vector<float>{7, 7, 7});
    const Buffer<float> copied = to;
    CHECK(on_host(backend, copied) == std::vector<float>{7, 7, 7});
    Buffer<float> moved = std::move(to);
    moved.resize(2);
    CHECK(on_host(backend, moved).size() == 2);
    CHECK(backend.owns(moved.data(), 8));
    CHECK(!backend.owns(numbers.data(), 4));
    CHECK(!test::GuardedMemory::instance().is_open());
}

TEST_CASE("the host crashes where it reads or writes a buffer, and is told why") {
    const Crash read = crash_of([](Guarded&) {
        const Buffer<float> buffer(4);
        volatile float number = buffer[2];
        (void)number;
    });
    CHECK(read.crashed);
    CHECK(read.output == test::contains("guarded memory: the host touched a buffer"));
    CHECK(read.output.find('[') != std::string::npos); // the stack trace's addresses
    const Crash write = crash_of([](Guarded& backend) {
        Buffer<float> buffer(4);
        backend.fill(Span<float>(buffer), 1.0f);
        *const_cast<volatile float*>(buffer.data()) = 1;
    });
    CHECK(write.crashed);
    CHECK(write.output == test::contains("guarded memory"));
    const Crash other = crash_of([](Guarded&) { // the guard does not report other crashes
        void* closed = mmap(nullptr, 4096, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        *static_cast<volatile int*>(closed) = 1;
    });
    CHECK(other.crashed);
    CHECK(other.output != test::contains("guarded memory"));
    CHECK(!crash_of([](Guarded& backend) { (void)uploaded(backend, std::vector<float>(5000)); }).crashed);
}

TEST_CASE("its own functions take memory of the right side only") {
    Guarded backend;
    std::vector<float> host(3);
    Buffer<float> buffer(3);
    check_refused("Guarded::upload", "to", [&] { backend.upload(Span<const float>(host), Span<float>(host)); });
    check_refused("Guarded::download", "from", [&] { backend.download(Span<const float>(host), Span<float>(host)); });
    check_refused("Guarded::copy", "to", [&] { backend.copy(Span<const float>(buffer), Span<float>(host)); });
    check_refused("Guarded::copy", "from", [&] { backend.copy(Span<const float>(host), Span<float>(buffer)); });
    check_refused("Guarded::fill", "values", [&] { backend.fill(Span<float>(host), 0.0f); });
    CHECK_THROWS_AS(backend.upload(Span<const float>(buffer), Span<float>(buffer)), MemoryError);
    CHECK_THROWS_AS(backend.download(Span<const float>(buffer), Span<float>(buffer)), MemoryError);
#if __has_builtin(__builtin_clear_padding) // see Guarded::check_pointers
    CHECK_THROWS_AS(backend.for_each(3, Twice{host, buffer}), MemoryError);
    CHECK_THROWS_AS(backend.for_each(3, Twice{buffer, host}), MemoryError);
#endif
    CHECK_NOTHROW(backend.for_each(0, Twice{{}, {}}));
    CHECK_NOTHROW(backend.for_each(0, Twice{Span<const float>(host).subspan(0, 0), buffer}));
}

TEST_CASE("a backend with host memory takes any host memory, at no cost") {
    cpu::Serial backend;
    const std::vector<float> host(3);
    CHECK_NOTHROW(check_memory(backend, "test", "host", Span<const float>(host)));
}

TEST_CASE("skeleton, blend shapes and interpolation refuse host memory") {
    Guarded backend;
    const std::vector<int> parents{-1, 0};
    Skeleton<Guarded> skeleton(backend, parents);
    std::vector<vec3<float>> vectors(2);
    std::vector<mat3<float>> matrices(2);
    std::vector<Affine<float>> maps(2);
    std::vector<float> numbers(9);
    Buffer<vec3<float>> v(2);
    Buffer<mat3<float>> m(2);
    Buffer<Affine<float>> b(2);
    check_refused("Skeleton::rotations", "pose", [&] { skeleton.rotations(vectors, m); });
    check_refused("Skeleton::rotations", "rotations", [&] { skeleton.rotations(v, matrices); });
    check_refused("Skeleton::rotations_backward", "dL_dpose", [&] { skeleton.rotations_backward(v, m, vectors); });
    check_refused("Skeleton::feature", "feature", [&] { skeleton.feature(m, numbers); });
    check_refused("Skeleton::feature_backward", "dL_dfeature", [&] { skeleton.feature_backward(numbers, m); });
    check_refused("Skeleton::bones", "transl",
                  [&] { skeleton.bones(m, v, Span<const vec3<float>>(vectors).subspan(0, 1), b); });
    check_refused("Skeleton::bones_backward", "dL_dbones",
                  [&] { skeleton.bones_backward(m, v, b, maps, m, v, Span(v.data(), 1)); });

    const std::vector<vec3<double>> directions(4);
    const BlendShapes<Guarded> shapes(backend, 2, {directions});
    BlendShapes<Guarded>::Workspace workspace;
    Buffer<float> c(2);
    const auto two = Span<float>(numbers).subspan(0, 2);
    check_refused("BlendShapes::forward", "coefficients", [&] { shapes.forward(two, v); });
    check_refused("BlendShapes::forward", "offsets", [&] { shapes.forward(c, vectors); });
    check_refused("BlendShapes::backward", "dL_doffsets", [&] { shapes.backward(vectors, c, workspace); });
    check_refused("BlendShapes::backward", "dL_dcoefficients", [&] { shapes.backward(v, two, workspace); });

    const std::vector<std::array<int, 3>> triangles{{0, 1, 0}};
    const SurfaceInterpolation<Guarded> interpolation(backend, 2, triangles, std::vector<vec3<double>>(1));
    Buffer<vec3<float>> point(1);
    check_refused("SurfaceInterpolation::forward", "values", [&] { interpolation.forward(vectors, point); });
    check_refused("SurfaceInterpolation::backward", "dL_dvalues", [&] { interpolation.backward(point, vectors); });
}

/// Poses a tube and computes the visibility of its vertices from two lights, both passes: everything that it made.
template <class B>
std::vector<float> lit_surface(B& backend) {
    const BodyModel body = test::tube();
    const std::size_t V = body.vertex_count(), J = body.joint_count();
    const PosedSurface<B> surface(backend, body, {});
    const CoarseCaster<B> coarse(backend, body.v_template, body.faces, 0.1);
    const ShadowMaps<B> maps(backend);
    std::vector<Affine<float>> host_bones;
    for (const auto& bone : pose_body(body, std::vector<vec3<double>>(J, vec3<double>(0.3, 0.1, -0.5))).bones)
        host_bones.push_back({mat3<float>(bone.linear), vec3<float>(bone.translation)});
    const auto upload = [&]<class T>(const std::vector<T>& values) {
        typename B::template Buffer<T> buffer(values.size());
        backend.upload(Span<const T>(values), buffer);
        return buffer;
    };
    const auto bones = upload(host_bones);
    const auto offsets = upload(std::vector<vec3<float>>(V, vec3<float>(0.01f)));
    const auto points = upload(std::vector<vec3<float>>{{2, 2, 2}});
    const auto directions = upload(std::vector<vec3<float>>{{0, 1, 0}});
    typename B::template Buffer<float> visibility(2 * V);
    typename B::template Buffer<vec3<float>> dL_doffsets(V);
    typename B::template Buffer<Affine<float>> dL_dbones(J);
    backend.fill(Span<vec3<float>>(dL_doffsets), vec3<float>(0));
    backend.fill(Span<Affine<float>>(dL_dbones), Affine<float>::zero());
    typename PosedSurface<B>::Cache cache;
    typename CoarseCaster<B>::Cache picked;
    typename ShadowMaps<B>::Cache shadows;
    surface.forward(bones, offsets, cache);
    const std::array<ShadowCaster<float>, 2> casters{
        ShadowCaster<float>{cache.vertices, surface.triangles()}, coarse.forward(cache.vertices, picked)};
    maps.forward(casters, {.points = points, .directions = directions}, cache.vertices, cache.normals, visibility,
                 shadows);
    surface.backward(bones, offsets, cache.vertices, cache.normals, cache, dL_dbones, dL_doffsets);
    typename B::template Buffer<vec3<float>> bent(V);
    surface.offset_normals(bones, offsets, cache, bent);
    surface.offset_normals_backward(bones, offsets, bent, cache, dL_dbones, dL_doffsets);
    std::vector<float> result(2 * V + 3 * V + 12 * J);
    const auto part = [&](std::size_t first, std::size_t count) { return Span<float>(result).subspan(first, count); };
    backend.download(Span<const float>(visibility), part(0, 2 * V));
    backend.download(Span<const vec3<float>>(dL_doffsets), view_as<vec3<float>>(part(2 * V, 3 * V)));
    backend.download(Span<const Affine<float>>(dL_dbones), view_as<Affine<float>>(part(5 * V, 12 * J)));
    return result;
}

TEST_CASE("posed surfaces and shadow maps refuse host memory, and work without it") {
    Guarded backend;
    cpu::Serial serial;
    const auto found = lit_surface(backend);
    CHECK(found == lit_surface(serial));

    const BodyModel body = test::tube();
    const std::size_t V = body.vertex_count(), J = body.joint_count();
    const PosedSurface<Guarded> surface(backend, body, {});
    PosedSurface<Guarded>::Cache cache;
    std::vector<vec3<float>> vectors(V);
    std::vector<Affine<float>> maps(J);
    Buffer<vec3<float>> v(V), n(V);
    Buffer<Affine<float>> b(J);
    backend.fill(Span<vec3<float>>(v), vec3<float>(0));
    backend.fill(Span<vec3<float>>(n), vec3<float>(0));
    backend.fill(Span<Affine<float>>(b), Affine<float>());
    check_refused("PosedSurface::forward", "bones", [&] { surface.forward(maps, v, cache); });
    check_refused("PosedSurface::forward", "offsets", [&] { surface.forward(b, vectors, cache); });
    surface.forward(b, v, cache);
    check_refused("PosedSurface::offset_normals", "normal_offsets",
                  [&] { surface.offset_normals(b, vectors, cache, v); });
    check_refused("PosedSurface::offset_normals", "result", [&] { surface.offset_normals(b, v, cache, vectors); });
    check_refused("PosedSurface::offset_normals_backward", "dL_dnormal_offsets",
                  [&] { surface.offset_normals_backward(b, v, v, cache, b, vectors); });
    check_refused("PosedSurface::backward", "dL_dnormals", [&] { surface.backward(b, v, {}, vectors, cache, b, v); });
    check_refused("PosedSurface::backward", "dL_dbones", [&] { surface.backward(b, v, v, {}, cache, maps, v); });
    check_refused("PosedSurface::backward", "dL_doffsets", [&] { surface.backward(b, v, v, {}, cache, b, vectors); });

    const ShadowMaps<Guarded> shadows(backend);
    ShadowMaps<Guarded>::Cache shadow_cache;
    const std::vector<vec3<std::uint32_t>> triangles(1);
    Buffer<float> visibility(V);
    std::vector<float> host_visibility(V);
    const auto one = Span<const vec3<float>>(v).subspan(0, 1), host_one = Span<const vec3<float>>(vectors).subspan(0, 1);
    const auto cast = [&](const ShadowCaster<float>& caster, Span<const vec3<float>> point, Span<float> result) {
        shadows.forward(Span<const ShadowCaster<float>>(&caster, 1), {.points = point}, v, n, result, shadow_cache);
    };
    check_refused("ShadowMaps::forward", "light.points", [&] { cast({}, host_one, visibility); });
    check_refused("ShadowMaps::forward", "visibility", [&] { cast({}, one, host_visibility); });
    check_refused("ShadowMaps::forward", "caster.vertices", [&] { cast({vectors, {}}, one, visibility); });
    check_refused("ShadowMaps::forward", "caster.triangles", [&] { cast({v, triangles}, one, visibility); });
    const CoarseCaster<Guarded> coarse(backend, body.v_template, body.faces);
    CoarseCaster<Guarded>::Cache picked;
    check_refused("CoarseCaster::forward", "vertices", [&] { (void)coarse.forward(vectors, picked); });
}

TEST_CASE("fields refuse host memory") {
    Guarded backend;
    using Field = HashField<2, 2>;
    const Field field({.base = 4, .growth = 2, .table_size = 64}, {.outputs = 3, .width = 4, .hidden_layers = 1});
    const auto& grid = field.grid();
    std::vector<vec3<float>> points(5, vec3<float>(0.5f));
    std::vector<float> table(grid.parameter_count()), weights(field.mlp().parameter_count()), outputs(15), row(20);
    const auto p = uploaded(backend, points);
    auto t = uploaded(backend, table), w = uploaded(backend, weights), o = uploaded(backend, outputs),
         r = uploaded(backend, row);
    Field::Query<Guarded, float> query;
    Field::Cache<Guarded, float> cache;
    Mlp::Cache<Guarded, float> mlp_cache;
    check_refused("HashGrid::prepare", "points", [&] { field.prepare(backend, points, query); });
    check_refused("HashGrid::prepare", "weights.fine", [&] {
        field.prepare(backend, p, query, {.fine_level = 1, .region = Span<const float>(row).subspan(0, 5)});
    });
    field.prepare(backend, p, query);
    check_refused("HashGrid::forward", "table", [&] { field.forward(backend, table, w, query, o, cache); });
    check_refused("Mlp::forward", "weights", [&] { field.forward(backend, t, weights, query, o, cache); });
    check_refused("Mlp::forward", "outputs", [&] { field.forward(backend, t, w, query, outputs, cache); });
    field.forward(backend, t, w, query, o, cache);
    check_refused("Mlp::backward", "dL_doutputs", [&] { field.backward(backend, w, query, outputs, cache, t, w); });
    check_refused("Mlp::backward", "dL_dweights", [&] { field.backward(backend, w, query, o, cache, t, weights); });
    check_refused("HashGrid::backward", "dL_dtable", [&] { field.backward(backend, w, query, o, cache, table, w); });
    check_refused("HashGrid::backward_points", "dL_dpoints", [&] {
        grid.backward_points(backend, t, query.grids[0], row_major(Span<const float>(r), 4), points);
    });
    const Mlp mlp({.inputs = 4, .outputs = 3, .width = 4, .hidden_layers = 1});
    Buffer<float> mlp_weights(mlp.parameter_count());
    check_refused("Mlp::forward", "inputs.features",
                  [&] { mlp.forward(backend, mlp_weights, {row_major(Span<const float>(row), 4)}, o, mlp_cache); });
}

TEST_CASE("Adam refuses host memory") {
    Guarded backend;
    std::vector<float> host(6);
    std::vector<std::uint32_t> rows{0, 1};
    Buffer<float> a(6), g(6), m(6), v(6);
    const Adam adam;
    check_refused("Adam::step", "gradients", [&] { adam.step(backend, Span<float>(a), host, m, v, 0.1, 1); });
    check_refused("Adam::step", "parameters", [&] { adam.step(backend, Span<float>(host), g, m, v, 0.1, 1); });
    check_refused("Adam::step_rows", "rows",
                  [&] { adam.step_rows(backend, Span<float>(a), g, m, v, rows, 3, 0.1, 1); });
    check_refused("Adam::step_columns", "m",
                  [&] { adam.step_columns(backend, Span<float>(a), g, host, v, 3, 1, 0.1, 0.1, 1); });
}

TEST_CASE("posing, shading and rendering refuse host memory") {
    Guarded backend;
    constexpr int size = 8;
    const Camera<float> camera = look_at<double>({0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.6, size, size).cast<float>();
    test::SplatArrays<float> host(3);
    Splats<Guarded> splats, gradient;
    splats.resize(3), gradient.resize(3);
    fill_zero(backend, splats.view());
    const auto view = std::as_const(splats).view();
    std::vector<float> color(3 * size * size);
    Buffer<float> c(color.size());
    backend.fill(Span<float>(c), 0.0f);
    const ImageView<float> image{c, 3, size, size}, host_image{color, 3, size, size};
    const Rasterizer<Guarded> rasterizer(backend);
    Rasterizer<Guarded>::Cache cache;
    check_refused("Rasterizer::forward", "splats.means",
                  [&] { rasterizer.forward(camera, std::as_const(host).view(), {}, {.color = image}, cache); });
    check_refused("Rasterizer::forward", "color",
                  [&] { rasterizer.forward(camera, view, {}, {.color = host_image}, cache); });
    check_refused("Rasterizer::forward", "background",
                  [&] { rasterizer.forward(camera, view, {.image = host_image}, {.color = image}, cache); });
    rasterizer.forward(camera, view, {}, {.color = image}, cache);
    check_refused("Rasterizer::backward", "dL_dtarget.color",
                  [&] { rasterizer.backward(camera, view, {}, {.color = host_image}, cache, gradient.view()); });
    check_refused("Rasterizer::backward", "dL_dsplats.means",
                  [&] { rasterizer.backward(camera, view, {}, {.color = image}, cache, host.view()); });
    std::vector<CameraGradient<float>> dL_dcamera(1);
    check_refused("Rasterizer::backward", "dL_dcamera",
                  [&] { rasterizer.backward(camera, view, {}, {.color = image}, cache, gradient.view(), dL_dcamera); });

    const test::SkinnedScene<float> scene(3, 1, 1, 4);
    const SkinnedSplats<Guarded, 0> skin(backend);
    SkinnedSplats<Guarded, 0>::Cache skin_cache;
    check_refused("SkinnedSplats::forward", "gaussians.means",
                  [&] { skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), skin_cache); });
    check_refused("SkinnedSplats::backward", "gaussians.means", [&] {
        skin.backward(scene.input(), scene.bones, scene.center[0], view, skin_cache, SkinnedView<float>{});
    });

    const GaussianCloud<float> cloud(3, 0);
    Gaussians<Guarded> gaussians;
    upload(backend, cloud, gaussians);
    const auto all = std::as_const(gaussians).view();
    const vec3<float> center(0, 0, 3);
    const StaticSplats<Guarded, 0> to_splats(backend);
    StaticSplats<Guarded, 0>::Cache static_cache;
    check_refused("StaticSplats::forward", "gaussians.means",
                  [&] { to_splats.forward(cloud.view(), center, splats.view(), static_cache); });
    check_refused("StaticSplats::forward", "splats.means",
                  [&] { to_splats.forward(all, center, host.view(), static_cache); });
    std::vector<vec3<float>> dL_dcenter(1);
    check_refused("StaticSplats::backward", "dL_dcenter",
                  [&] { to_splats.backward(all, center, view, static_cache, gaussians.view(), dL_dcenter); });
}

TEST_CASE("lighting refuses host memory, and computes on the backend what Serial computes") {
    Guarded backend;
    const std::vector<std::array<int, 3>> triangles{{0, 1, 2}, {1, 2, 0}};
    const std::vector<vec3<double>> barycentric(2, vec3<double>(1.0 / 3));
    const std::vector<vec3<float>> points{{0, 1, 3}}, directions{{0, 0, 1}},
        vertices{{0, 0, 0}, {0, 1, 0}, {1, 0, 0}}, base(2, vec3<float>(0.5f)), normals(3, vec3<float>(0, 0, 1));
    const std::vector<float> log_intensities{1, -1}, gloss{0, 1}, visibility(6, 0.7f);
    const vec3<float> center(0, 0, 4);
    const LitSplatsInput<float> host{{points, directions, log_intensities, gloss}, vertices, normals, visibility, base,
                                     center};
    const auto p = uploaded(backend, points), d = uploaded(backend, directions), x = uploaded(backend, vertices),
               c = uploaded(backend, base), n = uploaded(backend, normals);
    const auto i = uploaded(backend, log_intensities), g = uploaded(backend, gloss), v = uploaded(backend, visibility);
    const LitSplatsInput<float> good{{p, d, i, g}, x, n, v, c, center};
    const LitSplats<Guarded> lit(backend, 3, triangles, barycentric);
    LitSplats<Guarded>::Cache cache;
    std::vector<vec3<float>> host_colors(2);
    Buffer<vec3<float>> colors(2);
    const auto refused = [&](std::string_view argument, auto break_it) {
        auto input = good;
        break_it(input);
        check_refused("LitSplats::forward", argument, [&] { lit.forward(input, colors, cache); });
    };
    refused("light.points", [&](auto& in) { in.light.points = host.light.points; });
    refused("light.log_intensities", [&](auto& in) { in.light.log_intensities = host.light.log_intensities; });
    refused("light.gloss", [&](auto& in) { in.light.gloss = host.light.gloss; });
    refused("vertices", [&](auto& in) { in.vertices = host.vertices; });
    refused("base", [&](auto& in) { in.base = host.base; });
    refused("normals", [&](auto& in) { in.normals = host.normals; });
    refused("visibility", [&](auto& in) { in.visibility = host.visibility; });
    check_refused("LitSplats::forward", "colors", [&] { lit.forward(good, host_colors, cache); });
    lit.forward(good, colors, cache);
    check_refused("LitSplats::backward", "dL_dcolors", [&] { lit.backward(good, host_colors, cache, {}); });
    check_refused("LitSplats::backward", "dL_din.base",
                  [&] { lit.backward(good, colors, cache, {.base = host_colors}); });
    std::vector<vec3<float>> dL_dnormals(3), dL_dpoints(1), dL_dcenter(1);
    check_refused("LitSplats::backward", "dL_din.vertices",
                  [&] { lit.backward(good, colors, cache, {.vertices = dL_dnormals}); });
    check_refused("LitSplats::backward", "dL_din.normals",
                  [&] { lit.backward(good, colors, cache, {.normals = dL_dnormals}); });
    check_refused("LitSplats::backward", "dL_din.light.points",
                  [&] { lit.backward(good, colors, cache, {.light = {.points = dL_dpoints}}); });
    check_refused("LitSplats::backward", "dL_din.center",
                  [&] { lit.backward(good, colors, cache, {.center = dL_dcenter}); });
    auto found_normals = uploaded(backend, dL_dnormals), found_points = uploaded(backend, dL_dpoints),
         found_center = uploaded(backend, dL_dcenter);
    lit.backward(good, colors, cache,
                 {.light = {.points = found_points}, .normals = found_normals, .center = found_center});

    cpu::Serial serial;
    const LitSplats<cpu::Serial> expected(serial, 3, triangles, barycentric);
    LitSplats<cpu::Serial>::Cache expected_cache;
    expected.forward(host, host_colors, expected_cache);
    expected.backward(host, host_colors, expected_cache,
                      {.light = {.points = dL_dpoints}, .normals = dL_dnormals, .center = dL_dcenter});
    CHECK(on_host(backend, colors) == host_colors);
    CHECK(on_host(backend, found_normals) == dL_dnormals);
    CHECK(on_host(backend, found_points) == dL_dpoints);
    CHECK(on_host(backend, found_center) == dL_dcenter);
    CHECK(dL_dpoints[0] != vec3<float>(0));
}

TEST_CASE("images, losses and terms of a motion refuse host memory") {
    Guarded backend;
    constexpr int size = 12;
    std::vector<float> host(3 * size * size);
    std::vector<std::uint8_t> bytes(4 * size * size);
    auto pixels = uploaded(backend, host);
    const auto rgba = uploaded(backend, bytes);
    const ImageView<float> image{pixels, 3, size, size}, host_image{host, 3, size, size};
    const Span<const std::uint8_t> host_bytes(bytes);
    check_refused("composite_rgba8", "rgba",
                  [&] { composite_rgba8(backend, host_bytes, size, size, vec3<float>(0), image); });
    check_refused("composite_rgba8", "out_color", [&] {
        composite_rgba8(backend, Span<const std::uint8_t>(rgba), size, size, vec3<float>(0), host_image);
    });
    check_refused("composite_rgba8", "background", [&] {
        composite_rgba8(backend, Span<const std::uint8_t>(rgba), size, size, ImageView<const float>(host_image), image);
    });

    const PhotometricLoss<Guarded> loss(backend);
    PhotometricLoss<Guarded>::Cache cache;
    check_refused("PhotometricLoss::forward", "truth", [&] { loss.forward(image, host_image, cache); });
    loss.forward(image, image, cache);
    CHECK(loss.values(cache).loss == 0);
    check_refused("PhotometricLoss::backward", "dL_drender",
                  [&] { loss.backward(image, image, 1, cache, host_image); });

    LpipsNetwork network{.name = "small", .steps = {{0, 2, 3, 1, 1, true}}};
    network.convolutions = {{std::vector<float>(2 * 3 * 9, 0.1f), std::vector<float>(2, 0.1f)}};
    network.lins = {{1, 1}};
    const Lpips<Guarded> lpips(backend, network);
    check_refused("Lpips::forward", "image", [&] { (void)lpips.distance(host_image, image); });
    CHECK(lpips.distance(image, image) == 0);
    cpu::Serial serial;
    std::vector<float> white(host.size(), 1.0f);
    const auto white_pixels = uploaded(backend, white);
    CHECK(lpips.distance(image, ImageView<const float>{white_pixels, 3, size, size}) ==
          Lpips<cpu::Serial>(serial, network).distance(host_image, ImageView<const float>{white, 3, size, size}));

    const std::vector<float> increments(6);
    const auto on_it = uploaded(backend, increments);
    Buffer<float> gradient(2), scratch;
    const std::vector<FrameLink> links(3);
    const auto links_on_it = uploaded(backend, links);
    const SequenceWeights weights{.pull = 1};
    const NumberSequence<float> good{links_on_it, on_it, on_it, 2, weights},
        bad{links_on_it, on_it, increments, 2, weights};
    check_refused("sequence_value", "sequence.increments", [&] { (void)sequence_value(backend, bad, scratch); });
    check_refused("sequence_backward", "sequence.increments",
                  [&] { sequence_backward(backend, bad, 1, Span<float>(gradient)); });
    CHECK(sequence_value(backend, good, scratch) == 0);
}

} // namespace memory_test
