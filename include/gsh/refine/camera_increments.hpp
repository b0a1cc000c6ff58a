// SPDX-License-Identifier: Apache-2.0
/// @file  Cameras that are moved by their increments: on the host, or on the backend without a wait; with adjoint.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/camera_increment.hpp>
#include <gsh/camera/camera_input.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/refine/refinement_params.hpp>
#include <gsh/refine/refinement_tables.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// Groups with a row for each camera.
inline constexpr std::array camera_groups{RefinementGroup::camera_rotation, RefinementGroup::camera_translation,
                                          RefinementGroup::camera_focal, RefinementGroup::camera_principal_point};

/// camera = moved_camera(initial, pivot, w[camera]), where w has the camera's row of all four groups.
///
/// Frame   pivot, in the world: the centre of the cameras' turns.
template <Backend B, std::floating_point T>
class CameraIncrements {
public:
    CameraIncrements(B& backend, std::vector<Camera<double>> cameras, const vec3<double>& pivot)
        : backend_(&backend), cameras_(std::move(cameras)), pivot_(pivot) {}

    [[nodiscard]] std::size_t size() const { return cameras_.size(); }
    /// A camera before any step.
    [[nodiscard]] const Camera<double>& initial(std::size_t camera) const { return cameras_[camera]; }

    /// A present camera, for the host. Its nine numbers are downloaded.
    template <std::floating_point U = T>
    [[nodiscard]] Camera<U> download(const RefinementTables<B, T>& tables, std::size_t camera) const {
        std::array<T, RefinementTables<B, T>::camera_width> host{};
        backend_->download(tables.camera_increments(camera), Span<T>(host));
        const CameraIncrement<U> increment{{U(host[0]), U(host[1]), U(host[2])},
                                           {U(host[3]), U(host[4]), U(host[5])},
                                           U(host[6]),
                                           {U(host[7]), U(host[8])}};
        return moved_camera(cameras_[camera].template cast<U>(), vec3<U>(pivot_), increment);
    }

    /// The same for work on the backend. The result is valid until the next call or step.
    [[nodiscard]] CameraInput<T> forward(const RefinementTables<B, T>& tables, std::size_t camera) {
        const Camera<T> initial = cameras_[camera].template cast<T>();
        moved_.resize(1), center_.resize(1);
        backend_->for_each(
            1, detail::MovedCamera<T>{initial, vec3<T>(pivot_), row_of(tables, camera), moved_, center_});
        return {{initial, moved_}, {vec3<T>(T(0)), center_}};
    }

    /// Adds to the gradient of the camera's row. dL_dcamera and dL_dcenter have one element each; dL_dcenter may be
    /// empty.
    void backward(RefinementTables<B, T>& tables, std::size_t camera, Span<const CameraGradient<T>> dL_dcamera,
                  Span<const vec3<T>> dL_dcenter) {
        backend_->for_each(1, detail::MovedCameraBackward<T>{
                                  cameras_[camera].template cast<T>(), vec3<T>(pivot_), row_of(tables, camera),
                                  dL_dcamera, dL_dcenter, view_as<CameraIncrement<T>>(tables.camera_gradient(camera))});
    }

private:
    [[nodiscard]] static Span<const CameraIncrement<T>> row_of(const RefinementTables<B, T>& tables,
                                                               std::size_t camera) {
        return view_as<const CameraIncrement<T>>(tables.camera_increments(camera));
    }

    B* backend_;
    std::vector<Camera<double>> cameras_;
    vec3<double> pivot_;
    typename B::template Buffer<Camera<T>> moved_;  // [1]
    typename B::template Buffer<vec3<T>> center_;   // [1]
};

} // namespace gsh
