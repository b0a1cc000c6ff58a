// SPDX-License-Identifier: Apache-2.0
/// @file  The camera of a step: known to the host, or computed on the backend with its centre.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/math/vec.hpp>

namespace gsh {

/// A camera and its centre, for the components that take one or the other. The image size of `camera.known` holds in
/// any case.
template <class T>
struct CameraInput {
    Deferred<Camera<T>> camera;
    Deferred<vec3<T>> center; ///< in the world

    CameraInput(const Camera<T>& known) : camera(known), center(known.center()) {}
    CameraInput(const Deferred<Camera<T>>& camera_, const Deferred<vec3<T>>& center_)
        : camera(camera_), center(center_) {}
};

} // namespace gsh
