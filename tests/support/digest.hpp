// SPDX-License-Identifier: Apache-2.0
/// @file  The bytes of what a reader returns, so that tests can compare two readings of any kind.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/capture/colmap_image.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>
#include <gsh/io/model/configuration_file.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/loss/lpips_network.hpp>
#include <gsh/prior/estimated_view.hpp>
#include <gsh/prior/prior_view.hpp>

#include <filesystem>
#include <optional>
#include <ranges>
#include <string>
#include <type_traits>
#include <utility>

namespace gsh::test {

/// Collects the numbers and texts of values. Equal values have equal digests.
class Digest {
public:
    template <class... Values>
    [[nodiscard]] static std::string of(const Values&... values) {
        Digest digest;
        (digest.add(values), ...);
        return std::move(digest.bytes_);
    }

private:
    std::string bytes_;

    template <class... Values>
    void all(const Values&... values) {
        (add(values), ...);
    }
    /// A number, or a vector or matrix of GLM.
    template <class T>
    static constexpr bool is_numeric = std::is_arithmetic_v<T> || requires { typename T::length_type; };

    template <class T>
    void add(const T& value) {
        if constexpr (std::is_same_v<T, std::filesystem::path>) {
            add(value.string());
        } else if constexpr (std::ranges::range<T>) {
            bytes_ += std::to_string(std::ranges::distance(value)) + ":";
            if constexpr (std::ranges::contiguous_range<T> && is_numeric<std::ranges::range_value_t<T>>)
                bytes_.append(reinterpret_cast<const char*>(std::ranges::data(value)),
                              std::ranges::size(value) * sizeof(std::ranges::range_value_t<T>)); // one by one is slow
            else
                for (const auto& element : value) add(element);
        } else {
            static_assert(std::is_trivially_copyable_v<T>);
            bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
        }
    }
    template <class A, class B>
    void add(const std::pair<A, B>& pair) {
        all(pair.first, pair.second);
    }
    template <class T>
    void add(const std::optional<T>& value) {
        bytes_ += value ? "+" : "-";
        if (value) add(*value);
    }
    template <class T>
    void add(const Image<T>& v) {
        all(v.channels, v.height, v.width, v.data);
    }
    void add(const BodyModel& v) {
        all(v.v_template, v.shapedirs, v.exprdirs, v.posedirs, v.weights, v.parents, v.faces, v.joint_names);
    }
    void add(const Motion& v) { all(v.betas, v.pose, v.expression, v.transl, v.timestamps); }
    void add(const RigMotion& v) {
        all(v.names, v.parents, v.rest_joints, v.rest_rotations, v.joints, v.rotations, v.timestamps);
    }
    void add(const GaussianCloud<float>& v) {
        all(v.sh_degree, v.means, v.quats, v.log_scales, v.opacity_logits, v.sh);
    }
    void add(const AvatarData& v) { all(v.rig.body, v.rig.betas, v.gaussians, v.ao, v.normal_offsets); }
    void add(const StillSplats& v) { all(v.cloud, v.warnings); }
    void add(const PriorMap& v) { all(v.values, v.mask); }
    void add(const EstimatedView& v) { all(v.name, v.view.map); }
    void add(const PixelImage& v) { all(v.channels, v.height, v.width, v.data); }
    void add(const EstimatedPriors& v) { all(v.depths, v.normals); }
    void add(const Camera<double>& v) { all(v.width, v.height, v.fx, v.fy, v.cx, v.cy, v.R, v.t); }
    void add(const NamedCamera& v) { all(v.name, v.role, v.camera); }
    void add(const CameraList& v) { all(v.cameras, v.fps, v.test_frames); }
    void add(const PhotoKeypoints& v) { all(v.camera, v.frame, v.people.size()); }
    void add(const Detections& v) { all(v.cameras, v.times, v.keypoints, v.masks); }
    void add(const JointMap& v) { add(v.named); }
    void add(const RegionLists& v) { all(v.face, v.left_hand, v.right_hand, v.high, v.importance); }
    template <class T>
    void add(const NpyArray<T>& v) {
        all(v.shape, v.data);
    }
    void add(const gsh::detail::Json& v) { add(v.dump()); }
    void add(const Configuration& v) { add(settings_of(v)); }
    void add(const LpipsConvolution& v) { all(v.weight, v.bias); }
    void add(const LpipsNetwork& v) { all(v.name, v.convolutions, v.lins); }
    void add(const MakeHumanOffset& v) { all(v.vertex, v.offset); }
    void add(const MakeHumanData& v) {
        all(v.mesh.vertices, v.mesh.vt, v.mesh.groups, v.surface.faces, v.skeleton.parents, v.targets, v.expressions);
    }
    void add(const StoredMask& v) { all(v.values, v.orientation, v.levels.colors, v.levels.unit); }
    void add(const StraightImage& v) { all(v.image, v.camera); }
    void add(const Capture& v) { all(v.name, v.cameras, v.motion, v.images, v.backgrounds, v.test_frames, v.floor_y); }
    void add(const CapturePerson& v) { all(v.name, v.motion, v.masks); }
    void add(const AnyCapture& v) { all(v.capture, v.people); }
    void add(const PeopleCapture& v) { all(v.any, v.people); }
    void add(const ColmapImage& v) { all(v.name, v.camera); }
    void add(const ColmapScene& v) { all(v.images, v.points, v.colors); }
};

} // namespace gsh::test
