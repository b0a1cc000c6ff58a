// SPDX-License-Identifier: Apache-2.0
/// @file  Chooses the frames of a glTF animation, so that its curves are kept between them.
#pragma once

#include <gsh/body/rig_motion.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/gltf_channel.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::detail {

/// Frames are joined by turns about a fixed axis, so they must be dense where an animation's curves are not such turns.
///
/// Rate   that of the keys if all channels together have even keys, 10 a second or more. Else the first of 30, 24, 25,
///        60, 50, 48, 100 and 120 a second at which every key is a frame; else the least multiple of an even rate from
///        30 on; else 30. It is multiplied until rotations between frames are off by at most 0.25 degrees, up to 120 a
///        second.
/// Errors IoError for an animation that is too long, or has too many frames for the bytes of its file.
class GltfFrameTimes {
public:
    /// `joints` are posed in every frame; the file's buffers have `held_bytes`.
    GltfFrameTimes(const GltfFile& file, const GltfNodes::Channels& channels, std::size_t joints,
                   std::size_t held_bytes)
        : channels_(channels) {
        constexpr double close = 0.25, fastest = 120; // degrees; frames a second
        collect_keys();
        base_ = base_rate();
        if (duration() * std::max(base_, fastest) > 16e6)
            file.fail("lasts " + number_text(duration()) + " s, more than is read");
        const std::size_t frames =
            on_keys_ ? keys_.size() : static_cast<std::size_t>(std::floor(duration() * base_)) + 1;
        check_rig_size(file.name(), joints, frames); // two keys may be hours apart
        check_claimed_poses(file.name(), joints, frames, held_bytes);
        const double room =
            static_cast<double>(std::max<std::uint64_t>(unquestioned_memory, most_inflation * held_bytes)) /
            (48.0 * static_cast<double>(joints) * static_cast<double>(frames));
        const auto most =
            static_cast<std::size_t>(std::max(1.0, std::floor(std::min(fastest / std::max(base_, 1.0) + 1e-6, room))));
        for (std::size_t factor = 1;;) {
            make_times(factor_ = factor);
            error_ = largest_error();
            if (error_ <= close || factor == most) return;
            // Errors of curves fall with the square of the rate.
            const double wanted = std::ceil(static_cast<double>(factor) * std::sqrt(error_ / close));
            factor = std::clamp(static_cast<std::size_t>(wanted), factor + 1, most);
        }
    }
    /// Seconds, of every frame.
    [[nodiscard]] const std::vector<double>& times() const { return times_; }
    /// Frames from one key to the next; 0 where frames do not follow the keys.
    [[nodiscard]] std::size_t frames_a_key() const { return on_keys_ ? factor_ : 0; }
    /// How far rotations are off between frames, in degrees; steps do not count.
    [[nodiscard]] double error() const { return error_; }

private:
    const GltfNodes::Channels& channels_;
    std::vector<double> keys_, times_;
    double base_ = 30, error_ = 0;
    std::size_t factor_ = 1; ///< frames of the base rate are divided into as many
    bool on_keys_ = false;   ///< every key is a frame, and frames between keys are evenly spaced

    static constexpr double same_ = 1e-4; // seconds; files round differently

    [[nodiscard]] double duration() const { return keys_.back() - keys_.front(); }

    /// The times of the keys of all channels; of times that are the same, the last, so that no step is missed.
    void collect_keys() {
        std::vector<double> all;
        const std::vector<double>* last = nullptr;
        for (const auto& [node, channels] : channels_)
            for (const GltfChannel* channel : {&channels.rotation, &channels.translation, &channels.scale}) {
                if (last && *last == channel->times()) continue; // as most channels are
                last = &channel->times();
                all.insert(all.end(), last->begin(), last->end());
            }
        std::sort(all.begin(), all.end());
        double first = 0; // of the times that are the same
        for (const double time : all)
            if (!keys_.empty() && time - first < same_)
                keys_.back() = time;
            else
                keys_.push_back(first = time);
    }
    [[nodiscard]] double base_rate() {
        if (keys_.size() == 1) return on_keys_ = true, 30;
        const double step = duration() / static_cast<double>(keys_.size() - 1);
        bool even = true;
        for (std::size_t k = 0; k < keys_.size(); ++k)
            even = even && std::abs(keys_[k] - keys_[0] - static_cast<double>(k) * step) <= 0.05 * step + same_;
        if (even && step < 1 / 9.9) return on_keys_ = true, 1 / step; // the frames that a program has written
        for (const double rate : {30, 24, 25, 60, 50, 48, 100, 120}) {
            const auto is_frame = [&](double key) {
                const double frame = (key - keys_[0]) * rate;
                return std::abs(frame - std::round(frame)) <= 0.01 + same_ * rate;
            };
            if (std::all_of(keys_.begin(), keys_.end(), is_frame)) return rate;
        }
        return even ? std::ceil(30 * step - 1e-6) / step : 30;
    }
    void make_times(std::size_t factor) {
        times_.clear();
        if (on_keys_) {
            for (std::size_t k = 0; k + 1 < keys_.size(); ++k)
                for (std::size_t part = 0; part < factor; ++part)
                    times_.push_back(keys_[k] + (keys_[k + 1] - keys_[k]) * static_cast<double>(part) /
                                                    static_cast<double>(factor));
            times_.push_back(keys_.back());
            return;
        }
        const double rate = base_ * static_cast<double>(factor);
        std::size_t key = 0;
        for (double t = 0; t <= duration() + 0.001; t = static_cast<double>(times_.size()) / rate) {
            const double time = keys_[0] + t, near = 0.01 / rate + same_;
            while (key < keys_.size() && keys_[key] < time - near) ++key;
            const bool at_key = key < keys_.size() && keys_[key] <= time + near;
            times_.push_back(at_key ? keys_[key] : time);
        }
    }
    /// Between frames, rotations are compared at the middle and at the keys.
    [[nodiscard]] double largest_error() const {
        double largest = 0;
        for (const auto& [node, channels] : channels_) {
            const GltfChannel& channel = channels.rotation;
            if (channel.empty() || channel.is_step()) continue;
            std::vector<double> places = between_frames(channel.times());
            if (channel.is_cubic())
                for (std::size_t t = 0; t + 1 < times_.size(); ++t) places.push_back((times_[t] + times_[t + 1]) / 2);
            for (const double time : places) largest = std::max(largest, error_at(channel, time));
        }
        return largest;
    }
    [[nodiscard]] std::vector<double> between_frames(const std::vector<double>& keys) const {
        std::vector<double> result;
        std::size_t t = 0;
        for (const double key : keys) {
            while (t < times_.size() && times_[t] < key - same_) ++t;
            if (t > 0 && t < times_.size() && times_[t] > key + same_) result.push_back(key);
        }
        return result;
    }
    [[nodiscard]] double error_at(const GltfChannel& channel, double time) const {
        const auto after = std::upper_bound(times_.begin(), times_.end(), time);
        if (after == times_.begin() || after == times_.end()) return 0;
        const double a = *(after - 1), b = *after;
        const mat3<double> joined =
            GltfTransform::rotation_of(GltfChannel::turn(channel.at(a), channel.at(b), (time - a) / (b - a)));
        const mat3<double> off = transpose(joined) * GltfTransform::rotation_of(channel.at(time));
        return gsh::length(axis_angle_from_rotation(off)) * 57.295779513082323;
    }
};

} // namespace gsh::detail
