// SPDX-License-Identifier: Apache-2.0
/// @file  Story 10: a video of one camera, as scripts/demo --video makes it.
///
/// The procedural actor turns once in a room, in one pose, before a camera that stands still. Writes 10_turn/ with the
/// pictures of the video, frames/0000.png and so on (they have no mask), body.npz, and what nobody knows of a real
/// video: truth.npz, the motion. 10_film_a_turn.png shows four of the pictures. A larger film is that
/// of 10-film-a-turn FOLDER 720 72: the height of the pictures in pixels, and their number, ten for a second.
#include <gsh/backend/threads.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_turn.hpp>
#include <gsh/synthetic/studio.hpp>

#include <programs/common/progress.hpp>
#include <story.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

// 1. The room: a floor of boards, a wall with a picture, a door and a skirting board; nothing in the actor's colours.
struct Surface {
    vec3<float> position, normal, albedo;
};
Surface room_along(const vec3<float>& eye, const vec3<float>& direction) {
    constexpr auto floor_y = static_cast<float>(ActorOutfit::sole_y);
    constexpr float wall_z = -1.7f;
    const float to_wall = direction.z < 0 ? (wall_z - eye.z) / direction.z : 1e6f;
    const float to_floor = direction.y < 0 ? (floor_y - eye.y) / direction.y : 1e6f;
    const vec3<float> at = eye + direction * std::min(to_wall, to_floor);
    if (to_floor < to_wall) {
        const float board = std::floor(at.x / 0.14f), across = at.x / 0.14f - board;
        const auto tone = static_cast<float>(random_uniform(5, static_cast<std::uint64_t>(board + 1000)));
        const float grain = 0.5f + 0.5f * std::sin(60 * at.x + 2 * std::sin(5 * at.z + 9 * tone));
        const float seam = std::abs(across - 0.5f) > 0.47f ? 0.6f : 1.0f;
        return {at, {0, 1, 0}, vec3<float>(0.36f, 0.25f, 0.15f) * ((0.85f + 0.25f * tone + 0.08f * grain) * seam)};
    }
    vec3<float> wall(0.50f, 0.52f, 0.47f);
    if (at.y < floor_y + 0.10f) wall = vec3<float>(0.70f);
    const float u = (at.x + 1.25f) / 0.60f, v = (0.77f - at.y) / 0.44f; // of the picture
    if (u > 0 && u < 1 && v > 0 && v < 1) {
        wall = examples::landscape(u, v) * 0.7f;
        if (std::min({u, v, 1 - u, 1 - v}) < 0.06f) wall = vec3<float>(0.10f);
    }
    const float from_door = std::abs(at.x - 1.15f);
    if (from_door < 0.36f && at.y < 1.05f)
        wall = vec3<float>(0.62f, 0.60f, 0.55f) * (std::abs(from_door - 0.22f) < 0.008f ? 0.7f : 1.0f);
    return {at, {0, 0, 1}, wall};
}

// 2. Its light is that of the studio; the actor keeps some of it from the floor.
vec3<float> radiance(const Surface& surface, const StudioLight& light, const RayScene& actor, std::uint64_t key) {
    constexpr int rays = 12;
    const vec3<float> above = surface.position + surface.normal * 1e-3f;
    const bool near_actor = length(surface.position - vec3<float>(0, surface.position.y, 0)) < 2.2f;
    float lamp = 0, sky = 0;
    for (std::uint64_t k = 0; k < rays; ++k) {
        const auto sample = even_sample(key, k);
        const float turn = 6.2831853f * sample[0], reach = std::sqrt(sample[1]);
        const vec3<float> to_lamp =
            light.position + vec3<float>(std::cos(turn), 0, std::sin(turn)) * (light.radius * reach) - above;
        lamp += !near_actor || !actor.occluded(above, to_lamp, 0, 1);
        const float up = std::sqrt(1 - reach * reach);
        const vec3<float> along = surface.normal.y > 0.5f
                                      ? vec3<float>(std::cos(turn) * reach, up, std::sin(turn) * reach)
                                      : vec3<float>(std::cos(turn) * reach, std::sin(turn) * reach, up);
        sky += !near_actor || !actor.occluded(above, along, 0, 1.5f);
    }
    const vec3<float> to_lamp = light.position - surface.position;
    const float falloff = dot(light.position, light.position) / dot(to_lamp, to_lamp);
    const float lambert = std::max(0.0f, dot(surface.normal, normalize(to_lamp)));
    return surface.albedo * (light.sky * (sky / rays) + light.lamp * (falloff * lambert * lamp / rays));
}

// 3. The room around the actor; both are mixed as the programs mix a person and a background, in sRGB.
PixelImage in_room(cpu::Threads& backend, const PixelImage& photo, const PixelBox& part, const Camera<double>& camera,
                   const RayScene& actor, const StudioLight& light) {
    PixelImage picture(3, part.height, part.width);
    const vec3<float> eye(camera.center());
    const Camera<float> narrow = camera.cast<float>();
    const auto rows = static_cast<std::size_t>(part.height);
    backend.for_chunks(rows, 8, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (int y = static_cast<int>(begin); y < static_cast<int>(end); ++y)
            for (int x = 0; x < part.width; ++x) {
                const auto* rgba = photo.pixel(part.y + y, part.x + x);
                const float alpha = static_cast<float>(rgba[3]) / 255;
                const vec3<float> along((static_cast<float>(part.x + x) + 0.5f - narrow.cx) / narrow.fx,
                                        (static_cast<float>(part.y + y) + 0.5f - narrow.cy) / narrow.fy, 1);
                const Surface surface = room_along(eye, transposed_times(narrow.R, along));
                const vec3<float> room =
                    radiance(surface, light, actor, random_bits(9, static_cast<std::uint64_t>(y * part.width + x)));
                for (int c = 0; c < 3; ++c)
                    picture.pixel(y, x)[c] = static_cast<std::uint8_t>(
                        std::lround(static_cast<float>(rgba[c]) * alpha +
                                    255 * std::min(1.0f, linear_to_srgb(room[c])) * (1 - alpha)));
            }
    });
    return picture;
}

void story(const std::filesystem::path& out, int size, int frames) {
    const std::filesystem::path folder = out / "10_turn";
    // 4. The actor, the turn, and a camera at the height of the chest that sees the whole person all the time.
    const BodyModel body = make_actor();
    const Motion motion = actor_turn(frames, 10);
    StudioParams studio;
    studio.image_size = size;
    studio.samples = 16;
    const NamedCamera camera{"turn",
                             NamedCamera::Role::train,
                             look_at<double>({0, 0.35, 3.3}, {0, -0.07, 0}, {0, 1, 0}, 0.66, size, size),
                             {}};
    studio.cameras = {camera};
    const int width = size * 3 / 8 * 2; // phones film upright: the middle three quarters, an even number for H.264
    const PixelBox part{(size - width) / 2, 0, width, size / 2 * 2};

    // 5. The film.
    cpu::Threads backend;
    std::optional<programs::Progress> work(std::in_place, "filming the turn");
    studio.progress = [&](double share) { work->show(share, ""); };
    const Capture filmed = film(backend, body, motion, studio);
    work.emplace("filming the room");
    std::vector<PixelImage> pictures;
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        std::vector<vec3<float>> vertices;
        for (const vec3<double>& p : pose_body(body, motion.pose_at(t), motion.transl[t], motion.betas).vertices)
            vertices.emplace_back(p);
        pictures.push_back(
            in_room(backend, filmed.images[t], part, camera.camera, RayScene(vertices, body.faces), studio.light));
        work->show(static_cast<double>(t + 1) / frames, "");
    }
    work.reset();

    // 6. On disk.
    std::filesystem::create_directories(folder / "frames");
    for (std::size_t t = 0; t < pictures.size(); ++t) {
        char name[32];
        std::snprintf(name, sizeof name, "%04zu.png", t);
        write_png(folder / "frames" / name, pictures[t]);
    }
    save_body_model(folder / "body.npz", body);
    save_motion(folder / "truth.npz", motion);

    // 7. What scripts/detect and gsh-fit rely on: the whole person is in every picture, and the room stands still.
    bool whole = true;
    for (std::size_t t = 0; t < pictures.size(); ++t)
        for (const vec3<double>& p : pose_body(body, motion.pose_at(t), motion.transl[t], motion.betas).vertices) {
            const vec2<double> at = to_pixel(camera.camera, to_camera(camera.camera, p)) - vec2<double>(part.x, part.y);
            whole = whole && at.x > 0 && at.x < part.width && at.y > 0 && at.y < part.height;
        }
    examples::claim(whole, "the whole person is in every picture");
    const auto corner_is_still = [&](const PixelImage& picture) { // the left upper one, where no shadow falls
        for (int y = 0; y < picture.height / 10; ++y)
            if (!std::equal(picture.pixel(y, 0), picture.pixel(y, picture.width / 10), pictures[0].pixel(y, 0)))
                return false;
        return true;
    };
    examples::claim(std::all_of(pictures.begin(), pictures.end(), corner_is_still), "the room stands still");
    std::vector<Image<float>> shown;
    for (std::size_t k = 0; k < 4; ++k) {
        const PixelImage& picture = pictures[k * pictures.size() / 4];
        Image<float>& copy = shown.emplace_back(3, picture.height, picture.width);
        for (int y = 0; y < picture.height; ++y)
            for (int x = 0; x < picture.width; ++x)
                for (int c = 0; c < 3; ++c) copy.at(c, y, x) = static_cast<float>(picture.pixel(y, x)[c]) / 255;
    }
    write_png(out / "10_film_a_turn.png", examples::beside<float>({&shown[0], &shown[1], &shown[2], &shown[3]}));
    std::printf("next: ffmpeg -framerate 10 -i %s -pix_fmt yuv420p turn.mp4\n", (folder / "frames/%04d.png").c_str());
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(std::min(argc, 2), argv, [&](const std::filesystem::path& folder) {
        const int size = argc > 2 ? std::atoi(argv[2]) : 64, frames = argc > 3 ? std::atoi(argv[3]) : 4;
        check_value(size >= 16 && frames >= 4, "10-film-a-turn",
                    "expected FOLDER, then a height of at least 16 and at least 4 frames");
        story(folder, size, frames);
    });
}
