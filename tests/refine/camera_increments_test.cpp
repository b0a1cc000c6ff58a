// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/refine/camera_increments.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gsh {
namespace {

using B = cpu::Serial;

/// Tables of two cameras with random increments.
struct Scene {
    B backend;
    RefinementTables<B, double> tables{backend, {.frames = 1, .joints = 1, .cameras = 2}};
    CameraIncrements<B, double> cameras{backend, std::vector<Camera<double>>(2, camera()), {0.3, -0.2, 4.0}};

    static Camera<double> camera() {
        Camera<double> camera;
        camera.width = 40, camera.height = 30;
        camera.fx = 50, camera.fy = 52, camera.cx = 20.5, camera.cy = 14;
        camera.R = rotation_from_axis_angle(vec3<double>(0.1, 0.5, -0.2)), camera.t = {0.2, 0.1, 3};
        return camera;
    }

    Scene() {
        test::Rng rng(5);
        auto host = tables.host_increments();
        for (const RefinementGroup group : camera_groups)
            for (std::size_t c = 0; c < 2; ++c) {
                const auto numbers = rng.numbers(tables.width(group), -0.3, 0.3);
                std::copy(numbers.begin(), numbers.end(), host(group, c).begin());
            }
        tables.set_increments(host);
    }
};

/// A sum of all numbers of a camera and of its centre, with weights.
double value(const Camera<double>& camera, const CameraGradient<double>& weights, const vec3<double>& of_center) {
    double sum = dot(weights.dL_dt, camera.t) + dot(of_center, camera.center());
    for (int c = 0; c < 3; ++c) sum += dot(weights.dL_dR[c], camera.R[c]);
    return sum + weights.dL_dfx * camera.fx + weights.dL_dfy * camera.fy + weights.dL_dcx * camera.cx +
           weights.dL_dcy * camera.cy;
}

} // namespace

TEST_CASE("a camera is moved by its own increments, on the host and on the backend alike") {
    Scene scene;
    for (std::size_t c = 0; c < 2; ++c) {
        const Camera<double> host = scene.cameras.download(scene.tables, c);
        const CameraInput<double> input = scene.cameras.forward(scene.tables, c);
        const Camera<double> moved = input.camera();
        CHECK(moved.R == host.R);
        CHECK(moved.t == host.t);
        CHECK(moved.fx == host.fx);
        CHECK(moved.fy == host.fy);
        CHECK(moved.cx == host.cx);
        CHECK(moved.cy == host.cy);
        CHECK(input.center() == host.center());
        CHECK(moved.fx != Scene::camera().fx);
    }
    CHECK(scene.cameras.download(scene.tables, 0).t != scene.cameras.download(scene.tables, 1).t);
    CHECK(scene.cameras.size() == 2);
    CHECK(scene.cameras.initial(1).t == Scene::camera().t);
}

TEST_CASE("the gradient of a camera and of its centre reaches its row alone, as central differences say, and adds") {
    Scene scene;
    test::Rng rng(6);
    const CameraGradient<double> dL_dcamera{.dL_dR = {rng.vec(), rng.vec(), rng.vec()}, .dL_dt = rng.vec(),
                                            .dL_dfx = 0.02, .dL_dfy = -0.03, .dL_dcx = 0.4, .dL_dcy = 0.1};
    const vec3<double> dL_dcenter = rng.vec();
    const auto loss = [&] { return value(scene.cameras.download(scene.tables, 1), dL_dcamera, dL_dcenter); };
    const auto backward = [&] {
        scene.cameras.backward(scene.tables, 1, Span<const CameraGradient<double>>(&dL_dcamera, 1),
                               Span<const vec3<double>>(&dL_dcenter, 1));
    };
    backward();
    const Span<double> gradient = scene.tables.camera_gradient(1);
    const std::vector<double> once(gradient.begin(), gradient.end());
    const Span<double> row(scene.tables.increments(RefinementGroup::camera_rotation, 1).data(), once.size());
    test::check_gradient(loss, row, once);
    backward();
    for (std::size_t i = 0; i < once.size(); ++i) {
        CHECK(gradient[i] == doctest::Approx(2 * once[i]));
        CHECK(scene.tables.camera_gradient(0)[i] == 0);
    }
}

} // namespace gsh
