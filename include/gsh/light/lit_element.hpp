// SPDX-License-Identifier: Apache-2.0
/// @file  A point of a surface under a light, its irradiance and gloss, and the colour that a Gaussian takes from them.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/image/color.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>

namespace gsh {

/// v / √(|v|² + 10⁻⁸): a direction that goes to zero smoothly where v vanishes. For |v| above 1 it is v / |v| within
/// the rounding of float.
template <Lane T>
struct SoftDirection {
    T inverse_length;
    vec3<T> dir;

    GSH_INLINE GSH_HD explicit SoftDirection(const vec3<T>& v)
        : inverse_length(T(1) / sqrt(dot(v, v) + T(1e-8))), dir(v * inverse_length) {}

    /// Adds to dL_dv.
    GSH_HD void backward(const vec3<T>& dL_ddir, vec3<T>& dL_dv) const {
        dL_dv += (dL_ddir - dir * dot(dir, dL_ddir)) * inverse_length;
    }
};

/// A light as kernels read it. Exponentials are taken once per pass.
///
/// Shapes  points [P]; directions [D]; factors [P + D + 2]: the intensities, then strength and sharpness of the gloss.
template <class T>
struct LitLight {
    Span<const vec3<T>> points, directions;
    Span<const T> factors;
    bool glossy = false;

    /// P + D.
    [[nodiscard]] GSH_HD std::size_t size() const { return points.size() + directions.size(); }
    [[nodiscard]] GSH_HD T strength() const { return factors[size()]; }
    [[nodiscard]] GSH_HD T sharpness() const { return factors[size() + 1]; }
};

/// Sums that a light's gradient consists of, in memory of the caller.
///
/// Shapes  points [P]; log_intensities [P + D]; gloss [2].
template <class T>
struct LitLightSums {
    vec3<T>* points;
    T* log_intensities;
    T* gloss;
};

/// Irradiance and specular radiance, E and S: what light gives to a colour. x is E, y is S, so that both are
/// interpolated as one vector.
template <Lane T>
using LitShading = vec2<T>;

/// A point of a surface under a light:
///
///     n = soft(normal)
///     e_k = I_k V_k max(0, n·l) / r²                         a point, l = soft(p_k - x), r² = |p_k - x|² + 10⁻⁸
///     e_k = I_k V_k max(0, n·d_k)                            a direction
///     E = Σ_k e_k
///     S = strength Σ_points e_k F(h·v) exp(sharpness (n·h - 1)),   v = soft(center - x),  h = soft(v + l)
///
/// soft is SoftDirection. F(x) = 1 + (1/F₀ - 1) (1 - x)⁵ is Schlick's Fresnel term with F₀ = 0.04, divided by F₀, so
/// strength is the lobe's height where light and camera are on the normal.
///
/// Shapes  visibility(k), k in [0, P + D): V_k, the share of light k that reaches the point.
/// Frame   the world.
/// Errors  none, this is kernel code; a zero normal gives black, a light at the point's place finite numbers.
/// Source  half vectors as in Blinn, "Models of light reflection for computer synthesized pictures", 1977, with a
///         spherical Gaussian in place of his power of the cosine; Schlick, "An inexpensive BRDF model", 1994.
struct LitPoint {
    template <Lane T>
    struct Input {
        vec3<T> position;
        vec3<T> normal; ///< of any length
        vec3<T> center; ///< of the camera
    };
    template <Lane T>
    struct Gradient {
        vec3<T> position = vec3<T>(T(0)), normal = vec3<T>(T(0)), center = vec3<T>(T(0));
    };

    template <Lane T, class Visibility>
    [[nodiscard]] GSH_HD static LitShading<T> forward(const LitLight<ScalarOf<T>>& light, const Input<T>& in,
                                                      Visibility&& visibility) {
        const vec3<T> n = SoftDirection<T>(in.normal).dir;
        const SoftDirection<T> view(in.center - in.position);
        const std::size_t P = light.points.size();
        T irradiance(0), specular(0);
        for (std::size_t k = 0; k < P; ++k) {
            const Point<T> point(light, k, in.position, n, visibility(k));
            irradiance += point.irradiance;
            if (light.glossy) specular += point.irradiance * Lobe<T>(light, n, view.dir, point.to_light.dir).value;
        }
        for (std::size_t k = 0; k < light.directions.size(); ++k)
            irradiance += T(light.factors[P + k]) * visibility(P + k) *
                          max(dot(n, all<T>(light.directions[k])), T(0));
        if (light.glossy) specular = specular * T(light.strength());
        return LitShading<T>(irradiance, specular);
    }

    /// Adjoint of forward, whose result is `out`: adds to dL_din and, once to each number, to sums: a LitLightSums or
    /// something with the same members.
    template <Lane T, class Visibility, class Sums>
    GSH_HD static void backward(const LitLight<ScalarOf<T>>& light, const Input<T>& in, Visibility&& visibility,
                                const LitShading<T>& out, const LitShading<T>& dL_dout, Gradient<T>& dL_din,
                                const Sums& sums) {
        const SoftDirection<T> normal(in.normal), view(in.center - in.position);
        const vec3<T>& n = normal.dir;
        const std::size_t P = light.points.size();
        const T dL_dE = dL_dout.x;
        T dL_dlobes(0), dL_dlog_sharpness(0);
        vec3<T> dL_dn(T(0)), dL_dview(T(0)), dL_dposition(T(0));
        if (light.glossy) {
            dL_dlobes = dL_dout.y * T(light.strength());
            sums.gloss[0] += dL_dout.y * out.y;
        }
        for (std::size_t k = 0; k < P; ++k) {
            const Point<T> point(light, k, in.position, n, visibility(k));
            T dL_dirradiance = dL_dE;
            vec3<T> dL_dl(T(0));
            if (light.glossy) {
                const Lobe<T> lobe(light, n, view.dir, point.to_light.dir);
                dL_dirradiance += dL_dlobes * lobe.value;
                lobe.backward(light, n, view.dir, dL_dlobes * point.irradiance, dL_dn, dL_dview, dL_dl,
                              dL_dlog_sharpness);
            }
            vec3<T> dL_doffset(T(0));
            sums.log_intensities[k] += dL_dirradiance * point.irradiance;
            point.backward(n, dL_dirradiance, dL_dl, dL_dn, dL_doffset);
            sums.points[k] += dL_doffset;
            dL_dposition -= dL_doffset;
        }
        if (light.glossy) sums.gloss[1] += dL_dlog_sharpness;
        for (std::size_t k = 0; k < light.directions.size(); ++k) {
            const vec3<T> d = all<T>(light.directions[k]);
            const T cosine = dot(n, d), dL_dcosine = dL_dE * T(light.factors[P + k]) * visibility(P + k);
            const T lit = select(cosine > T(0), dL_dcosine, T(0));
            sums.log_intensities[P + k] += lit * cosine;
            dL_dn += d * lit;
        }
        vec3<T> dL_dto_camera(T(0));
        view.backward(dL_dview, dL_dto_camera);
        normal.backward(dL_dn, dL_din.normal);
        dL_din.center += dL_dto_camera;
        dL_din.position += dL_dposition - dL_dto_camera;
    }

private:
    /// The same vector in every lane.
    template <Lane T>
    [[nodiscard]] GSH_HD static vec3<T> all(const vec3<ScalarOf<T>>& v) {
        return {T(v.x), T(v.y), T(v.z)};
    }

    /// Irradiance from a point.
    template <Lane T>
    struct Point {
        SoftDirection<T> to_light;
        T cosine, at_facing, irradiance; // at_facing: where the cosine is 1

        GSH_INLINE GSH_HD Point(const LitLight<ScalarOf<T>>& light, std::size_t k, const vec3<T>& position,
                                const vec3<T>& n, T visibility)
            : to_light(all<T>(light.points[k]) - position), cosine(dot(n, to_light.dir)),
              at_facing(T(light.factors[k]) * visibility * (to_light.inverse_length * to_light.inverse_length)),
              irradiance(at_facing * max(cosine, T(0))) {}

        /// dL_dl is what else depends on the direction to the light. Adds to dL_dn and to dL_doffset, the gradient of
        /// the vector from the position to the light.
        GSH_HD void backward(const vec3<T>& n, T dL_dirradiance, const vec3<T>& dL_dl, vec3<T>& dL_dn,
                             vec3<T>& dL_doffset) const {
            const T dL_dcosine = select(cosine > T(0), dL_dirradiance * at_facing, T(0));
            dL_dn += to_light.dir * dL_dcosine;
            to_light.backward(dL_dl + n * dL_dcosine, dL_doffset);
            dL_doffset -= to_light.dir * (T(2) * dL_dirradiance * irradiance * to_light.inverse_length);
        }
    };

    /// The gloss of one point without its strength: F(h·v) exp(sharpness (n·h - 1)).
    template <Lane T>
    struct Lobe {
        SoftDirection<T> half;
        T below_peak, gauss, grazing, grazing4, value; // below_peak: n·h - 1; grazing: 1 - h·v, and its fourth power

        GSH_INLINE GSH_HD Lobe(const LitLight<ScalarOf<T>>& light, const vec3<T>& n, const vec3<T>& v,
                               const vec3<T>& l)
            : half(v + l), below_peak(dot(n, half.dir) - T(1)),
              gauss(exp_normal(max(T(light.sharpness()) * below_peak, T(-87)))), grazing(T(1) - dot(half.dir, v)),
              grazing4((grazing * grazing) * (grazing * grazing)),
              value((T(1) + T(fresnel) * (grazing4 * grazing)) * gauss) {}

        /// Adds to the gradients of n, v, l and of the logarithm of the sharpness.
        GSH_HD void backward(const LitLight<ScalarOf<T>>& light, const vec3<T>& n, const vec3<T>& v, T dL_dvalue,
                             vec3<T>& dL_dn, vec3<T>& dL_dv, vec3<T>& dL_dl, T& dL_dlog_sharpness) const {
            const T dL_dexponent = dL_dvalue * value, dL_dbelow_peak = dL_dexponent * T(light.sharpness());
            const T dL_dhv = T(-5 * fresnel) * grazing4 * gauss * dL_dvalue;
            dL_dlog_sharpness += dL_dbelow_peak * below_peak;
            dL_dn += half.dir * dL_dbelow_peak;
            vec3<T> dL_dsum(T(0));
            half.backward(n * dL_dbelow_peak + v * dL_dhv, dL_dsum);
            dL_dv += dL_dsum + half.dir * dL_dhv;
            dL_dl += dL_dsum;
        }

        static constexpr ScalarOf<T> fresnel = ScalarOf<T>(1 / 0.04 - 1);
    };
};

/// The colour of a Gaussian under a light. Its colour c without light is display-referred sRGB, as SkinnedGaussian
/// returns it:
///
///     colour = srgb(linear(c) E + S)
///
/// E = 1 and S = 0 return c. With `both`, lit colours end at 1.
struct LitColor {
    template <Lane T>
    [[nodiscard]] GSH_HD static vec3<T> forward(const vec3<T>& base, const LitShading<T>& shading,
                                                ColorClamp clamping) {
        const auto channel = [&](T c) {
            const T lit = linear_to_srgb(srgb_to_linear(c) * shading.x + shading.y);
            return clamping == ColorClamp::both ? min(lit, T(1)) : lit;
        };
        return {channel(base.x), channel(base.y), channel(base.z)};
    }

    /// Adds to dL_dbase and dL_dshading. A clamped channel passes only a gradient that darkens it.
    template <Lane T>
    GSH_HD static void backward(const vec3<T>& base, const LitShading<T>& shading, const vec3<T>& dL_dcolor,
                                ColorClamp clamping, vec3<T>& dL_dbase, LitShading<T>& dL_dshading) {
        const auto channel = [&](T c, T dL_dsrgb, T& dL_dc) {
            const T albedo = srgb_to_linear(c), linear = albedo * shading.x + shading.y;
            // A channel that is too bright must be able to become darker.
            if (clamping == ColorClamp::both) dL_dsrgb = select(linear > T(1), max(dL_dsrgb, T(0)), dL_dsrgb);
            T dL_dlinear(0);
            linear_to_srgb_backward(linear, dL_dsrgb, dL_dlinear);
            srgb_to_linear_backward(c, albedo, dL_dlinear * shading.x, dL_dc);
            dL_dshading.x += dL_dlinear * albedo;
            dL_dshading.y += dL_dlinear;
        };
        channel(base.x, dL_dcolor.x, dL_dbase.x);
        channel(base.y, dL_dcolor.y, dL_dbase.y);
        channel(base.z, dL_dcolor.z, dL_dbase.z);
    }
};

} // namespace gsh
