// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-render: renders one picture of a 3DGS scene, or of avatars (.gsh) in one frame of their motions.

#include "common/input_files.hpp"
#include "common/machine.hpp"
#include "common/messages.hpp"
#include "common/program.hpp"
#include "common/up_option.hpp"
#include "show/detail_option.hpp"
#include "show/light_command.hpp"
#include "show/light_option.hpp"
#include "show/renderer.hpp"
#include "show/shown_people.hpp"

#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <new>
#include <optional>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct RenderOptions {
    std::vector<std::filesystem::path> scenes, poses; ///< one scene, or avatars with one motion each
    std::filesystem::path camera, out, npy;
    std::string camera_name, input_up;
    std::size_t frame = 0;
    RigOption rig;
    std::optional<double> time; ///< seconds, of an animated .glb
    LightOption light;
    DetailOption detail;
    std::array<double, 3> background{0, 0, 0};
    BackendOption machine;
};

/// Writes the picture as rows of pixels, [height, width, 3], not rounded to bytes.
void write_pixels(AtomicFile& file, const Image<float>& image) {
    std::vector<float> pixels;
    pixels.reserve(image.data.size());
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            for (int c = 0; c < 3; ++c) pixels.push_back(image.at(c, y, x));
    write_npy<float>(file, pixels, {static_cast<std::size_t>(image.height), static_cast<std::size_t>(image.width), 3});
}

/// True if a picture shows nothing but the background.
bool is_empty(const Image<float>& picture, const vec3<float>& background) {
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < picture.height; ++y)
            for (int x = 0; x < picture.width; ++x)
                if (picture.at(c, y, x) != background[c]) return false;
    return true;
}

/// Loads the avatars and their motions.
/// Errors  ValueError if a motion does not have the frame that is requested; else those of the files.
ShownPeople people_of(const RenderOptions& options) {
    ShownPeople people(options.scenes, options.poses, options.light, false, options.rig);
    people.share_clock();
    for (std::size_t p = 0; p < people.motions.size(); ++p)
        check_value(options.frame < people.motions[p].frame_count(), "--frame " + std::to_string(options.frame),
                    options.poses.empty() ? "needs --poses"
                                          : "is beyond " + options.poses[p].string() + ", which has " +
                                                std::to_string(people.motions[p].frame_count()) + " frames, from 0");
    return people;
}

int render(const RenderOptions& options) {
    Machine machine(options.machine);
    const auto is_avatar = [](const std::filesystem::path& file) { return file.extension() == ".gsh"; };
    const bool avatars = std::all_of(options.scenes.begin(), options.scenes.end(), is_avatar);
    for (const auto& scene : options.scenes)
        check_value(is_avatar(scene) || options.scenes.size() == 1, scene.string(),
                    "is not an avatar (.gsh); only avatars can be drawn together");
    check_value(avatars || (options.poses.empty() && options.frame == 0), options.scenes[0].string(),
                "--poses and --frame need avatars (.gsh)");
    check_value(!avatars || !options.time, options.scenes[0].string(), "--time is for an animated scene (.glb)");
    check_value(!avatars || options.input_up.empty(), options.scenes[0].string(),
                "--input-up is for a scene, not for avatars (.gsh)");
    check_value(avatars || options.light.is_default(), options.scenes[0].string(),
                "--light, --light-turn and --exposure need avatars (.gsh)");
    check_value(avatars || options.detail.is_full(), options.scenes[0].string(), "--detail needs avatars (.gsh)");
    const auto kind = options.out.extension();
    check_value(kind.empty() || kind == ".png", "--out " + options.out.string(), "is a PNG file; name it .png");
    const Camera<double> camera = camera_of_file(options.camera, options.camera_name).camera;
    const vec3<float> background(options.background[0], options.background[1], options.background[2]);
    const auto show_people = [&](ShownPeople people) {
        coarsen(machine.host(), people, options.detail, camera, options.frame, options.frame);
        return make_renderer(machine, people)->render(options.frame, camera, background);
    };
    const auto show_scene = [&](const StillSplats& scene) {
        for (const std::string& warning : scene.warnings) warn(warning);
        try {
            return make_renderer(machine, scene.cloud, scene.notes.filter.value_or(PixelFilter{}))
                ->render(0, camera, background);
        } catch (const ValueError& error) { // Gaussians that no picture can be made of
            throw ValueError(options.scenes[0].string() + ": " + error.what());
        }
    };
    const Image<float> picture = avatars
                                     ? show_people(people_of(options))
                                     : show_scene(splats_of_file(options.scenes[0], options.input_up, options.time));
    if (is_empty(picture, background))
        warn(options.camera.string() + ": sees nothing of the scene; the camera looks along +z, and x_cam = R x + t");
    AtomicFile png(options.out);
    png.write(encode_png(quantise(picture.view())));
    if (options.npy.empty()) {
        png.commit();
        return exit_done;
    }
    AtomicFile npy(options.npy);
    write_pixels(npy, picture);
    AtomicFile::commit_all({&png, &npy});
    return exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    RenderOptions options;
    CLI::App app("Renders a 3DGS scene or avatars.", "gsh-render");
    app.add_option("scene", options.scenes, "a scene (" + scene_endings() + "), or one or several AVATAR.gsh")
        ->required();
    app.add_option(
           "--poses", options.poses,
           "one motion per avatar, in the same order, in any layout that gsh reads (.npz, .bvh, .glb, folder); without "
           "it, the canonical pose")
        ->allow_extra_args(false);
    app.add_option("--frame", options.frame, "frame of the motions (default 0)")->check(not_negative());
    app.add_option("--time", options.time, "seconds of the animation of a scene (.glb); without it, the scene at rest")
        ->check(numbers([](double value) { return std::isfinite(value); }, "a number"));
    add_input_up(app, options.input_up);
    app.add_option("--camera", options.camera, "CAMERA.json: width, height, K, R, t")->required();
    app.add_option("--camera-name", options.camera_name, "name of the entry, if the file has several cameras");
    app.add_option("--out", options.out, "IMAGE.png")->required();
    app.add_option("--npy", options.npy, "IMAGE.npy: the same picture as floats (height, width, 3), not rounded");
    add_rig(app, options.rig);
    add_light(app, options.light);
    add_detail(app, options.detail);
    add_background(app, options.background, "black");
    add_backend(app, options.machine);
    return run_program(app, argc, argv, [&] { return render(options); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-render");
}
