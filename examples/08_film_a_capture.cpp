// SPDX-License-Identifier: Apache-2.0
/// @file  Story 8: a capture on disk, filmed by the studio under two lights.
///
/// The procedural actor talks, then reaches far beyond the poses before. Six cameras and a test camera film both under
/// hard and under soft light. Writes 08_capture/ with body.npz, two captures in the layout that the programs read, hard/
/// and soft/, and what to show the avatar in: stride.npz, a motion that no camera filmed, and window.png, an environment
/// image. 08_film_a_capture.png shows the same frame in both lights. A larger film is that of
/// 08-film-a-capture FOLDER 320 40: the side of the images in pixels, and the number of frames.
#include <gsh/backend/threads.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
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
#include <string>
#include <utility>

using namespace gsh;

namespace {

// 1. Two motions of the same body, one after the other.
Motion followed_by(Motion motion, const Motion& next, double fps) {
    motion.pose.insert(motion.pose.end(), next.pose.begin(), next.pose.end());
    motion.expression.insert(motion.expression.end(), next.expression.begin(), next.expression.end());
    motion.transl.insert(motion.transl.end(), next.transl.begin(), next.transl.end());
    motion.timestamps.clear();
    for (std::size_t frame = 0; frame < motion.frame_count(); ++frame)
        motion.timestamps.push_back(static_cast<double>(frame) / fps);
    return motion;
}

// 2. A photograph on white.
Image<float> on_white(const PixelImage& photo) {
    Image<float> picture(3, photo.height, photo.width);
    for (int y = 0; y < photo.height; ++y)
        for (int x = 0; x < photo.width; ++x) {
            const auto* rgba = photo.pixel(y, x);
            const float alpha = static_cast<float>(rgba[3]) / 255;
            for (int c = 0; c < 3; ++c) picture.at(c, y, x) = static_cast<float>(rgba[c]) / 255 * alpha + (1 - alpha);
        }
    return picture;
}

// 3. A dark room with one large window, seen in all directions; the middle row is the horizon.
Image<float> room_with_window(int height) {
    Image<float> room(3, height, 2 * height);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < 2 * height; ++x) {
            const float u = (static_cast<float>(x) + 0.5f) / static_cast<float>(2 * height),
                        v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height);
            const bool window = std::abs(u - 0.86f) < 0.08f && std::abs(v - 0.38f) < 0.12f;
            for (int c = 0; c < 3; ++c) room.at(c, y, x) = window ? 1.0f : v < 0.5f ? 0.20f : 0.12f;
        }
    return room;
}

void story(const std::filesystem::path& out, int size, int frames) {
    const std::filesystem::path folder = out / "08_capture";
    // 4. Three quarters of the frames talk; the last quarter lifts the arms above the head and bends elbows and knees
    //    to 120 degrees. With --hold-out-motion 0.25, the programs train on the first and judge on both.
    std::optional<programs::Progress> work(std::in_place, "making the actor");
    const BodyModel body = make_actor();
    work.reset();
    const int new_frames = std::max(1, frames / 4);
    const Motion motion = followed_by(actor_motion(ActorMotion::talk, frames - new_frames),
                                      actor_motion(ActorMotion::reach, new_frames), 10);

    // 5. The film. Both captures have the same cameras, so only the light differs.
    cpu::Threads backend;
    const auto film_in = [&](const StudioLight& light, const char* title) {
        programs::Progress shown(title);
        StudioParams studio;
        studio.image_size = size;
        studio.light = light;
        studio.progress = [&](double share) { shown.show(share, ""); };
        return film(backend, body, motion, studio);
    };
    const Capture hard = film_in(hard_light(), "filming in hard light");
    const Capture soft = film_in(soft_light(), "filming in soft light");

    // 6. On disk: cameras.json, poses.npz, images/CAMERA/FRAME.png. The alpha of the images is the mask.
    work.emplace("writing both captures");
    std::filesystem::create_directories(folder);
    save_body_model(folder / "body.npz", body);
    save_capture(folder / "hard", hard);
    save_capture(folder / "soft", soft);
    save_motion(folder / "stride.npz", actor_motion(ActorMotion::stride, 60, 30));
    write_png(folder / "window.png", room_with_window(128));
    const std::size_t shown = motion.frame_count() / 3;
    const Image<float> left = on_white(hard.images[shown]), right = on_white(soft.images[shown]);
    write_png(out / "08_film_a_capture.png", examples::beside<float>({&left, &right}));

    // 7. What a program would read is what was filmed.
    work.emplace("reading one of them again");
    const Capture read = load_capture(backend, folder / "hard", body);
    work.reset();
    examples::claim(read.frame_count() == motion.frame_count() && read.cameras.size() == 7,
                    "seven cameras and " + std::to_string(motion.frame_count()) + " frames come back from disk");
    examples::claim(std::equal(read.images.begin(), read.images.end(), hard.images.begin(),
                               [](const auto& a, const auto& b) { return a.data == b.data; }),
                    "so do all pixels");
    examples::claim(hard.images[shown].data != soft.images[shown].data, "the two lights differ");
    std::printf("next: gsh-evaluate --capture %s --body %s --configs light,paper --hold-out-motion 0.25 --out OUT\n",
                (folder / "hard").c_str(), (folder / "body.npz").c_str());
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(std::min(argc, 2), argv, [&](const std::filesystem::path& folder) {
        const int size = argc > 2 ? std::atoi(argv[2]) : 64, frames = argc > 3 ? std::atoi(argv[3]) : 4;
        check_value(size >= 16 && frames >= 2, "08-film-a-capture",
                    "expected FOLDER, then a size of at least 16 and at least 2 frames");
        story(folder, size, frames);
    });
}
