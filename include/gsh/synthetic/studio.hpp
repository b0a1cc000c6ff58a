// SPDX-License-Identifier: Apache-2.0
/// @file  Renders captures of moving bodies from a ring of cameras by ray casting, independently of the rasterizer.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/image/color.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/synthetic/lit_mesh.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

namespace gsh {

struct StudioParams {
    int train_cameras = 6;  ///< evenly around the subject
    int test_cameras = 1;   ///< the k-th between training cameras k and k + 1
    int image_size = 320;   ///< pixels, square
    int samples = 25;       ///< camera rays per pixel, each with one ray to the lamp and one to the sky
    double distance = 3.0;  ///< metres from the subject's centre
    std::uint64_t seed = 1; ///< of camera placement and of samples
    StudioLight light;
    std::vector<NamedCamera> cameras = {}; ///< used instead of the ring, e.g. for the views of another capture
    std::function<void(double share)> progress = {}; ///< is called after each frame, on the caller's thread
};

/// Cameras that each see all of `points`. Focal lengths, principal points and heights vary from one to the next. Test
/// cameras lie half-way between training cameras. Names are cam00…, test00…
[[nodiscard]] inline std::vector<NamedCamera> camera_ring(Span<const vec3<double>> points, const StudioParams& params);

/// Films a body in motion. The capture holds the true motion; alpha is the fraction of rays that hit the body, and
/// colour is 0 where alpha is 0. The images are the same for any executor and thread count.
///
/// color(p) is the SurfaceColor at canonical position p of v_template.
///
/// Errors  ValueError for parameters out of range, ShapeError if the motion is not for this body.
template <HostExecutor E, class Color>
[[nodiscard]] Capture film(E& executor, const BodyModel& body, const Motion& motion, const StudioParams& params,
                           const Color& color);

/// Films the actor in its own colours.
template <HostExecutor E>
[[nodiscard]] Capture film(E& executor, const BodyModel& actor, const Motion& motion, const StudioParams& params = {}) {
    return film(executor, actor, motion, params, actor_color);
}

/// A person to be filmed. The caller owns body and motion.
struct StudioActor {
    const BodyModel* body = nullptr;
    const Motion* motion = nullptr;
    std::function<SurfaceColor(const vec3<double>&)> color = [](const vec3<double>& p) { return actor_color(p); };
};

/// Films several people at once, who occlude each other and cast shadows on each other. The capture's motion is that of
/// the first person; its alpha covers all people.
///
/// Errors  those of film; ShapeError unless all motions have the same number of frames.
template <HostExecutor E>
[[nodiscard]] Capture film(E& executor, const std::vector<StudioActor>& actors, const StudioParams& params = {});

// -------------------------------------------------------------------------------------------------------------

inline std::vector<NamedCamera> camera_ring(Span<const vec3<double>> points, const StudioParams& params) {
    check_value(!points.empty(), "camera_ring", "there is no point to look at");
    vec3<double> low = points[0], high = points[0];
    for (const auto& p : points) low = glm::min(low, p), high = glm::max(high, p);
    const vec3<double> middle = (low + high) * 0.5;

    std::vector<NamedCamera> list;
    const auto add = [&](NamedCamera::Role role, int index, double place) {
        const std::uint64_t key =
            mix_bits(params.seed) + 1000 * static_cast<std::uint64_t>(role == NamedCamera::Role::test);
        const auto vary = [&](int what) {
            return 2 * random_uniform(key, static_cast<std::uint64_t>(4 * index + what)) - 1;
        };
        const double angle = 2 * std::numbers::pi * (place + 0.25) / params.train_cameras, size = params.image_size;
        const vec3<double> eye =
            middle +
            vec3<double>(std::sin(angle), 0.16 + 0.09 * std::sin(2.4 * place), std::cos(angle)) * params.distance;
        const vec3<double> forward = normalize(middle - eye), right = normalize(cross(forward, vec3<double>(0, 1, 0)));
        Camera<double> camera;
        camera.R = transpose(mat3<double>(right, cross(forward, right), forward));
        camera.t = -(camera.R * eye);
        camera.width = camera.height = params.image_size;
        camera.cx = size * (0.5 + 0.02 * vary(0));
        camera.cy = size * (0.5 + 0.02 * vary(1));
        double widest = 0; // half image widths at unit focal length
        for (const auto& p : points) {
            const vec3<double> c = to_camera(camera, p);
            check_value(c.z > 0.1, "camera_ring", "the subject reaches the cameras; increase the distance");
            widest = std::max({widest, std::abs(c.x / c.z), std::abs(c.y / c.z)});
        }
        camera.fx = camera.fy = 0.46 * size / widest * (0.94 + 0.06 * vary(2));
        char name[16];
        std::snprintf(name, sizeof name, role == NamedCamera::Role::train ? "cam%02d" : "test%02d", index);
        list.push_back({name, role, camera, {}});
    };
    for (int k = 0; k < params.train_cameras; ++k) add(NamedCamera::Role::train, k, k);
    for (int k = 0; k < params.test_cameras; ++k) add(NamedCamera::Role::test, k, k + 0.5);
    return list;
}

namespace detail {

/// One pixel: stratified rays, averaged in linear light and stored as sRGB.
template <class Color>
void film_pixel(const LitMesh& mesh, const Camera<float>& camera, const vec3<float>& eye, int x, int y,
                std::uint64_t key, int samples, const Color& color, std::uint8_t* rgba) {
    const int side = std::max(1, static_cast<int>(std::lround(std::sqrt(samples))));
    vec3<float> sum(0.0f);
    int found = 0;
    for (int k = 0; k < samples; ++k) {
        const auto draw = [&](int axis) {
            return static_cast<float>(random_uniform(key, static_cast<std::uint64_t>(2 * k + axis)));
        };
        const bool in_grid = k < side * side; // the remaining samples are placed at random
        const float u = in_grid ? (static_cast<float>(k % side) + draw(0)) / static_cast<float>(side) : draw(0);
        const float v = in_grid ? (static_cast<float>(k / side) + draw(1)) / static_cast<float>(side) : draw(1);
        const vec3<float> d((static_cast<float>(x) + u - camera.cx) / camera.fx,
                            (static_cast<float>(y) + v - camera.cy) / camera.fy, 1);
        const LitMesh::Sight sight =
            mesh.look(eye, transposed_times(camera.R, d), color, key, static_cast<std::uint64_t>(k));
        found += sight.found;
        sum += sight.radiance;
    }
    const auto byte = [](float value) {
        return static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
    };
    const std::uint8_t alpha = byte(static_cast<float>(found) / static_cast<float>(samples));
    for (int c = 0; c < 3; ++c)
        rgba[c] = alpha ? byte(linear_to_srgb(sum[c] / static_cast<float>(found))) : std::uint8_t(0);
    rgba[3] = alpha;
}

/// The pixels in which the vertices project, and one more on each side; rays outside are skipped.
inline PixelBox box_of_vertices(Span<const vec3<double>> vertices, const Camera<double>& camera) {
    double x0 = camera.width, x1 = 0, y0 = camera.height, y1 = 0;
    for (const auto& p : vertices) {
        const vec2<double> pixel = to_pixel(camera, to_camera(camera, p));
        x0 = std::min(x0, std::floor(pixel.x) - 1), x1 = std::max(x1, std::ceil(pixel.x) + 1);
        y0 = std::min(y0, std::floor(pixel.y) - 1), y1 = std::max(y1, std::ceil(pixel.y) + 1);
    }
    const auto within = [](double at, int size) { return static_cast<int>(std::clamp(at, 0.0, double(size))); };
    const int left = within(x0, camera.width), top = within(y0, camera.height);
    return {left, top, std::max(0, within(x1, camera.width) - left), std::max(0, within(y1, camera.height) - top)};
}

} // namespace detail

namespace detail {

/// Films people whose meshes are combined into one; color(p, face) is the colour of canonical position p on that face.
template <HostExecutor E, class Color>
Capture film_people(E& executor, const std::vector<StudioActor>& actors, const StudioParams& params,
                    const Color& color) {
    check_value(!actors.empty(), "film", "there is nobody to film");
    const Motion& motion = *actors.front().motion;
    check_value(params.train_cameras > 0 && params.test_cameras >= 0, "film", "there must be a training camera");
    check_value(params.test_cameras <= params.train_cameras, "film",
                "there must not be more test than training cameras");
    check_value(params.image_size > 0 && params.samples > 0 && params.distance > 0, "film",
                "image_size, samples and distance must be positive");
    check_value(motion.frame_count() > 0, "film", "the motion has no frame");

    const std::size_t frames = motion.frame_count();
    std::vector<vec3<double>> canonical;
    std::vector<std::array<int, 3>> faces;
    for (const StudioActor& actor : actors) {
        check_size("film", "a motion's frames", actor.motion->frame_count(), frames, "all people are filmed at once");
        const int first = static_cast<int>(canonical.size());
        for (const auto& f : actor.body->faces) faces.push_back({f[0] + first, f[1] + first, f[2] + first});
        canonical.insert(canonical.end(), actor.body->v_template.begin(), actor.body->v_template.end());
    }
    std::vector<std::vector<vec3<double>>> posed(frames);
    executor.for_chunks(frames, 1, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t t = begin; t < end; ++t)
            for (const auto& [body, own, unused] : actors) {
                const auto vertices =
                    pose_body(*body, own->pose_at(t), own->transl[t], own->betas, own->expression_at(t)).vertices;
                posed[t].insert(posed[t].end(), vertices.begin(), vertices.end());
            }
    });
    std::vector<vec3<double>> everywhere;
    for (const auto& vertices : posed) everywhere.insert(everywhere.end(), vertices.begin(), vertices.end());

    Capture result;
    result.name = "studio";
    result.motion = motion;
    result.cameras = params.cameras.empty() ? camera_ring(everywhere, params) : params.cameras;
    for (const NamedCamera& named : result.cameras)
        check_value(named.camera.width == params.image_size && named.camera.height == params.image_size, "film",
                    "camera '" + named.name + "' must have square images of image_size pixels");
    result.fps =
        frames > 1 ? static_cast<double>(frames - 1) / (motion.timestamps.back() - motion.timestamps.front()) : 0;
    result.floor_y = ActorOutfit::sole_y;
    const std::size_t cameras = result.cameras.size(), size = static_cast<std::size_t>(params.image_size);
    result.images.assign(cameras * frames, PixelImage(4, params.image_size, params.image_size));
    for (std::size_t t = 0; t < frames; ++t) {
        const LitMesh mesh(posed[t], canonical, faces, params.light);
        std::vector<PixelBox> boxes;
        for (const auto& named : result.cameras) boxes.push_back(detail::box_of_vertices(posed[t], named.camera));
        executor.for_chunks(cameras * size, 4, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t row = begin; row < end; ++row) {
                const std::size_t c = row / size;
                const int y = static_cast<int>(row % size);
                if (y < boxes[c].y || y >= boxes[c].y + boxes[c].height) continue;
                const Camera<double>& camera = result.cameras[c].camera;
                const vec3<float> eye(camera.center());
                const Camera<float> narrow = camera.cast<float>();
                const std::size_t image = c * frames + t;
                for (int x = boxes[c].x; x < boxes[c].x + boxes[c].width; ++x) {
                    const std::uint64_t pixel =
                        (image * size + static_cast<std::size_t>(y)) * size + static_cast<std::size_t>(x);
                    detail::film_pixel(mesh, narrow, eye, x, y, random_bits(params.seed, pixel), params.samples, color,
                                       result.images[image].pixel(y, x));
                }
            }
        });
        if (params.progress) params.progress(static_cast<double>(t + 1) / static_cast<double>(frames));
    }
    return result;
}

} // namespace detail

template <HostExecutor E, class Color>
Capture film(E& executor, const BodyModel& body, const Motion& motion, const StudioParams& params, const Color& color) {
    return detail::film_people(executor, {{&body, &motion}}, params, color);
}

template <HostExecutor E>
Capture film(E& executor, const std::vector<StudioActor>& actors, const StudioParams& params) {
    std::vector<std::size_t> actor_of; // index of the person for each face
    for (std::size_t i = 0; i < actors.size(); ++i) actor_of.insert(actor_of.end(), actors[i].body->faces.size(), i);
    return detail::film_people(executor, actors, params, [&](const vec3<double>& p, unsigned face) {
        return actors[actor_of[face]].color(p);
    });
}

} // namespace gsh
