// SPDX-License-Identifier: Apache-2.0
/// @file  A small scene in GalaBasketball's file formats: two people, three cameras, four frames.
#pragma once

#include "io/sample_files.hpp"

#include "support/gradient.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/io/capture/gala_basketball.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

namespace gsh::test {

using Matrix = std::array<std::array<double, 4>, 4>;

inline Matrix times(const Matrix& a, const Matrix& b) {
    Matrix c{};
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 4; ++j)
            for (std::size_t k = 0; k < 4; ++k) c[i][j] += a[i][k] * b[k][j];
    return c;
}
inline Matrix rigid(const mat3<double>& R, const vec3<double>& t) {
    Matrix m{};
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) m[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = R[j][i];
        m[static_cast<std::size_t>(i)][3] = t[i];
    }
    m[3][3] = 1;
    return m;
}
inline vec3<double> transformed(const Matrix& m, const vec3<double>& x) {
    vec3<double> y;
    for (std::size_t i = 0; i < 3; ++i)
        y[static_cast<int>(i)] = m[i][0] * x.x + m[i][1] * x.y + m[i][2] * x.z + m[i][3];
    return y;
}
/// Ry Rx Rz by its entries, angles in degrees.
inline mat3<double> unity_rotation(const vec3<double>& degrees) {
    const auto turn = [&](int axis, double d) {
        vec3<double> v(0);
        v[axis] = d * std::numbers::pi / 180;
        return rotation_from_axis_angle(v);
    };
    return turn(1, degrees.y) * turn(0, degrees.x) * turn(2, degrees.z);
}

/// A small scene with the numbers of its files: left-handed, y up. Its functions compute the expected results from
/// them, matrix by matrix.
struct Gala {
    static constexpr std::size_t J = 27, V = 60;
    Temporary folder;
    std::filesystem::path model = folder / "Gala/model", scene = folder / "Gala/small";
    cpu::Serial serial;
    std::vector<int> parents;
    std::vector<vec3<double>> vertices, local; // local: joints in their parents' frames
    std::vector<Matrix> bind;                  // joint_from_world
    std::vector<double> weights;               // [V, J]
    static constexpr int cameras = 3, frames = 4, people = 2;
    std::vector<vec3<double>> degrees, roots; // [frames, people, J], [frames, people]
    vec3<double> eye{0.4, 1.2, -4.5};
    vec3<double> gaze{3, -5, 0}; // degrees

    Gala() {
        Rng rng(21);
        for (const char* name : {"camera", "bg", "pose", "0", "1", "6"})
            std::filesystem::create_directories(scene / name);
        std::filesystem::create_directories(model);
        std::vector<Matrix> world;
        std::vector<vec3<double>> joints;
        std::string parent_text, tpose, matrices;
        for (std::size_t j = 0; j < J; ++j) {
            parents.push_back(j == 0 ? -1 : static_cast<int>((j - 1) / 2));
            const mat3<double> Q = j == 0 ? mat3<double>(1.0) : unity_rotation(rng.vec(-60, 60));
            local.push_back(j == 0 ? vec3<double>(0.02, 0.9, 0.01) : rng.vec(-0.15, 0.15));
            const Matrix here = rigid(Q, local.back());
            world.push_back(j == 0 ? here : times(world[static_cast<std::size_t>(parents[j])], here));
            joints.push_back({world[j][0][3], world[j][1][3], world[j][2][3]});
            mat3<double> R;
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c)
                    R[c][r] = world[j][static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
            bind.push_back(rigid(transpose(R), -(transpose(R) * joints[j])));
            parent_text += std::to_string(parents[j]) + "\n";
            tpose += text(local.back()) + "\n0,0,0\n1,1,1\n";
            for (const auto& row : bind[j])
                matrices += number(row[0]) + "," + number(row[1]) + "," + number(row[2]) + "," + number(row[3]) + "\n";
        }
        std::string mesh;
        weights.assign(V * J, 0);
        for (std::size_t v = 0; v < V; ++v) {
            vertices.push_back(joints[v % J] + rng.vec(-0.1, 0.1));
            const std::size_t a = v % J, b = (v + 5) % J;
            weights[v * J + a] = 0.75, weights[v * J + b] = 0.25;
            mesh += text(vertices[v]) + "\n0,0,1\n0.5,0.25\n0.75,0.25,0,0\n" + std::to_string(a) + "," +
                    std::to_string(b) + ",0,0\n";
        }
        write_text(model / "jointParent.txt", parent_text);
        write_text(model / "tpose.txt", tpose);
        write_text(model / "tpose_mat.txt", matrices);
        write_text(model / "mesh.txt", mesh);
        write_array<float>(model / "weights.npy", std::vector<float>(weights.begin(), weights.end()), {V, J});

        const quat<double> q = quat_from_rotation(unity_rotation(gaze));
        for (const char* id : {"0", "1", "6"}) {
            write_text(scene / "camera" / (std::string(id) + ".txt"),
                             "40,32,24\n" + text(eye) + "\n" + number(q.x) + "," + number(q.y) + "," + number(q.z) +
                                 "," + number(q.w) + "\n1,1,1\n");
            write_png(scene / "bg" / (std::string(id) + ".png"), numbered_image(32, 24, id[0] - '0', 200));
        }
        for (int f = 0; f < frames; ++f) {
            std::string pose;
            for (int p = 0; p < people; ++p) {
                roots.push_back(vec3<double>(p, 0.9, 0) + rng.vec(-0.1, 0.1));
                for (std::size_t j = 0; j < J; ++j) {
                    degrees.push_back(rng.vec(-50, 50));
                    pose += text(j == 0 ? roots.back() : rng.vec()) + "\n" + text(degrees.back()) + "\n1,1,1\n";
                }
            }
            write_text(scene / "pose" / (padded(f) + ".txt"), pose);
            for (const char* id : {"0", "1", "6"}) {
                write_png(photo(id, f), numbered_image(32, 24, id[0] - '0', f));
                if (id[0] == '6') write_png(scene / id / (padded(f) + "_mask.png"), PixelImage(1, 24, 32));
            }
        }
    }
    static std::string number(double x) {
        std::ostringstream out;
        out.precision(17);
        out << x;
        return out.str();
    }
    static std::string text(const vec3<double>& v) { return number(v.x) + "," + number(v.y) + "," + number(v.z); }
    [[nodiscard]] std::filesystem::path photo(const std::string& id, int f) const {
        return scene / id / (padded(f) + ".png");
    }

    /// Posed vertices in the files' frame.
    [[nodiscard]] std::vector<vec3<double>> posed(int frame, int person) const {
        const std::size_t at = static_cast<std::size_t>(frame * people + person);
        std::vector<Matrix> world, skin;
        for (std::size_t j = 0; j < J; ++j) {
            const Matrix here = rigid(unity_rotation(degrees[at * J + j]), j == 0 ? roots[at] : local[j]);
            world.push_back(j == 0 ? here : times(world[static_cast<std::size_t>(parents[j])], here));
            skin.push_back(times(world[j], bind[j]));
        }
        std::vector<vec3<double>> result(V, vec3<double>(0));
        for (std::size_t v = 0; v < V; ++v)
            for (std::size_t j = 0; j < J; ++j) result[v] += transformed(skin[j], vertices[v]) * weights[v * J + j];
        return result;
    }
    /// A point in the frame of the files' camera: x right, y up, z forward.
    [[nodiscard]] vec2<double> pixel(const vec3<double>& x) const {
        const vec3<double> p = transpose(unity_rotation(gaze)) * (x - eye);
        const double f = 12 / std::tan(20 * std::numbers::pi / 180);
        return {16 + f * p.x / p.z, 12 - f * p.y / p.z};
    }
};

} // namespace gsh::test
