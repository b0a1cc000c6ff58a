// SPDX-License-Identifier: Apache-2.0
/// @file  Ray casting against one triangle mesh with Embree; the only header that includes Embree.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <embree3/rtcore.h>

#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>

namespace gsh {

/// A ray's intersection with a mesh: the point is (1 - u - v) a + u b + v c of the triangle.
struct RayHit {
    bool found = false;
    unsigned face = 0;
    float u = 0, v = 0, distance = 0;
};

/// A mesh for ray queries from many threads at once.
///
/// It is built on one thread, so that the hierarchy is deterministic, and with it the result where two triangles tie.
class RayScene {
public:
    /// Copies vertices [V] and faces [F]; indices must be below V.
    ///
    /// Errors  DeviceError if Embree fails to create a scene.
    RayScene(Span<const vec3<float>> vertices, Span<const std::array<int, 3>> faces)
        : device_(rtcNewDevice("threads=1")), scene_(device_ ? rtcNewScene(device_.get()) : nullptr) {
        if (!device_ || !scene_) throw DeviceError("RayScene: Embree made no device; " + error());
        rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST); // watertight between neighbouring triangles
        rtcSetSceneBuildQuality(scene_.get(), RTC_BUILD_QUALITY_MEDIUM);
        const std::unique_ptr<std::remove_pointer_t<RTCGeometry>, Release> geometry(
            rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
        auto* points = static_cast<float*>(rtcSetNewGeometryBuffer(
            geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), vertices.size()));
        auto* corners = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
            geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), faces.size()));
        if (!points || !corners) throw DeviceError("RayScene: Embree gave no memory; " + error());
        for (const auto& p : vertices)
            for (int axis = 0; axis < 3; ++axis) *points++ = p[axis];
        for (const auto& face : faces)
            for (const int v : face) *corners++ = static_cast<unsigned>(v);
        rtcCommitGeometry(geometry.get());
        rtcAttachGeometry(scene_.get(), geometry.get());
        rtcCommitScene(scene_.get());
        if (rtcGetDeviceError(device_.get()) != RTC_ERROR_NONE)
            throw DeviceError("RayScene: Embree built no hierarchy");
    }

    /// The nearest hit beyond `near`. `direction` need not be a unit vector; distances are in multiples of its length.
    [[nodiscard]] RayHit closest(const vec3<float>& origin, const vec3<float>& direction, float near = 0) const {
        RTCRayHit query{};
        query.ray = ray(origin, direction, near, std::numeric_limits<float>::infinity());
        query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        rtcIntersect1(scene_.get(), &context, &query);
        if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
        return {true, query.hit.primID, query.hit.u, query.hit.v, query.ray.tfar};
    }

    /// Whether the ray hits anything between `near` and `far`.
    [[nodiscard]] bool occluded(const vec3<float>& origin, const vec3<float>& direction, float near, float far) const {
        RTCRay query = ray(origin, direction, near, far);
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        rtcOccluded1(scene_.get(), &context, &query);
        return query.tfar < 0; // Embree sets tfar to -inf on a hit
    }

private:
    struct Release {
        void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
        void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
        void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
    };

    static RTCRay ray(const vec3<float>& o, const vec3<float>& d, float near, float far) {
        return {o.x, o.y, o.z, near, d.x, d.y, d.z, 0, far, 0xFFFFFFFFu, 0, 0};
    }
    static std::string error() { return "code " + std::to_string(static_cast<int>(rtcGetDeviceError(nullptr))); }

    std::unique_ptr<std::remove_pointer_t<RTCDevice>, Release> device_;
    std::unique_ptr<std::remove_pointer_t<RTCScene>, Release> scene_;
};

} // namespace gsh
