// SPDX-License-Identifier: Apache-2.0
/// @file  A capture of the coarse actor, three cameras by two frames, and its files for the programs.
#pragma once

#include "io/npz_files.hpp"
#include "io/temporary.hpp"
#include "programs/process.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <nlohmann/json.hpp>
#include <zip.h>

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

namespace fs = std::filesystem;

/// Files in a folder of their own: body.npz, capture/, dance.npz (another motion), camera.json.
struct SmallCapture {
    Temporary folder;
    BodyModel body = make_actor({.edge_scale = 1.5});
    Capture capture;
    fs::path body_file = folder / "body.npz", path = folder / "capture", dance = folder / "dance.npz",
             camera = folder / "camera.json";

    SmallCapture() {
        cpu::Threads backend;
        StudioParams studio;
        studio.train_cameras = 2, studio.image_size = 64, studio.samples = 4;
        capture = film(backend, body, actor_motion(ActorMotion::talk, 2), studio);
        save_capture(path, capture);
        save_body_model(body_file, body);
        save_motion(dance, actor_motion(ActorMotion::stride, 3));
        write_camera(camera, capture.cameras[0]);
    }

    /// The words of a command that reconstructs a capture, by default this one, into `out`. Hash tables are small,
    /// because a checkpoint stores them three times.
    [[nodiscard]] std::vector<std::string> reconstruct(const fs::path& out, std::vector<std::string> more = {},
                                                       const fs::path& of = {}, const fs::path& with = {}) const {
        std::vector<std::string> words{"gsh-reconstruct",
                                       "--capture",
                                       (of.empty() ? path : of).string(),
                                       "--body",
                                       (with.empty() ? body_file : with).string(),
                                       "--out",
                                       out.string(),
                                       "--gaussians",
                                       "1500",
                                       "--set",
                                       "hash.table_size=4096",
                                       "--set",
                                       "ao.table_size=4096"};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    }
};

/// One instance for all tests of a program, which only read it.
inline const SmallCapture& studio() {
    static const SmallCapture instance;
    return instance;
}

/// Replaces or removes a member of an .npz.
class NpzEdit {
public:
    explicit NpzEdit(const fs::path& path) {
        int error = 0;
        archive_ = zip_open(path.c_str(), 0, &error);
        REQUIRE(archive_ != nullptr);
    }
    ~NpzEdit() { CHECK(zip_close(archive_) == 0); }
    NpzEdit(const NpzEdit&) = delete;
    NpzEdit& operator=(const NpzEdit&) = delete;

    void replace(const std::string& key, std::string npy, bool deflate = false) {
        content_ = std::move(npy);
        zip_source_t* source = zip_source_buffer(archive_, content_.data(), content_.size(), 0);
        const zip_int64_t index = zip_file_add(archive_, (key + ".npy").c_str(), source, ZIP_FL_OVERWRITE);
        REQUIRE(index >= 0);
        zip_set_file_compression(archive_, static_cast<zip_uint64_t>(index), deflate ? ZIP_CM_DEFLATE : ZIP_CM_STORE,
                                 1);
    }
    void remove(const std::string& key) {
        const zip_int64_t index = zip_name_locate(archive_, (key + ".npy").c_str(), 0);
        REQUIRE(index >= 0);
        REQUIRE(zip_delete(archive_, static_cast<zip_uint64_t>(index)) == 0);
    }

private:
    zip_t* archive_ = nullptr;
    std::string content_; // libzip reads it when the archive is closed
};

/// The bytes of numbers as in an .npy array.
template <class T>
std::string bytes_of(const std::vector<T>& numbers) {
    return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(T)};
}

[[nodiscard]] inline nlohmann::json json_of(const fs::path& path) {
    return nlohmann::json::parse(read_file(path));
}
[[nodiscard]] inline bool same_file(const fs::path& a, const fs::path& b) {
    return read_file(a) == read_file(b);
}

/// Number of regular files in a folder and its subfolders; 0 if it does not exist.
inline std::size_t files_below(const fs::path& folder) {
    std::size_t count = 0;
    if (!fs::exists(folder)) return 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) count += entry.is_regular_file();
    return count;
}

} // namespace gsh::test
