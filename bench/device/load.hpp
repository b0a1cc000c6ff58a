// SPDX-License-Identifier: Apache-2.0
/// @file  Loads of the device benches that host code makes: files, and an avatar with photographs of it.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/setup/canonical_setup.hpp>
#include <gsh/setup/configuration.hpp>

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::bench {

/// The Gaussians of a .ply file, also as splats with the colours of one view, and cameras.
struct CloudLoad {
    GaussianCloud<float> cloud;
    std::vector<vec3<float>> means, colors;
    std::vector<sym3<float>> covariances;
    std::vector<float> opacities;
    std::map<std::string, std::vector<Camera<float>>> cameras; ///< by the size of their images, "540"

    [[nodiscard]] SplatView<const float> view() const { return {means, covariances, opacities, colors}; }
};

/// Reads a .ply file of 3D Gaussian splatting, and a JSON list of cameras with width, height, fx, fy, cx, cy and
/// world_to_camera [4, 4]. Colours of splats are those of the first camera's direction.
/// Errors  IoError, ValueError: a file that is missing or not of this kind.
[[nodiscard]] CloudLoad read_cloud_load(const std::string& ply, const std::string& cameras);

/// Writes both files, with colours that are the same from all directions. Values of the camera file that
/// read_cloud_load ignores are for other programs.
/// Errors  IoError.
void write_cloud_load(const std::string& ply, const std::string& cameras, const SplatView<const float>& splats,
                      const std::vector<Camera<float>>& views);

enum class AvatarKind { plain, pose_directions, light };

/// The actor, of about 10,475 vertices as SMPL-X, with Gaussians of random attributes on its surface. With pose
/// directions, random ones, 9 for each joint but the root; with light, 4 points and 12 directions.
[[nodiscard]] AvatarData make_avatar_load(std::size_t gaussians, AvatarKind kind);

/// The built-in actor at the start of a training: in 12 poses, photographed by 8 cameras.
struct TrainingLoad {
    Configuration configuration;
    CanonicalSetup setup;
    std::optional<LightData> light;
    std::vector<std::vector<std::uint8_t>> pixels; // of the photographs
    std::vector<Photo> photos;
};
[[nodiscard]] TrainingLoad make_training_load(const Configuration& configuration, std::size_t gaussians, int size);

} // namespace gsh::bench
