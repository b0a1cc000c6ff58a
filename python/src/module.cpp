// SPDX-License-Identifier: Apache-2.0
/// @file  The extension module gsh._gsh: arrays of Python, by DLPack, for the functions of libgsh-python.
///
/// Its functions are for gsh's own Python code, which checks what users pass and makes the arrays of results. They
/// check once more that each array has the shape and the type that the library will read or write.

#include "posing_module.hpp"
#include "interface.hpp"
#include "library_call.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

namespace nb = nanobind;
using namespace gsh_python;

namespace {

using Array = nb::ndarray<nb::device::cpu>;
using Optional = std::optional<Array>;

const Api& api() { return *gsh_python_api(); }

using Shape = std::initializer_list<std::int64_t>;

[[nodiscard]] std::string text(Shape shape) {
    std::string text = "[";
    for (const std::int64_t n : shape) text += (text.size() > 1 ? ", " : "") + std::to_string(n);
    return text + "]";
}

/// Throws unless the array has this shape and type; -1 stands for any number, as does a row's stride.
void check_array(const Array& array, const char* name, Shape shape, bool integer, std::size_t bytes,
                 bool contiguous = true) {
    bool fits = array.ndim() == shape.size();
    std::size_t axis = 0;
    for (const std::int64_t n : shape) fits = fits && array.shape(axis++) == static_cast<std::size_t>(n);
    if (!fits) {
        std::string found = "[";
        for (std::size_t i = 0; i < array.ndim(); ++i) found += (i ? ", " : "") + std::to_string(array.shape(i));
        throw nb::value_error((std::string(name) + " has the shape " + found + "], expected " + text(shape)).c_str());
    }
    const auto code = static_cast<std::uint8_t>(integer ? nb::dlpack::dtype_code::Int : nb::dlpack::dtype_code::Float);
    if (array.dtype().code != code || array.dtype().bits != 8 * bytes || array.dtype().lanes != 1)
        throw nb::value_error((std::string(name) + " has another number type than the other arguments").c_str());
    if (!contiguous || array.size() == 0) return;
    std::int64_t stride = 1;
    for (std::size_t i = array.ndim(); i-- > 0;) {
        if (array.shape(i) != 1 && array.stride(i) != stride)
            throw nb::value_error((std::string(name) + " is not contiguous").c_str());
        stride *= static_cast<std::int64_t>(array.shape(i));
    }
}

/// The arrays of a call: checks them against its sizes.
struct Call {
    Sizes sizes;
    std::size_t bytes;

    Call(const Array& means, const Array& viewmats, int threads) {
        if (means.ndim() != 3 || viewmats.ndim() != 4)
            throw nb::value_error("means is not [B, N, 3], or viewmats not [B, C, 4, 4]");
        bytes = means.dtype().bits / 8;
        if (bytes != 4 && bytes != 8) throw nb::value_error("means is neither of float32 nor of float64");
        sizes = {static_cast<std::int64_t>(means.shape(0)), static_cast<std::int64_t>(viewmats.shape(1)),
                 static_cast<std::int64_t>(means.shape(1)), static_cast<int>(bytes), threads};
    }
    [[nodiscard]] void* operator()(const Array& array, const char* name, Shape shape) const {
        check_array(array, name, shape, false, bytes);
        return array.data();
    }
    [[nodiscard]] void* operator()(const Optional& array, const char* name, Shape shape) const {
        return array ? (*this)(*array, name, shape) : nullptr;
    }
    [[nodiscard]] std::int32_t* radii(const Array& array) const {
        check_array(array, "radii", {sizes.batches, sizes.cameras, sizes.count, 2}, true, 4);
        return static_cast<std::int32_t*>(array.data());
    }
    [[nodiscard]] SplatArrays splats(const Array& means, const Optional& quats, const Optional& scales,
                                     const Optional& covars, const Optional& opacities,
                                     const Optional& factors = std::nullopt) const {
        const std::int64_t b = sizes.batches, n = sizes.count;
        if (!covars && !factors && !(quats && scales))
            throw nb::value_error("neither covars nor quats and scales are given");
        return {(*this)(means, "means", {b, n, 3}), (*this)(quats, "quats", {b, n, 4}),
                (*this)(scales, "scales", {b, n, 3}), (*this)(covars, "covars", {b, n, 6}),
                (*this)(opacities, "opacities", {b, n}), (*this)(factors, "factors", {b, n, 9})};
    }
    [[nodiscard]] CameraArrays cameras(const Array& viewmats, const Array& Ks, int width, int height) const {
        return {(*this)(viewmats, "viewmats", {sizes.batches, sizes.cameras, 4, 4}),
                (*this)(Ks, "Ks", {sizes.batches, sizes.cameras, 3, 3}), width, height};
    }
    [[nodiscard]] void* image_array(const Optional& array, const char* name, std::int64_t numbers) const {
        return (*this)(array, name, {sizes.batches, sizes.cameras, sizes.count, numbers});
    }
    [[nodiscard]] void* image_array(const Optional& array, const char* name) const {
        return (*this)(array, name, {sizes.batches, sizes.cameras, sizes.count});
    }
};

[[nodiscard]] ProjectionSettings settings_of(const nb::tuple& s) {
    return {nb::cast<double>(s[0]), nb::cast<double>(s[1]), nb::cast<double>(s[2]), nb::cast<double>(s[3]),
            nb::cast<bool>(s[4]) ? 1 : 0, nb::cast<double>(s[5]), nb::cast<double>(s[6]), nb::cast<double>(s[7])};
}

void project(const Array& means, const Optional& quats, const Optional& scales, const Optional& covars,
             const Optional& opacities, const Array& viewmats, const Array& Ks, int width, int height,
             const nb::tuple& settings, int threads, const Array& radii, const Array& means2d, const Array& depths,
             const Array& conics, const Optional& compensations, const Optional& screen_opacities,
             const Optional& factors) {
    const Call call(means, viewmats, threads);
    const SplatArrays splats = call.splats(means, quats, scales, covars, opacities);
    const CameraArrays cameras = call.cameras(viewmats, Ks, width, height);
    const ProjectedArrays out{call.radii(radii), call.image_array(means2d, "means2d", 2),
                              call.image_array(depths, "depths"), call.image_array(conics, "conics", 3),
                              call.image_array(compensations, "compensations"),
                              call.image_array(screen_opacities, "screen_opacities"),
                              call(factors, "factors", {call.sizes.batches, call.sizes.count, 9})};
    const ProjectionSettings s = settings_of(settings);
    run([&] { return api().project(call.sizes, splats, cameras, s, out); });
}

void project_backward(const Array& means, const Optional& quats, const Optional& scales, const Optional& covars,
                      const Optional& opacities, const Array& viewmats, const Array& Ks, int width, int height,
                      const nb::tuple& settings, int threads, const Array& radii, const Optional& dL_dmeans2d, const Optional& dL_ddepths,
                      const Optional& dL_dconics, const Optional& dL_dcompensations,
                      const Optional& dL_dscreen_opacities, const Optional& dL_dmeans, const Optional& dL_dquats,
                      const Optional& dL_dscales, const Optional& dL_dcovars, const Optional& dL_dopacities,
                      const Optional& dL_dviewmats, const Optional& dL_dKs) {
    const Call call(means, viewmats, threads);
    const SplatArrays splats = call.splats(means, quats, scales, covars, opacities);
    if (dL_dscreen_opacities && !opacities) throw nb::value_error("opacities is not given");
    const CameraArrays cameras = call.cameras(viewmats, Ks, width, height);
    const std::int64_t b = call.sizes.batches, c = call.sizes.cameras, n = call.sizes.count;
    const ProjectedGradients dL{call.image_array(dL_dmeans2d, "dL_dmeans2d", 2),
                                call.image_array(dL_ddepths, "dL_ddepths"),
                                call.image_array(dL_dconics, "dL_dconics", 3),
                                call.image_array(dL_dcompensations, "dL_dcompensations"),
                                call.image_array(dL_dscreen_opacities, "dL_dscreen_opacities")};
    const SplatGradients out{call(dL_dmeans, "dL_dmeans", {b, n, 3}), call(dL_dquats, "dL_dquats", {b, n, 4}),
                             call(dL_dscales, "dL_dscales", {b, n, 3}), call(dL_dcovars, "dL_dcovars", {b, n, 6}),
                             call(dL_dopacities, "dL_dopacities", {b, n})};
    const CameraGradients camera_out{call(dL_dviewmats, "dL_dviewmats", {b, c, 4, 4}),
                                     call(dL_dKs, "dL_dKs", {b, c, 3, 3})};
    const std::int32_t* const r = call.radii(radii);
    const ProjectionSettings s = settings_of(settings);
    run([&] { return api().project_backward(call.sizes, splats, cameras, s, r, dL, out, camera_out); });
}

constexpr const char* pass_name = "gsh.pass";

/// `colors` is [B, N, D] or [B, C, N, D], or None for depth alone.
nb::capsule rasterize(const Array& means, const Optional& factors, const Optional& covars, const Array& opacities,
                      const Array& viewmats, const Array& Ks, int width, int height,
                      const nb::tuple& settings, int threads, const Array& radii, const Optional& colors,
                      const Optional& backgrounds, bool with_depth, const Array& render, const Array& alphas) {
    const Call call(means, viewmats, threads);
    const SplatArrays splats = call.splats(means, std::nullopt, std::nullopt, covars, opacities, factors);
    const CameraArrays cameras = call.cameras(viewmats, Ks, width, height);
    const std::int64_t b = call.sizes.batches, c = call.sizes.cameras, n = call.sizes.count;
    ColorArrays color{nullptr, nullptr, 0, 0};
    std::int64_t channels = 0;
    if (colors) {
        channels = static_cast<std::int64_t>(colors->shape(colors->ndim() - 1));
        color.per_camera = colors->ndim() == 4;
        color.colors = color.per_camera ? call(*colors, "colors", {b, c, n, channels})
                                        : call(*colors, "colors", {b, n, channels});
        color.channels = static_cast<int>(channels);
    }
    color.backgrounds = call(backgrounds, "backgrounds", {b, c, channels});
    void* const out = call(render, "render", {b, c, height, width, channels + (with_depth ? 1 : 0)});
    void* const alpha = call(alphas, "alphas", {b, c, height, width});
    const std::int32_t* const r = call.radii(radii);
    const ProjectionSettings s = settings_of(settings);
    void* pass = nullptr;
    run([&] { return api().rasterize(call.sizes, splats, cameras, s, r, color, with_depth, out, alpha, &pass); });
    return nb::capsule(pass, pass_name, [](void* p) noexcept { api().release(p); });
}

/// The last axes of colour gradients and of dL_drender belong together. All are those of the pass.
void rasterize_backward(const nb::capsule& pass, const Array& means, const Array& viewmats, int width, int height,
                        int threads, int channels, bool per_camera, bool with_depth, const Optional& dL_drender,
                        const Optional& dL_dalphas, const Optional& dL_dmeans2d, const Optional& dL_ddepths,
                        const Optional& dL_dconics, const Optional& dL_dopacities, const Optional& dL_dcolors,
                        const Optional& dL_dbackgrounds, const Optional& absolute_means2d) {
    const Call call(means, viewmats, threads);
    const std::int64_t b = call.sizes.batches, c = call.sizes.cameras, n = call.sizes.count;
    ImageGradients dL{};
    if (dL_drender) {
        check_array(*dL_drender, "dL_drender", {b * c, height, width, channels + (with_depth ? 1 : 0)}, false,
                    call.bytes, false);
        dL.render = dL_drender->data();
        for (std::size_t i = 0; i < 4; ++i) dL.render_strides[i] = dL_drender->stride(i);
    }
    if (dL_dalphas) {
        check_array(*dL_dalphas, "dL_dalphas", {b * c, height, width}, false, call.bytes, false);
        dL.alphas = dL_dalphas->data();
        for (std::size_t i = 0; i < 3; ++i) dL.alpha_strides[i] = dL_dalphas->stride(i);
    }
    ScreenGradients out{};
    out.means2d = call.image_array(dL_dmeans2d, "dL_dmeans2d", 2);
    out.depths = call.image_array(dL_ddepths, "dL_ddepths");
    out.conics = call.image_array(dL_dconics, "dL_dconics", 3);
    out.opacities = call.image_array(dL_dopacities, "dL_dopacities");
    out.absolute_means2d = call.image_array(absolute_means2d, "absolute_means2d", 2);
    if (dL_dcolors)
        out.colors = per_camera ? call(*dL_dcolors, "dL_dcolors", {b, c, n, channels})
                                : call(*dL_dcolors, "dL_dcolors", {b, n, channels});
    out.backgrounds = call(dL_dbackgrounds, "dL_dbackgrounds", {b, c, channels});
    void* const p = pass.data(pass_name);
    run([&] { return api().rasterize_backward(p, threads, dL, out); });
}

/// Returns the number of Gaussians with radii [B, C, N, 2] above 0, and writes to the first columns of ids [4, B C N]:
/// places in [B * C * N], batches, cameras, Gaussians.
std::int64_t find_visible(const Array& radii, const Array& ids) {
    if (radii.ndim() != 4) throw nb::value_error("radii is not [B, C, N, 2]");
    const Sizes sizes{static_cast<std::int64_t>(radii.shape(0)), static_cast<std::int64_t>(radii.shape(1)),
                      static_cast<std::int64_t>(radii.shape(2)), 4, 1};
    const std::int64_t all = sizes.batches * sizes.cameras * sizes.count;
    check_array(radii, "radii", {sizes.batches, sizes.cameras, sizes.count, 2}, true, 4);
    check_array(ids, "ids", {4, all}, true, 8);
    const auto* const r = static_cast<const std::int32_t*>(radii.data());
    auto* const to = static_cast<std::int64_t*>(ids.data());
    std::int64_t count = 0;
    run([&] { return api().find_visible(sizes, r, &count, to, to + all, to + 2 * all, to + 3 * all); });
    return count;
}

/// The rows of two arrays [rows, numbers], of which one has ids.shape[0] rows, in bytes.
[[nodiscard]] std::int64_t row_bytes(const Array& from, const Array& to, const Array& ids) {
    check_array(ids, "ids", {static_cast<std::int64_t>(ids.size())}, true, 8);
    if (from.ndim() != 2 || to.ndim() != 2 || from.shape(1) != to.shape(1) || from.dtype() != to.dtype())
        throw nb::value_error("from and to are not arrays of rows of the same type and length");
    const bool integer = from.dtype().code == static_cast<std::uint8_t>(nb::dlpack::dtype_code::Int);
    for (const Array* array : {&from, &to})
        check_array(*array, "rows",
                    {static_cast<std::int64_t>(array->shape(0)), static_cast<std::int64_t>(array->shape(1))}, integer,
                    from.dtype().bits / 8);
    return static_cast<std::int64_t>(from.shape(1) * from.dtype().bits / 8);
}

/// `ids` are those of find_visible, so that each is the number of a row.
void gather_rows(const Array& from, const Array& ids, int threads, const Array& to) {
    const std::int64_t bytes = row_bytes(from, to, ids), count = static_cast<std::int64_t>(ids.size());
    if (to.shape(0) != ids.size()) throw nb::value_error("to has another number of rows than ids");
    const auto* const places = static_cast<const std::int64_t*>(ids.data());
    const void* const source = from.data();
    void* const target = to.data();
    run([&] { return api().gather_rows(threads, bytes, places, count, source, target); });
}
void scatter_rows(const Array& from, const Array& ids, int threads, const Array& to) {
    const std::int64_t bytes = row_bytes(from, to, ids), count = static_cast<std::int64_t>(ids.size());
    if (from.shape(0) != ids.size()) throw nb::value_error("from has another number of rows than ids");
    const auto* const places = static_cast<const std::int64_t*>(ids.data());
    const auto rows = static_cast<std::int64_t>(to.shape(0));
    const void* const source = from.data();
    void* const target = to.data();
    run([&] { return api().scatter_rows(threads, bytes, places, count, source, rows, target); });
}

/// Arrays of spherical harmonics; masks are bytes.
struct ShCall {
    ShSizes sizes;
    std::size_t bytes;
    const void *dirs, *coeffs;
    const std::uint8_t* masks = nullptr;

    ShCall(int degree, const Array& dir, const Array& coeff, const Optional& mask, int threads) {
        bytes = dir.dtype().bits / 8;
        if (dir.ndim() != 2 || coeff.ndim() != 3) throw nb::value_error("dirs is not [N, 3], or coeffs not [N, K, 3]");
        const auto n = static_cast<std::int64_t>(dir.shape(0)), rows = static_cast<std::int64_t>(coeff.shape(1));
        check_array(dir, "dirs", {n, 3}, false, bytes);
        check_array(coeff, "coeffs", {n, rows, 3}, false, bytes);
        if (degree < 0 || (degree + 1) * (degree + 1) > rows)
            throw nb::value_error("coeffs has too few rows for the degree");
        if (mask) {
            if (mask->ndim() != 1 || mask->shape(0) != dir.shape(0) || mask->dtype().bits != 8 ||
                (n > 1 && mask->stride(0) != 1))
                throw nb::value_error("masks is not an array [N] of bytes");
            masks = static_cast<const std::uint8_t*>(mask->data());
        }
        dirs = dir.data(), coeffs = coeff.data();
        sizes = {n, rows, degree, static_cast<int>(bytes), threads};
    }
};

void spherical_harmonics(int degree, const Array& dirs, const Array& coeffs, const Optional& masks, int threads,
                         const Array& colors) {
    const ShCall call(degree, dirs, coeffs, masks, threads);
    check_array(colors, "colors", {call.sizes.count, 3}, false, call.bytes);
    void* const out = colors.data();
    run([&] { return api().spherical_harmonics(call.sizes, call.dirs, call.coeffs, call.masks, out); });
}

void spherical_harmonics_backward(int degree, const Array& dirs, const Array& coeffs, const Optional& masks,
                                  int threads, const Array& dL_dcolors, const Optional& dL_ddirs,
                                  const Optional& dL_dcoeffs) {
    const ShCall call(degree, dirs, coeffs, masks, threads);
    check_array(dL_dcolors, "dL_dcolors", {call.sizes.count, 3}, false, call.bytes);
    if (dL_ddirs) check_array(*dL_ddirs, "dL_ddirs", {call.sizes.count, 3}, false, call.bytes);
    if (dL_dcoeffs) check_array(*dL_dcoeffs, "dL_dcoeffs", {call.sizes.count, call.sizes.rows, 3}, false, call.bytes);
    const void* const dL = dL_dcolors.data();
    void* const to_dirs = dL_ddirs ? dL_ddirs->data() : nullptr;
    void* const to_coeffs = dL_dcoeffs ? dL_dcoeffs->data() : nullptr;
    run([&] {
        return api().spherical_harmonics_backward(call.sizes, call.dirs, call.coeffs, call.masks, dL, to_dirs,
                                                  to_coeffs);
    });
}

/// The mean SSIM of images [planes, height, width]; writes its gradient with respect to a.
double ssim(const Array& a, const Array& b, bool whole_windows, int threads, const Optional& da) {
    if (a.ndim() != 3) throw nb::value_error("a is not [planes, height, width]");
    const std::size_t bytes = a.dtype().bits / 8;
    const Shape shape{static_cast<std::int64_t>(a.shape(0)), static_cast<std::int64_t>(a.shape(1)),
                      static_cast<std::int64_t>(a.shape(2))};
    check_array(a, "a", shape, false, bytes);
    check_array(b, "b", shape, false, bytes);
    if (da) check_array(*da, "da", shape, false, bytes);
    const SsimSizes sizes{static_cast<std::int64_t>(a.shape(0)), static_cast<int>(a.shape(1)),
                          static_cast<int>(a.shape(2)), whole_windows, static_cast<int>(bytes), threads};
    double value = 0;
    const void *const p = a.data(), *const q = b.data();
    void* const out = da ? da->data() : nullptr;
    run([&] { return api().ssim(sizes, p, q, &value, out); });
    return value;
}

constexpr const char *avatar_name = "gsh.opened_avatar", *posed_name = "gsh.posed_avatar";

/// The avatar, its numbers of Gaussians, joints, betas and expression coefficients, its filter, whether it is lit, and
/// its betas.
nb::tuple open_avatar(const std::string& path, int threads) {
    void* avatar = nullptr;
    AvatarSizes sizes{};
    run([&] { return api().open_avatar(path.c_str(), threads, &avatar, &sizes); });
    const nb::capsule capsule(avatar, avatar_name, [](void* p) noexcept { api().close_avatar(p); });
    std::vector<double> betas(static_cast<std::size_t>(sizes.betas));
    check(api().betas_of_avatar(avatar, betas.data()));
    nb::list list;
    for (const double beta : betas) list.append(beta);
    return nb::make_tuple(capsule, sizes.count, sizes.joints, sizes.betas, sizes.expression, sizes.dilation,
                          sizes.compensate != 0, sizes.lit != 0, list);
}

/// Arrays of an avatar's pose and splats; sizes: those of open_avatar.
nb::capsule pose_avatar(const nb::capsule& avatar, std::int64_t joints, std::int64_t coefficient_count,
                        std::int64_t count, const Array& pose, const Array& coefficients, const Array& transl,
                        const Array& center, const Array& means, const Array& covars, const Array& opacities,
                        const Array& colors) {
    check_array(pose, "pose", {joints, 3}, false, 4);
    check_array(coefficients, "coefficients", {coefficient_count}, false, 4);
    check_array(transl, "transl", {3}, false, 4);
    check_array(center, "center", {3}, false, 4);
    check_array(means, "means", {count, 3}, false, 4);
    check_array(covars, "covars", {count, 6}, false, 4);
    check_array(opacities, "opacities", {count}, false, 4);
    check_array(colors, "colors", {count, 3}, false, 4);
    const PoseArrays in{pose.data(), coefficients.data(), transl.data(), center.data()};
    const SplatOutputs out{means.data(), covars.data(), opacities.data(), colors.data()};
    void* const a = avatar.data(avatar_name);
    void* posed = nullptr;
    run([&] { return api().pose_avatar(a, in, out, &posed); });
    return nb::capsule(posed, posed_name, [](void* p) noexcept { api().release_posed(p); });
}

/// Adds to the gradients of the pose, which start at zero.
void pose_avatar_backward(const nb::capsule& posed, std::int64_t joints, std::int64_t coefficient_count,
                          std::int64_t count, const Array& dL_dmeans, const Array& dL_dcovars,
                          const Array& dL_dopacities, const Array& dL_dcolors, const Array& dL_dpose,
                          const Array& dL_dcoefficients, const Array& dL_dtransl, const Array& dL_dcenter) {
    check_array(dL_dmeans, "dL_dmeans", {count, 3}, false, 4);
    check_array(dL_dcovars, "dL_dcovars", {count, 6}, false, 4);
    check_array(dL_dopacities, "dL_dopacities", {count}, false, 4);
    check_array(dL_dcolors, "dL_dcolors", {count, 3}, false, 4);
    check_array(dL_dpose, "dL_dpose", {joints, 3}, false, 4);
    check_array(dL_dcoefficients, "dL_dcoefficients", {coefficient_count}, false, 4);
    check_array(dL_dtransl, "dL_dtransl", {3}, false, 4);
    check_array(dL_dcenter, "dL_dcenter", {3}, false, 4);
    const SplatInputs dL{dL_dmeans.data(), dL_dcovars.data(), dL_dopacities.data(), dL_dcolors.data()};
    const PoseGradients out{dL_dpose.data(), dL_dcoefficients.data(), dL_dtransl.data(), dL_dcenter.data()};
    void* const p = posed.data(posed_name);
    run([&] { return api().pose_avatar_backward(p, dL, out); });
}

} // namespace

NB_MODULE(_gsh, m) {
    if (api().refusal != nullptr) throw nb::import_error(api().refusal);
    m.attr("instruction_set") = api().instruction_set;
    add_posing_functions(m);
    // Arguments that are None need a name, so the lists below are spelled out.
    m.def("project", &project, nb::arg("means"), nb::arg("quats").none(), nb::arg("scales").none(),
          nb::arg("covars").none(), nb::arg("opacities").none(), nb::arg("viewmats"), nb::arg("Ks"), nb::arg("width"),
          nb::arg("height"), nb::arg("settings"), nb::arg("threads"), nb::arg("radii"), nb::arg("means2d"),
          nb::arg("depths"), nb::arg("conics"), nb::arg("compensations").none(), nb::arg("screen_opacities").none(),
          nb::arg("factors").none());
    m.def("project_backward", &project_backward, nb::arg("means"), nb::arg("quats").none(), nb::arg("scales").none(),
          nb::arg("covars").none(), nb::arg("opacities").none(), nb::arg("viewmats"), nb::arg("Ks"), nb::arg("width"),
          nb::arg("height"), nb::arg("settings"), nb::arg("threads"), nb::arg("radii"), nb::arg("dL_dmeans2d").none(),
          nb::arg("dL_ddepths").none(), nb::arg("dL_dconics").none(), nb::arg("dL_dcompensations").none(),
          nb::arg("dL_dscreen_opacities").none(), nb::arg("dL_dmeans").none(), nb::arg("dL_dquats").none(),
          nb::arg("dL_dscales").none(), nb::arg("dL_dcovars").none(), nb::arg("dL_dopacities").none(),
          nb::arg("dL_dviewmats").none(), nb::arg("dL_dKs").none());
    m.def("rasterize", &rasterize, nb::arg("means"), nb::arg("factors").none(), nb::arg("covars").none(),
          nb::arg("opacities"), nb::arg("viewmats"), nb::arg("Ks"), nb::arg("width"),
          nb::arg("height"), nb::arg("settings"), nb::arg("threads"), nb::arg("radii"), nb::arg("colors").none(),
          nb::arg("backgrounds").none(), nb::arg("with_depth"), nb::arg("render"), nb::arg("alphas"));
    m.def("rasterize_backward", &rasterize_backward, nb::arg("pass_"), nb::arg("means"), nb::arg("viewmats"),
          nb::arg("width"), nb::arg("height"), nb::arg("threads"), nb::arg("channels"), nb::arg("per_camera"),
          nb::arg("with_depth"), nb::arg("dL_drender").none(), nb::arg("dL_dalphas").none(),
          nb::arg("dL_dmeans2d").none(), nb::arg("dL_ddepths").none(), nb::arg("dL_dconics").none(),
          nb::arg("dL_dopacities").none(), nb::arg("dL_dcolors").none(), nb::arg("dL_dbackgrounds").none(),
          nb::arg("absolute_means2d").none());
    m.def("spherical_harmonics", &spherical_harmonics, nb::arg("degree"), nb::arg("dirs"), nb::arg("coeffs"),
          nb::arg("masks").none(), nb::arg("threads"), nb::arg("colors"));
    m.def("spherical_harmonics_backward", &spherical_harmonics_backward, nb::arg("degree"), nb::arg("dirs"),
          nb::arg("coeffs"), nb::arg("masks").none(), nb::arg("threads"), nb::arg("dL_dcolors"),
          nb::arg("dL_ddirs").none(), nb::arg("dL_dcoeffs").none());
    m.def("find_visible", &find_visible, nb::arg("radii"), nb::arg("ids"));
    m.def("gather_rows", &gather_rows, nb::arg("from_"), nb::arg("ids"), nb::arg("threads"), nb::arg("to"));
    m.def("scatter_rows", &scatter_rows, nb::arg("from_"), nb::arg("ids"), nb::arg("threads"), nb::arg("to"));
    m.def("ssim", &ssim, nb::arg("a"), nb::arg("b"), nb::arg("whole_windows"), nb::arg("threads"),
          nb::arg("da").none());
    m.def("open_avatar", &open_avatar, nb::arg("path"), nb::arg("threads"));
    m.def("pose_avatar", &pose_avatar);
    m.def("pose_avatar_backward", &pose_avatar_backward);
    m.def("release_memory", [] { api().release_memory(); });
}
