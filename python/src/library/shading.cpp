// SPDX-License-Identifier: Apache-2.0
/// @file  Spherical harmonics of arrays of directions, which are normalised here, and their adjoint.

#include "library/shading.hpp"

#include "library/arrays.hpp"
#include "library/errors.hpp"

#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <string>

namespace gsh_python {

namespace {

using namespace gsh;
constexpr std::size_t grain = 2048;

/// 1 / |v|, with gsplat's torch reference's lower limit of the length.
template <class T>
[[nodiscard]] T inverse_length(const vec3<T>& v) {
    return T(1) / max(sqrt(dot(v, v)), T(1e-12));
}

template <int Degree, class T>
void evaluate(const ShSizes& sizes, const vec3<T>* dirs, const vec3<T>* coeffs, const std::uint8_t* masks,
              vec3<T>* colors) {
    const auto rows = static_cast<std::size_t>(sizes.rows);
    threads(sizes.threads).for_chunks(static_cast<std::size_t>(sizes.count), grain,
                                      [=](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            if (masks != nullptr && masks[i] == 0) {
                colors[i] = vec3<T>(T(0));
                continue;
            }
            colors[i] = SHEval<Degree>::forward(coeffs + i * rows, dirs[i] * inverse_length(dirs[i]));
        }
    });
}

template <int Degree, class T>
void evaluate_backward(const ShSizes& sizes, const vec3<T>* dirs, const vec3<T>* coeffs, const std::uint8_t* masks,
                       const vec3<T>* dL_dcolors, vec3<T>* dL_ddirs, vec3<T>* dL_dcoeffs) {
    const auto rows = static_cast<std::size_t>(sizes.rows);
    threads(sizes.threads).for_chunks(static_cast<std::size_t>(sizes.count), grain,
                                      [=](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            if (masks != nullptr && masks[i] == 0) continue;
            const T inverse = inverse_length(dirs[i]);
            const vec3<T> unit = dirs[i] * inverse;
            vec3<T> unused[sh_basis_count(Degree)], dL_dunit(T(0));
            SHEval<Degree>::backward(coeffs + i * rows, unit, dL_dcolors[i],
                                     dL_dcoeffs != nullptr ? dL_dcoeffs + i * rows : unused, dL_dunit);
            if (dL_ddirs != nullptr) dL_ddirs[i] += (dL_dunit - unit * dot(unit, dL_dunit)) * inverse;
        }
    });
}

/// Calls work.template operator()<Degree, T>() for the sizes' degree and number type.
template <class Work>
void with_types(const ShSizes& sizes, const Work& work) {
    const auto with_degree = [&]<class T>() {
        switch (sizes.degree) {
        case 0: return work.template operator()<0, T>();
        case 1: return work.template operator()<1, T>();
        case 2: return work.template operator()<2, T>();
        case 3: return work.template operator()<3, T>();
        case 4: return work.template operator()<4, T>();
        default:
            throw ValueError("degrees_to_use is " + std::to_string(sizes.degree) + ", expected 0 to 4");
        }
    };
    if (sizes.scalar_bytes == 4) with_degree.template operator()<float>();
    else with_degree.template operator()<double>();
}

} // namespace

int spherical_harmonics(const ShSizes& sizes, const void* dirs, const void* coeffs, const std::uint8_t* masks,
                        void* colors) {
    return guarded([&] {
        with_types(sizes, [&]<int Degree, class T>() {
            evaluate<Degree>(sizes, static_cast<const vec3<T>*>(dirs), static_cast<const vec3<T>*>(coeffs), masks,
                             static_cast<vec3<T>*>(colors));
        });
    });
}

int spherical_harmonics_backward(const ShSizes& sizes, const void* dirs, const void* coeffs,
                                 const std::uint8_t* masks, const void* dL_dcolors, void* dL_ddirs, void* dL_dcoeffs) {
    return guarded([&] {
        with_types(sizes, [&]<int Degree, class T>() {
            evaluate_backward<Degree>(sizes, static_cast<const vec3<T>*>(dirs), static_cast<const vec3<T>*>(coeffs),
                                      masks, static_cast<const vec3<T>*>(dL_dcolors), static_cast<vec3<T>*>(dL_ddirs),
                                      static_cast<vec3<T>*>(dL_dcoeffs));
        });
    });
}

} // namespace gsh_python
