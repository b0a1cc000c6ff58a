// SPDX-License-Identifier: Apache-2.0
/// @file  COLMAP's binary files, written byte by byte.
#pragma once

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::test {

class Bytes {
public:
    template <class Number>
    Bytes& put(Number number) {
        char raw[sizeof number];
        std::memcpy(raw, &number, sizeof number);
        data_.append(raw, sizeof number);
        return *this;
    }
    Bytes& put_text(const std::string& text) {
        data_.append(text.c_str(), text.size() + 1);
        return *this;
    }
    [[nodiscard]] const std::string& data() const { return data_; }

private:
    std::string data_;
};

/// A reconstruction in the order of its files.
struct ColmapFiles {
    struct Camera {
        std::uint32_t id;
        std::int32_t model;
        const char* model_name;
        std::uint64_t width, height;
        std::vector<double> parameters;
    };
    struct Image {
        std::uint32_t id;
        quat<double> rotation;
        vec3<double> translation;
        std::uint32_t camera;
        std::string name;
        std::uint64_t features = 0;
    };
    struct Point {
        std::uint64_t id;
        vec3<double> position;
        std::array<std::uint8_t, 3> color;
        std::uint64_t track = 0; ///< images that show it
    };
    std::vector<Camera> cameras;
    std::vector<Image> images;
    std::vector<Point> points;

    void write_binary(const std::filesystem::path& folder) const {
        Bytes cameras_bin, images_bin, points_bin;
        cameras_bin.put<std::uint64_t>(cameras.size());
        for (const Camera& camera : cameras) {
            cameras_bin.put(camera.id).put(camera.model).put(camera.width).put(camera.height);
            for (const double p : camera.parameters) cameras_bin.put(p);
        }
        images_bin.put<std::uint64_t>(images.size());
        for (const Image& image : images) {
            const quat<double>& q = image.rotation;
            const vec3<double>& t = image.translation;
            images_bin.put(image.id);
            for (const double number : {q.w, q.x, q.y, q.z, t.x, t.y, t.z}) images_bin.put(number);
            images_bin.put(image.camera).put_text(image.name).put(image.features);
            for (std::uint64_t k = 0; k < image.features; ++k)
                images_bin.put(1.5).put(2.5).put<std::uint64_t>(k == 0 ? ~0ull : 2);
        }
        points_bin.put<std::uint64_t>(points.size());
        for (const Point& point : points) {
            points_bin.put(point.id).put(point.position.x).put(point.position.y).put(point.position.z);
            for (const std::uint8_t byte : point.color) points_bin.put(byte);
            points_bin.put(0.75).put(point.track); // the error, in pixels
            for (std::uint64_t k = 0; k < 2 * point.track; ++k) points_bin.put<std::uint32_t>(1);
        }
        write_file(folder / "cameras.bin", cameras_bin.data());
        write_file(folder / "images.bin", images_bin.data());
        write_file(folder / "points3D.bin", points_bin.data());
    }
};

} // namespace gsh::test
