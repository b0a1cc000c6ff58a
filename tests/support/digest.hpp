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
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/splat/still_splats.hpp>
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
    template <class T>
    void add(const T& value) {
        if constexpr (std::is_same_v<T, std::filesystem::path>) {
            add(value.string());
        } else if constexpr (std::ranges::range<T>) {
            bytes_ += std::to_string(std::ranges::distance(value)) + ":";
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
    void add(const ColmapImage& v) { all(v.name, v.camera); }
    void add(const ColmapScene& v) { all(v.images, v.points, v.colors); }
};

} // namespace gsh::test
