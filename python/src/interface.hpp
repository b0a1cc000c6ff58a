// SPDX-License-Identifier: Apache-2.0
/// @file  What the extension module calls in libgsh-python: a table of functions over C types.
///
/// The module and the library are compiled for different instruction sets. They share no class and no template: memory
/// belongs to whoever made it, and no exception crosses the border.
#pragma once

#include <cstdint>

namespace gsh_python {

/// A function that can fail returns one of these.
enum Status : int {
    done = 0,
    bad_value = 1, ///< an argument is wrong
    failed = 2,    ///< anything else
    out_of_memory = 3,
    file_failed = 4, ///< a file is missing, damaged or of another kind
};

/// Sizes of a call. Arrays are contiguous, of float (scalar_bytes 4) or double (8); null pointers are skipped.
struct Sizes {
    std::int64_t batches, cameras, count; ///< B, C, N
    int scalar_bytes, threads;
};

struct SplatArrays {
    const void *means;          // [B, N, 3]
    const void *quats, *scales; // [B, N, 4], [B, N, 3]; both null with covars
    const void *covars;         // [B, N, 6] xx xy xz yy yz zz
    const void *opacities;      // [B, N]
    const void *factors;        // [B, N, 3, 3] for rasterize: those of project; null with covars
};
struct SplatGradients {
    void *means, *quats, *scales, *covars, *opacities;
};

struct CameraArrays {
    const void *viewmats; // [B, C, 4, 4] camera from world
    const void *Ks;       // [B, C, 3, 3]
    int width, height;
};
struct CameraGradients {
    void *viewmats, *Ks;
};

struct ProjectionSettings {
    double eps2d, near_plane, far_plane, radius_clip;
    int compensate; ///< rasterize_mode "antialiased"
    double compensation_floor, alpha_max, transmittance_min; ///< as in gsh::RasterParams
};

struct ProjectedArrays {
    std::int32_t *radii;  // [B, C, N, 2]; 0 for a splat that is culled, as are its other numbers
    void *means2d;        // [B, C, N, 2]
    void *depths;         // [B, C, N]
    void *conics;         // [B, C, N, 3]
    void *compensations;  // [B, C, N]
    void *opacities;      // [B, C, N] times the compensations
    void *factors;        // [B, N, 3, 3] rotation times scales, by columns; null with covars
};
struct ProjectedGradients {
    const void *means2d, *depths, *conics, *compensations, *opacities;
};

struct ColorArrays {
    const void *colors;      // [B, N, D], or [B, C, N, D] if per_camera
    const void *backgrounds; // [B, C, D]
    int channels;            ///< D; 0 for depth alone
    int per_camera;
};

/// Image gradients; strides in numbers, of images, rows, columns and channels.
struct ImageGradients {
    const void *render; // [B * C, height, width, D + with_depth]
    std::int64_t render_strides[4];
    const void *alphas; // [B * C, height, width]
    std::int64_t alpha_strides[3];
};
/// Gradients that rasterize_backward writes.
struct ScreenGradients {
    void *means2d, *depths, *conics, *opacities; // as in ProjectedArrays; opacities [B, C, N] after compensation
    void *colors, *backgrounds;                  // as in ColorArrays
    void *absolute_means2d;                      // [B, C, N, 2]
};

/// Sizes of a call for spherical harmonics: dirs [count, 3], coeffs [count, rows, 3] of which those up to the degree
/// count, masks [count] or null, colours [count, 3].
struct ShSizes {
    std::int64_t count, rows;
    int degree, scalar_bytes, threads;
};

/// Sizes of a comparison of images [planes, height, width].
struct SsimSizes {
    std::int64_t planes;
    int height, width, whole_windows, scalar_bytes, threads;
};

struct AvatarSizes {
    std::int64_t count, joints, betas, expression;
    double dilation; ///< of the avatar's filter, as is `compensate`
    int compensate;
    int lit; ///< whether a light shades it
};
/// Arrays of float.
struct PoseArrays {
    const void *pose;         // [J, 3] axis-angle
    const void *coefficients; // [S + E] betas, expression
    const void *transl;       // [3]
    const void *center;       // [3] of the camera, for colours that depend on the view
};
struct PoseGradients {
    void *pose, *coefficients, *transl, *center;
};
struct SplatOutputs {
    void *means, *covars, *opacities, *colors; // [N, 3], [N, 6], [N], [N, 3]
};
struct SplatInputs {
    const void *means, *covars, *opacities, *colors;
};

struct Api {
    const char* refusal; ///< why the library cannot run here, or null: then the functions are set
    const char* instruction_set;
    const char* (*last_error)(); ///< of the calling thread's last call that failed

    int (*project)(const Sizes&, const SplatArrays&, const CameraArrays&, const ProjectionSettings&,
                   const ProjectedArrays&);
    /// Writes the gradients. `radii`: those of project.
    int (*project_backward)(const Sizes&, const SplatArrays&, const CameraArrays&, const ProjectionSettings&,
                            const std::int32_t* radii, const ProjectedGradients&, const SplatGradients&,
                            const CameraGradients&);
    /// render [B, C, height, width, D + with_depth], alphas [B, C, height, width]; *pass is for rasterize_backward, and
    /// then for release.
    int (*rasterize)(const Sizes&, const SplatArrays&, const CameraArrays&, const ProjectionSettings&,
                     const std::int32_t* radii, const ColorArrays&, int with_depth, void* render, void* alphas,
                     void** pass);
    int (*rasterize_backward)(void* pass, int threads, const ImageGradients&, const ScreenGradients&);
    void (*release)(void* pass);
    int (*spherical_harmonics)(const ShSizes&, const void* dirs, const void* coeffs, const std::uint8_t* masks,
                               void* colors);
    /// Adds to the gradients; either may be null.
    int (*spherical_harmonics_backward)(const ShSizes&, const void* dirs, const void* coeffs, const std::uint8_t* masks,
                                        const void* dL_dcolors, void* dL_ddirs, void* dL_dcoeffs);
    /// The Gaussians with radii above 0, in the order of [B * C * N]: their number is written to *count, their places
    /// to ids and, in parts, to the others, which all have room for [B * C * N].
    int (*find_visible)(const Sizes&, const std::int32_t* radii, std::int64_t* count, std::int64_t* ids,
                        std::int64_t* batch_ids, std::int64_t* camera_ids, std::int64_t* gaussian_ids);
    /// to[k] = from[ids[k]] for rows of whole floats.
    int (*gather_rows)(int threads, std::int64_t row_bytes, const std::int64_t* ids, std::int64_t count,
                       const void* from, void* to);
    /// to[ids[k]] = from[k], and zeros elsewhere; ids ascend.
    int (*scatter_rows)(int threads, std::int64_t row_bytes, const std::int64_t* ids, std::int64_t count,
                        const void* from, std::int64_t rows, void* to);
    /// The mean SSIM of a and b, and its gradient with respect to a, unless da is null.
    int (*ssim)(const SsimSizes&, const void* a, const void* b, double* value, void* da);
    int (*open_avatar)(const char* path, int threads, void** avatar, AvatarSizes*);
    int (*betas_of_avatar)(void* avatar, double* betas);
    /// *pass is for pose_avatar_backward, and then for release_posed; it keeps the avatar alive.
    int (*pose_avatar)(void* avatar, const PoseArrays&, const SplatOutputs&, void** pass);
    /// Adds to the gradients. All of dL are given.
    int (*pose_avatar_backward)(void* pass, const SplatInputs& dL, const PoseGradients&);
    void (*release_posed)(void* pass);
    void (*close_avatar)(void* avatar);
    void (*release_memory)(); ///< frees what released passes hold for the next ones
};

} // namespace gsh_python

extern "C" const gsh_python::Api* gsh_python_api();
