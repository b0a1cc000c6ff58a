// SPDX-License-Identifier: Apache-2.0
/// @file  What the extension module calls in libgsh-python for avatars: a table of functions over C types, as
///        interface.hpp is for splats of arrays.
#pragma once

#include "interface.hpp"

#include <cstdint>

namespace gsh_python {


struct AvatarHandle;
struct MotionHandle;
struct SplatsHandle;

/// An avatar's numbers. Arrays belong to the avatar.
struct AvatarInfo {
    std::int64_t gaussians, joints, betas, expressions; ///< N, J, S, E
    int sh_degree, lit;
    const float *means, *quats, *log_scales, *opacity_logits, *sh; // [N, 3], [N, 4], [N, 3], [N], [N, K, 3]
    const double* shape;                                           // [S]
    const double* rest_joints;                                     // [J, 3] in the canonical pose
    const std::int32_t* parents;                                   // [J], -1 for the root
};

/// A motion's numbers. Arrays belong to the motion.
struct MotionInfo {
    std::int64_t frames, joints, betas, expressions;               ///< T, J, S, E
    const double *pose, *transl, *expression, *shape, *timestamps; // [T, J, 3], [T, 3], [T, E], [S], [T]
};

/// One pose, as numbers. Null pointers stand for zeros, and for the avatar's own shape.
struct PoseNumbers {
    const double* pose; // [J, 3]
    std::int64_t joints;
    const double* transl; // [3]
    const double* expression;
    std::int64_t expressions;
    const double* shape;
    std::int64_t betas;
};

/// Posed Gaussians. Arrays belong to the splats, and keep their addresses.
struct SplatsInfo {
    std::int64_t gaussians;
    float *means, *covariances, *opacities, *colors; // [N, 3], [N, 6] xx xy xz yy yz zz, [N], [N, 3]
};

/// A camera: K and R by rows.
struct CameraNumbers {
    double K[9], R[9], t[3];
    int width, height;
};

/// Images to write, [height, width] and color [height, width, 3]; null pointers are skipped.
struct Images {
    float *color, *alpha, *expected_depth, *median_depth;
};

/// Texts of a call: each is passed to `add`.
struct Texts {
    void* list;
    void (*add)(void* list, const char* text);
};

struct PosingApi {
    int (*load_avatar)(const char* path, int threads, AvatarHandle** avatar);
    void (*release_avatar)(AvatarHandle* avatar);
    AvatarInfo (*avatar_info)(const AvatarHandle& avatar);
    void (*joint_names)(const AvatarHandle& avatar, const Texts& names);

    int (*load_motion)(const AvatarHandle& avatar, const char* path, int upright, double input_fps,
                       const char* animation, const Texts& warnings, MotionHandle** motion);
    void (*release_motion)(MotionHandle* motion);
    MotionInfo (*motion_info)(const MotionHandle& motion);

    /// Splats keep what they need of the avatar.
    int (*make_splats)(const AvatarHandle& avatar, SplatsHandle** splats);
    void (*release_splats)(SplatsHandle* splats);
    SplatsInfo (*splats_info)(SplatsHandle& splats);
    /// Poses the avatar that made the splats, by a frame of a motion, or if that is null, by numbers. `center` [3] is
    /// where the splats are seen from, or a camera is given.
    int (*pose)(SplatsHandle& splats, const MotionHandle* motion, std::int64_t frame, const PoseNumbers& numbers,
                const CameraNumbers* camera, const double* center);

    /// Renders splats of one or more avatars in one picture.
    int (*render)(SplatsHandle* const* splats, std::int64_t count, const CameraNumbers& camera,
                  const float* background, const Images& images);

    int (*read_camera)(const char* path, const char* name, CameraNumbers* camera);
    int (*check_camera)(const CameraNumbers& camera);
    int (*look_at)(const double* eye, const double* target, const double* up, double vertical_fov,
                   CameraNumbers* camera); ///< width and height are read
};

} // namespace gsh_python

extern "C" const gsh_python::PosingApi* gsh_python_posing_api();
