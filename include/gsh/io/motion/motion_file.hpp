// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes motions as .npz files: split by body part as in SMPL-X programs, or whole as in AMASS.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_options.hpp>
#include <gsh/io/motion/motion_table.hpp>
#include <gsh/io/motion/up_warning.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads a motion for a body.
///
/// Split files  global_orient [T, 3], body_pose [T, 3 n], transl [T, 3], betas [S]; optionally jaw_pose, leye_pose,
///              reye_pose [T, 3], left_hand_pose, right_hand_pose [T, 45] or [T, C] PCA coefficients (left out, with a
///              warning, where the body has no components), expression [T, E].
/// Whole files  poses [T, 3 J], trans [T, 3], betas. Files for 22, 24, 52 or 55 joints can be used for bodies of any of
///              these: the common joints are read.
/// Time         timestamps [T], or a rate under one of frame_rate_keys: io/motion/frame_rate.hpp.
/// Units        axis-angle in radians, metres, seconds.
/// Errors       IoError, ShapeError, ValueError naming file and key. Probable mistakes are added to `warnings`: missing
///              or unused parts, degrees, a mean hand that is missing or was added twice.
[[nodiscard]] inline Motion load_motion(const InputFile& input, const BodyModel& model,
                                        const MotionFileOptions& options = {},
                                        std::vector<std::string>* warnings = nullptr);

/// Writes a motion in double precision, atomically: split for 55 joints, whole otherwise. load_motion restores it.
inline void save_motion(const std::filesystem::path& path, const Motion& motion);

/// A warning about implausible hand poses, or an empty text. `mean_added` states whether the mean hand was added.
[[nodiscard]] inline std::string hand_mean_warning(const BodyModel& model, const Motion& motion, bool mean_added);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Reads a motion part by part into the joints of a body, from an NpzReader or a MotionTable.
template <class Source>
class MotionReader {
public:
    MotionReader(Source source, const BodyModel& model, const MotionFileOptions& options,
                 std::vector<std::string>* warnings)
        : file_(std::move(source)), model_(model), options_(options), warnings_(warnings),
          joints_(model.joint_count()) {}

    [[nodiscard]] Motion read() {
        const bool split = file_.has_array("global_orient") || !file_.has_array("poses");
        motion_.joint_count = joints_;
        motion_.expression_count = static_cast<std::size_t>(model_.expression_count);
        split ? read_split() : read_whole();
        read_betas();
        read_expression();
        read_timestamps();
        if (has_hands()) {
            const bool add = adds_mean(split);
            if (add) add_mean_hands();
            warn(hand_mean_warning(model_, motion_, add));
        }
        warn_of_degrees();
        turn_upright(model_, motion_, options_, file_.path().string(), warnings_);
        validate(motion_, model_, file_.path().string());
        return std::move(motion_);
    }

private:
    Source file_;
    const BodyModel& model_;
    const MotionFileOptions& options_;
    std::vector<std::string>* warnings_;
    std::size_t joints_;
    std::size_t frames_ = 0;
    Motion motion_;

    [[nodiscard]] bool has_hands() const { return joints_ == 55 || joints_ == 52; }
    [[nodiscard]] std::size_t left_hand() const { return joints_ == 55 ? 25 : 22; }

    void warn(const std::string& text) {
        if (warnings_ && !text.empty()) warnings_->push_back(file_.path().string() + ": " + text);
    }

    /// The numbers of every frame, [T, any width]; the first call determines T.
    NpyArray<double> read_frames(std::string_view key, std::size_t width = 0) {
        const Shape shape = file_.header(key).shape;
        std::size_t found = 1;
        for (std::size_t axis = 1; axis < shape.size(); ++axis) found *= shape[axis];
        const auto expected = [&](std::size_t frames) {
            return "has shape " + shape_text(shape) + ", expected (" + (frames ? std::to_string(frames) : "*") + ", " +
                   (width ? std::to_string(width) : "*") + ")";
        };
        if (shape.empty() || (width && found != width)) throw ShapeError(file_.name_of(key) + " " + expected(frames_));
        if (frames_ == 0) frames_ = shape[0];
        check_value(frames_ > 0, file_.name_of(key), "holds no frames");
        if (shape[0] != frames_)
            throw ShapeError(file_.name_of(key) + " " + expected(frames_) + "; all parts must hold the same frames");
        NpyArray<double> array = file_.template read<double>(key);
        array.shape = {frames_, found};
        return array;
    }

    /// Copies joints [from, from + count) of each frame of `array` to joints [to, to + count).
    void place(const NpyArray<double>& array, std::size_t from, std::size_t to, std::size_t count) {
        const std::size_t width = array.dim(1);
        for (std::size_t t = 0; t < frames_; ++t)
            for (std::size_t k = 0; k < count; ++k) {
                const double* v = &array.data[t * width + 3 * (from + k)];
                motion_.pose[t * joints_ + to + k] = {v[0], v[1], v[2]};
            }
    }
    void start(const NpyArray<double>& orient) {
        motion_.pose.assign(frames_ * joints_, vec3<double>(0));
        place(orient, 0, 0, 1);
    }
    void read_transl(std::initializer_list<const char*> names) {
        for (const char* name : names)
            if (file_.has(name) || name == *(names.end() - 1)) {
                const auto array = read_frames(name, 3);
                for (std::size_t t = 0; t < frames_; ++t)
                    motion_.transl.emplace_back(array[3 * t], array[3 * t + 1], array[3 * t + 2]);
                return;
            }
    }

    void read_split() {
        start(read_frames("global_orient", 3));
        const auto body = read_frames("body_pose");
        const std::size_t found = body.dim(1) / 3;
        const bool smpl_family = joints_ == 22 || joints_ == 24 || joints_ == 52 || joints_ == 55;
        const std::size_t own = joints_ - 1, common = std::min<std::size_t>(own, 21);
        if (body.dim(1) % 3 == 0 && smpl_family && (found == 21 || found == 23)) {
            place(body, 0, 1, found == own ? own : common);
            if (found == 23 && joints_ != 24) warn("body_pose is SMPL's, its last two joints (hands) are left out");
            if (found == 21 && joints_ == 24) warn("body_pose lacks SMPL's last two joints (hands), taken as zero");
        } else {
            if (body.dim(1) != 3 * own || smpl_family)
                throw ShapeError(file_.name_of("body_pose") + " has " + std::to_string(body.dim(1)) +
                                 " numbers a frame, expected " +
                                 std::to_string(smpl_family ? 3 * (joints_ == 24 ? 23 : 21) : 3 * own) +
                                 " for a body of " + std::to_string(joints_) + " joints");
            place(body, 0, 1, own);
        }
        if (joints_ == 55) {
            read_joint("jaw_pose", 22);
            read_joint("leye_pose", 23);
            read_joint("reye_pose", 24);
        }
        if (has_hands()) {
            read_hand("left_hand_pose", left_hand(), model_.hands_components_left);
            read_hand("right_hand_pose", left_hand() + 15, model_.hands_components_right);
        }
        read_transl({"trans", "transl"});
    }

    void read_joint(const char* key, std::size_t joint) {
        if (file_.has(key))
            place(read_frames(key, 3), 0, joint, 1);
        else
            warn(std::string(key) + " is missing, taken as zero");
    }

    void read_hand(const char* key, std::size_t joint, const std::vector<double>& components) {
        if (!file_.has(key)) return warn(std::string(key) + " is missing, taken as zero");
        const auto hand = read_frames(key);
        const std::size_t width = hand.dim(1);
        if (width == 45) return place(hand, 0, joint, 15);
        if (components.empty() && width < 45) { // zero components are the mean hand, also of a body without components
            if (std::any_of(hand.data.begin(), hand.data.end(), [](double x) { return x != 0; }))
                warn(std::string(key) + " holds " + std::to_string(width) +
                     " principal components, but the body model has none; the hand stays as the mean hand");
            return;
        }
        if (45 * width > components.size())
            throw ShapeError(file_.name_of(key) + " has " + std::to_string(width) +
                             " numbers a frame, expected 45, or PCA coefficients for the " +
                             std::to_string(components.size() / 45) + " hand components of the body model");
        NpyArray<double> full{{frames_, 45}, std::vector<double>(frames_ * 45, 0.0)};
        for (std::size_t t = 0; t < frames_; ++t)
            for (std::size_t c = 0; c < width; ++c)
                for (std::size_t k = 0; k < 45; ++k)
                    full.data[t * 45 + k] += hand[t * width + c] * components[c * 45 + k];
        place(full, 0, joint, 15);
    }

    void read_whole() {
        const auto poses = read_frames("poses");
        const std::size_t found = poses.dim(1) / 3;
        const auto known = [](std::size_t count) { return count == 22 || count == 24 || count == 52 || count == 55; };
        if (poses.dim(1) % 3 != 0 || (found != joints_ && !(known(found) && known(joints_))))
            throw ShapeError(file_.name_of("poses") + " has " + std::to_string(poses.dim(1)) +
                             " numbers a frame, expected " + std::to_string(3 * joints_) + " for a body of " +
                             std::to_string(joints_) + " joints");
        start(poses);
        if (found == joints_) {
            place(poses, 0, 0, joints_);
        } else {
            warn("poses hold " + std::to_string(found) + " joints, the body has " + std::to_string(joints_) +
                 "; the common ones are taken, the others stay zero");
            place(poses, 0, 0, std::min<std::size_t>(22, joints_));
            if (has_hands() && found >= 52) place(poses, found == 55 ? 25 : 22, left_hand(), 30);
        }
        read_transl({"transl", "trans"});
    }

    void read_betas() {
        auto betas = file_.template read<double>("betas");
        const std::size_t rows = betas.shape.size() > 1 ? betas.dim(0) : 1,
                          own = static_cast<std::size_t>(model_.shape_count);
        if (betas.shape.empty() || betas.shape.size() > 2 || rows == 0)
            throw ShapeError(file_.name_of("betas") + " has shape " + shape_text(betas.shape) +
                             ", expected (*,): one shape for all frames");
        const std::size_t count = betas.size() / rows;
        for (std::size_t i = count; i < betas.size(); ++i)
            if (betas[i] != betas[i % count]) {
                warn("betas change from frame to frame; those of the first are taken");
                break;
            }
        if (count > own)
            warn("betas hold " + std::to_string(count) + " coefficients, the body has " + std::to_string(own) +
                 "; the rest is left out");
        motion_.betas.assign(betas.data.begin(),
                             betas.data.begin() + static_cast<std::ptrdiff_t>(std::min(count, own)));
        motion_.betas.resize(own, 0.0);
    }

    void read_expression() {
        const std::size_t own = motion_.expression_count;
        motion_.expression.assign(frames_ * own, 0.0);
        if (!file_.has_array("expression")) return;
        const auto expression = read_frames("expression");
        const std::size_t count = expression.dim(1);
        if (count > own)
            warn("expression holds " + std::to_string(count) + " coefficients, the body has " + std::to_string(own) +
                 "; the rest is left out");
        for (std::size_t t = 0; t < frames_; ++t)
            for (std::size_t k = 0; k < std::min(own, count); ++k)
                motion_.expression[t * own + k] = expression[t * count + k];
    }

    void read_timestamps() {
        motion_.timestamps =
            frame_times(frames_, stated_time(file_, frames_), options_.rates(), file_.path().string(), warnings_);
    }

    [[nodiscard]] bool adds_mean(bool split) const {
        if (options_.hands != MotionFileOptions::Hands::automatic)
            return options_.hands == MotionFileOptions::Hands::add_mean;
        for (const char* key : {"flat_hand", "flat_hand_mean"})
            if (file_.has_array(key)) return file_.template read_number<int>(key) == 0;
        return split;
    }
    void add_mean_hands() {
        for (std::size_t t = 0; t < frames_; ++t) {
            vec3<double>* hand = &motion_.pose[t * joints_ + left_hand()];
            for (std::size_t k = 0; k < model_.hands_mean_left.size(); ++k) hand[k] += model_.hands_mean_left[k];
            for (std::size_t k = 0; k < model_.hands_mean_right.size(); ++k) hand[15 + k] += model_.hands_mean_right[k];
        }
    }
    void warn_of_degrees() {
        double largest = 0;
        for (const auto& v : motion_.pose) largest = std::max(largest, length(v));
        if (largest > 12.6) // two turns
            warn("a joint turns by " + detail::number_text(largest) + " rad; are the angles in degrees?");
    }
};

} // namespace detail

inline Motion load_motion(const InputFile& input, const BodyModel& model, const MotionFileOptions& options,
                          std::vector<std::string>* warnings) {
    NpzReader file(input);
    detail::check_first_version(file, "motion");
    return detail::MotionReader<NpzReader>(std::move(file), model, options, warnings).read();
}

inline std::string hand_mean_warning(const BodyModel& model, const Motion& motion, bool mean_added) {
    const std::size_t J = motion.joint_count, T = motion.frame_count();
    if ((J != 55 && J != 52) || T == 0) return {};
    // The average hand as a multiple of the model's mean hand: about 1 for relaxed hands.
    const std::size_t first = J == 55 ? 25 : 22;
    double along = 0, norm = 0;
    const auto add = [&](const std::vector<vec3<double>>& mean, std::size_t start) {
        for (std::size_t k = 0; k < mean.size(); ++k) {
            norm += dot(mean[k], mean[k]);
            for (std::size_t t = 0; t < T; ++t)
                along += dot(motion.pose[t * J + start + k], mean[k]) / static_cast<double>(T);
        }
    };
    add(model.hands_mean_left, first);
    add(model.hands_mean_right, first + 15);
    if (!(norm > 1e-6)) return {};
    const double ratio = along / norm;
    if (mean_added && ratio > 1.6)
        return "the hands look as if the mean hand was added twice; the file probably holds whole hand poses: say "
               "flat_hand";
    if (!mean_added && ratio < 0.4)
        return "the hands look flat, as if the mean hand was left out; the file probably counts from the mean hand: do "
               "not say flat_hand";
    return {};
}

inline void save_motion(const std::filesystem::path& path, const Motion& motion) {
    const std::size_t T = motion.frame_count(), J = motion.joint_count, E = motion.expression_count;
    check_size("save_motion", "pose", motion.pose.size(), T * J, "store one axis-angle vector per frame and joint");
    check_size("save_motion", "expression", motion.expression.size(), T * E, "store one row per frame");
    check_size("save_motion", "timestamps", motion.timestamps.size(), T, "store one per frame");
    NpzWriter file(path);
    const auto add = [&](const char* key, std::size_t first, std::size_t count) {
        std::vector<double> rows;
        for (std::size_t t = 0; t < T; ++t)
            for (std::size_t j = first; j < first + count; ++j)
                for (int axis = 0; axis < 3; ++axis) rows.push_back(motion.pose[t * J + j][axis]);
        file.add(key, rows, {T, 3 * count});
    };
    file.add("betas", motion.betas);
    if (E > 0) file.add("expression", motion.expression, {T, E});
    if (J == 55) {
        add("global_orient", 0, 1);
        add("body_pose", 1, 21);
        add("jaw_pose", 22, 1);
        add("leye_pose", 23, 1);
        add("reye_pose", 24, 1);
        add("left_hand_pose", 25, 15);
        add("right_hand_pose", 40, 15);
    } else {
        add("poses", 0, J);
    }
    file.add<double>("transl", {T ? &motion.transl[0].x : nullptr, 3 * T}, {T, 3});
    file.add("timestamps", motion.timestamps);
    file.add("flat_hand", std::uint8_t(1)); // a Motion holds complete hand poses
    file.commit();
}

} // namespace gsh
