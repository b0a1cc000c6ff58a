// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-render: one picture of a 3DGS scene (.ply), or of an avatar (.gsh) in a frame of a motion.

#include "support/program.hpp"
#include "support/renderer.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/io/atomic_file.hpp>
#include <gsh/io/avatar_file.hpp>
#include <gsh/io/camera_file.hpp>
#include <gsh/io/image_file.hpp>
#include <gsh/io/motion_file.hpp>
#include <gsh/io/npy.hpp>
#include <gsh/io/ply.hpp>

#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::examples;

namespace {

struct RenderOptions {
    std::filesystem::path scene, poses, camera, out, npy;
    std::string camera_name;
    std::size_t frame = 0;
    std::array<double, 3> background{0, 0, 0};
    std::size_t threads = 0;
};

/// The picture's numbers as rows of pixels, [height, width, 3]: before any rounding to bytes.
void write_pixels(const std::filesystem::path& path, const Image<float>& image) {
    std::vector<float> pixels;
    pixels.reserve(image.data.size());
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            for (int c = 0; c < 3; ++c) pixels.push_back(image.at(c, y, x));
    write_npy<float>(path, pixels, {static_cast<std::size_t>(image.height), static_cast<std::size_t>(image.width), 3});
}

/// The motion whose frame is wanted, and what is suspicious about it.
Motion motion_of(const RenderOptions& options, const AvatarData& avatar) {
    std::vector<std::string> warnings;
    const Motion motion = options.poses.empty() ? rest_motion(avatar.rig)
                                                : load_motion(options.poses, avatar.rig.body, {}, &warnings);
    for (const std::string& warning : warnings) warn(warning);
    check_value(options.frame < motion.frame_count(), "--frame " + std::to_string(options.frame),
                options.poses.empty() ? "needs --poses" : "is beyond " + options.poses.string() + ", which holds " +
                                                              std::to_string(motion.frame_count()) + " frames, from 0");
    return motion;
}

int render(const RenderOptions& options) {
    const bool avatar_file = options.scene.extension() == ".gsh";
    check_value(avatar_file || (options.poses.empty() && options.frame == 0), options.scene.string(),
                "--poses and --frame are for avatars (.gsh)");
    const Camera<double> camera = read_camera(options.camera, options.camera_name).camera;
    const vec3<float> background(options.background[0], options.background[1], options.background[2]);
    cpu::Threads backend(options.threads);
    Image<float> picture;
    if (avatar_file) {
        const AvatarData data = load_avatar(options.scene);
        const Motion motion = motion_of(options, data);
        const Avatar<cpu::Threads> avatar(backend, data);
        picture = Renderer(backend, data.filter).render(avatar, motion, options.frame, camera, background);
    } else {
        picture = Renderer(backend).render(read_gaussian_ply(options.scene), camera, background);
    }
    AtomicFile png(options.out); // both files or none
    png.write(encode_png(quantise(picture.view())));
    if (!options.npy.empty()) write_pixels(options.npy, picture);
    png.commit(Sync::none);
    return exit_done;
}

} // namespace

int main(int argc, char** argv) {
    RenderOptions options;
    CLI::App app("Renders a 3DGS scene or an avatar.", "gsh-render");
    app.add_option("scene", options.scene, "SCENE.ply (standard 3DGS) or AVATAR.gsh")->required();
    app.add_option("--poses", options.poses, "motion (.npz) for an avatar; without it, the canonical pose");
    app.add_option("--frame", options.frame, "frame of the motion (default 0)")->check(not_negative());
    app.add_option("--camera", options.camera, "CAMERA.json: width, height, K, R, t")->required();
    app.add_option("--camera-name", options.camera_name, "which entry, if the file holds several cameras");
    app.add_option("--out", options.out, "IMAGE.png")->required();
    app.add_option("--npy", options.npy, "IMAGE.npy: the same as floats (height, width, 3), not rounded");
    add_background(app, options.background, "black");
    add_threads(app, options.threads);
    return run_program(app, argc, argv, [&] { return render(options); });
}
