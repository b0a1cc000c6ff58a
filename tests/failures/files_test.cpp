// SPDX-License-Identifier: Apache-2.0
/// Each allocation fails in turn while a file of every kind is read or written.
#include "failures/failing_allocations.hpp"
#include "io/every_sample.hpp"
#include "io/small_body.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"
#include "support/tube_avatar.hpp"

#include <gsh/io/file/atomic_folder.hpp>
#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/model/gltf_mesh.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/gltf_export.hpp>
#include <gsh/io/splat/usda.hpp>

#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {
/// Kinds for which libraries end the program where memory runs out. A tree of nlohmann-json that is not ours to take
/// apart, as in tinygltf and in what is written: its destructor allocates. stb's writer of PNG: it asserts.
bool is_left_out(const std::string& name) {
    for (const char* ending : {".glb", ".gltf", "cameras.json", "picture.png"})
        if (name.ends_with(ending)) return true;
    return false;
}
/// The same of what is read, where a caller gets such a tree or tinygltf has one.
bool is_tree_of_json(const test::Sample& sample) {
    return sample.target == "json" || sample.target.starts_with("glb") || sample.target.starts_with("gltf");
}
} // namespace

TEST_CASE("memory runs out while a file of every kind is read") {
    const test::Temporary folder;
    test::Exhausted sum;
    for (const test::Sample& sample : test::write_samples(folder / ""))
        if (sample.whole && !is_tree_of_json(sample))
            sum += test::exhaust("reading " + sample.place.string(), [&] { return sample.read(sample.place); });
    test::report("reading files", sum);
}

TEST_CASE("memory runs out while a file of every kind is written: the old one stays") {
    const test::Temporary folder;
    const BodyModel body = test::small_body();
    const Motion motion = test::still_motion(body, 3);
    const AvatarData avatar = test::tube_avatar(2);
    const Motion still = test::still_motion(avatar.rig.body, 1);
    const auto cloud = test::splat_cloud(20, 1);
    PixelImage picture(3, 16, 24);
    for (std::size_t i = 0; i < picture.data.size(); ++i) picture.data[i] = static_cast<std::uint8_t>(i);
    const CameraList cameras{test::sample_cameras(), 25, {}, {}};

    std::vector<std::pair<std::string, std::function<void(const fs::path&)>>> writers{
        {"body.npz", [&](const fs::path& file) { save_body_model(file, body); }},
        {"motion.npz", [&](const fs::path& file) { save_motion(file, motion); }},
        {"motion.bvh", [&](const fs::path& file) { save_bvh(file, rig_of_motion(body, motion)); }},
        {"motion.glb", [&](const fs::path& file) { save_gltf_motion(file, rig_of_motion(body, motion)); }},
        {"mesh.glb", [&](const fs::path& file) { write_gltf_mesh(file, avatar, still, {}, {}); }},
        {"frames.usda",
         [&](const fs::path& file) {
             UsdaSplats frames(file);
             frames.add(cloud);
             frames.commit();
         }},
        {"avatar.gsh", [&](const fs::path& file) { save_avatar(file, avatar); }},
        {"picture.png", [&](const fs::path& file) { write_png(file, picture); }},
        {"cameras.json", [&](const fs::path& file) { write_cameras(file, cameras); }},
        {"numbers.npy", [&](const fs::path& file) { write_npy<float>(file, std::vector<float>{1, 2, 3}, {3}); }},
    };
    for (const SplatFormatTraits& row : splat_formats)
        if (row.write)
            for (const int version : std::set<int>(row.versions.begin(), row.versions.end()))
                writers.emplace_back(
                    std::to_string(version) + std::string(row.ending),
                    [&, version](const fs::path& file) { (void)save_splats(file, cloud, {.version = version}); });
    test::Exhausted sum;
    for (const auto& [name, write] : writers) {
        if (is_left_out(name)) continue;
        const fs::path file = folder / name;
        write(file);
        const std::string whole = read_file(file);
        const auto prepare = [&] {
            write_file(file, "old");
            return folder.file_count();
        };
        sum += test::exhaust("writing " + name, prepare, [&](std::size_t count) {
            try {
                write(file);
            } catch (...) {
                test::allocations::end(); // what follows is a check
                if (read_file(file) != "old") FAIL_CHECK(name << ": the old file was changed");
                if (folder.file_count() != count) FAIL_CHECK(name << ": a file is left");
                throw;
            }
            test::allocations::end();
            return read_file(file) == whole;
        });
        fs::remove(file);
    }
    test::report("writing files", sum);
}

TEST_CASE("memory runs out while a folder is created, locked or replaced: nothing is left") {
    const test::Temporary folder;
    const auto is_empty = [&] {
        test::allocations::end(); // what follows is a check
        return fs::is_empty(folder / "");
    };
    test::Exhausted sum = test::exhaust("locking a folder", [&] {
        try {
            const LockedFolder locked(folder / "a/b/c");
        } catch (...) {
            if (!is_empty()) FAIL_CHECK("a folder or a lock is left");
            throw;
        }
        return is_empty();
    });
    const auto is_frame = [](const std::string& name) { return name.starts_with("frame"); };
    const auto content = [&] { return read_file(folder / "walk/frame_0"); };
    sum += test::exhaust("replacing a folder", [&] {
        {
            AtomicFolder first(folder / "walk", is_frame);
            write_file(first.file("frame_0"), "old", Sync::none);
            first.commit();
        }
        std::string now;
        try {
            AtomicFolder second(folder / "walk", is_frame);
            write_file(second.file("frame_0"), "new", Sync::none);
            second.commit();
        } catch (...) {
            test::allocations::end();
            if (fs::exists(folder / "walk") && content() != "old" && content() != "new") FAIL_CHECK("a broken folder");
            for (const char* ending : {".partial", ".lock", ".old"})
                if (fs::exists(folder / (std::string("walk") + ending))) FAIL_CHECK("walk" << ending << " is left");
            throw;
        }
        test::allocations::end();
        return content();
    });
    test::report("folders", sum);
}
