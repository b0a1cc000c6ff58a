// SPDX-License-Identifier: Apache-2.0
/// @file  The captures on which scripts/golden trains: FOLDER/body.npz, FOLDER/one and FOLDER/two, for their people.
#include "support/crossing_actors.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/capture.hpp>

#include <cstdio>
#include <filesystem>

int main(int argc, char** argv) {
    using namespace gsh;
    try {
        check_value(argc == 2, "golden_film", "expected FOLDER");
        const std::filesystem::path folder = argv[1];
        std::filesystem::create_directories(folder);
        test::CrossingActors actors({.image_size = 96, .frames = 4, .cameras = 3});
        const Capture two = actors.together();
        save_body_model(folder / "body.npz", actors.body);
        test::save_people(folder / "two", two, {{"ann", &actors.ann}, {"bob", &actors.bob}});
        save_capture(folder / "one", actors.alone(actors.first(), two.cameras));
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
