// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-view: shows avatars in a browser, where they can be turned, posed and played.

#include "common/input_files.hpp"
#include "common/interrupts.hpp"
#include "common/machine.hpp"
#include "common/messages.hpp"
#include "common/program.hpp"
#include "common/rig_option.hpp"
#include "common/up_option.hpp"
#include "show/detail_option.hpp"
#include "show/light_command.hpp"
#include "show/light_option.hpp"
#include "view/view_scene.hpp"
#include "view/view_server.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <new>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct ViewOptions {
    std::vector<std::filesystem::path> scenes, poses;
    std::string input_up;
    ViewServerOptions server;
    int size = 540;
    bool open = false;
    LightOption light;
    DetailOption detail{"auto"};
    RigOption rig;
    BackendOption machine;
};

/// Asks the desktop to open an address; what it prints is dropped. The browser is in a process group of its own, so
/// that Ctrl-C in the terminal does not end it.
void open_browser(std::string url) {
    std::string program = "xdg-open";
    char* const arguments[] = {program.data(), url.data(), nullptr};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    for (const int descriptor : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
        posix_spawn_file_actions_addopen(&actions, descriptor, "/dev/null", O_RDWR, 0);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    posix_spawnattr_setpgroup(&attributes, 0);
    pid_t id = 0;
    if (posix_spawnp(&id, program.c_str(), &actions, &attributes, arguments, environ) != 0)
        warn("--open: there is no xdg-open; open the address above in a browser");
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
}

int view(ViewOptions& options) {
    Machine machine(options.machine);
    std::vector<std::string> warnings;
    ViewScene scene =
        load_view_scene(options.scenes, options.poses, options.light, options.rig, warnings, options.input_up);
    scene.size = options.size;
    scene.adapts_detail = options.detail.is_auto();
    if (scene.people && !options.detail.is_auto() && !options.detail.is_full())
        coarsen(machine.host(), scene.people->data, options.detail.count());
    for (const std::string& warning : warnings) warn(warning);
    ViewServer server(machine.host(), scene, options.server);
    if (options.server.host != "127.0.0.1" && options.server.host != "localhost" && options.server.host != "::1")
        warn("--host " + options.server.host +
             ": other machines can reach the page, without encryption; whoever has "
             "the key sees the avatar");
    watch_interrupts();
    std::printf("%s\n", server.url().c_str());
    std::fflush(stdout); // for those who read it through a pipe
    if (options.open) open_browser(server.url());
    server.run(interrupted);
    return exit_interrupted;
}

} // namespace

int main(int argc, char** argv) try {
    ViewOptions options;
    CLI::App app("Shows avatars in a browser.", "gsh-view");
    app.add_option("scene", options.scenes, "one or several AVATAR.gsh, or one scene (" + scene_endings() + ")")
        ->required();
    app.add_option(
           "--poses", options.poses,
           "a motion in any layout that gsh reads (.npz, .bvh, .glb, folder); several for one avatar, or one for each")
        ->allow_extra_args(false);
    add_input_up(app, options.input_up);
    app.add_option("--port", options.server.port, "port of the page (default: any free one)")
        ->check(CLI::Range(0, 65535));
    app.add_option("--host", options.server.host,
                   "address to listen at (default 127.0.0.1, which only this machine can reach)");
    app.add_flag("--open", options.open, "open the page in the browser");
    app.add_option("--size", options.size, "pixels of the shorter side of the picture, at most (default 540)")
        ->check(CLI::Range(64, 4096));
    add_rig(app, options.rig);
    add_light(app, options.light);
    add_detail(app, options.detail);
    add_threads(app, options.machine.threads);
    return run_program(app, argc, argv, [&] { return view(options); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-view");
}
