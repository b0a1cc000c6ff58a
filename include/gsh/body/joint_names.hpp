// SPDX-License-Identifier: Apache-2.0
/// @file  Names of joints: those of the SMPL family, and the side and part that a rig's own name stands for.
#pragma once

#include <gsh/body/body_model.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// The joints of SMPL-X in its order. The first 22 are those of SMPL and SMPL-H.
inline constexpr std::array<std::string_view, 55> smplx_joint_names = {
    "pelvis",       "left_hip",      "right_hip",     "spine1",         "left_knee",    "right_knee",   "spine2",
    "left_ankle",   "right_ankle",   "spine3",        "left_foot",      "right_foot",   "neck",         "left_collar",
    "right_collar", "head",          "left_shoulder", "right_shoulder", "left_elbow",   "right_elbow",  "left_wrist",
    "right_wrist",  "jaw",           "left_eye",      "right_eye",      "left_index1",  "left_index2",  "left_index3",
    "left_middle1", "left_middle2",  "left_middle3",  "left_pinky1",    "left_pinky2",  "left_pinky3",  "left_ring1",
    "left_ring2",   "left_ring3",    "left_thumb1",   "left_thumb2",    "left_thumb3",  "right_index1", "right_index2",
    "right_index3", "right_middle1", "right_middle2", "right_middle3",  "right_pinky1", "right_pinky2", "right_pinky3",
    "right_ring1",  "right_ring2",   "right_ring3",   "right_thumb1",   "right_thumb2", "right_thumb3"};

/// The number of a joint of SMPL-X, or -1.
[[nodiscard]] inline int smplx_joint(std::string_view name);

/// The names of a body's joints: for 22, 24, 52 and 55 joints those of SMPL, SMPL-H and SMPL-X, for others the model's
/// own, or joint_0, joint_1, …
[[nodiscard]] inline std::vector<std::string> joint_names_of(const BodyModel& model);

/// What a joint's name means, regardless of the program that wrote it: "mixamorig:LeftForeArm", "lowerarm_l" and
/// "J_Bip_L_LowerArm" have side 'l' and parts "forearm" and "lowerarm".
struct JointWords {
    char side = 0;    ///< 'l', 'r', or 0
    std::string part; ///< the other words, joined, lower case, numbers without leading zeros: "index1"
};
[[nodiscard]] inline JointWords joint_words(std::string_view name);

// -------------------------------------------------------------------------------------------------------------

inline int smplx_joint(std::string_view name) {
    const auto found = std::find(smplx_joint_names.begin(), smplx_joint_names.end(), name);
    return found == smplx_joint_names.end() ? -1 : static_cast<int>(found - smplx_joint_names.begin());
}

inline std::vector<std::string> joint_names_of(const BodyModel& model) {
    const std::size_t J = model.joint_count();
    std::vector<std::string> names;
    if (J == 22 || J == 24 || J == 52 || J == 55)
        for (std::size_t j = 0; j < J; ++j)
            names.emplace_back(J == 24 && j >= 22   ? (j == 22 ? "left_hand" : "right_hand")
                               : J == 52 && j >= 22 ? smplx_joint_names[j + 3]
                                                    : smplx_joint_names[j]);
    else if (model.joint_names.size() == J)
        names = model.joint_names;
    else
        for (std::size_t j = 0; j < J; ++j) names.push_back("joint_" + std::to_string(j));
    return names;
}

namespace detail {

/// Splits at characters that are neither letters nor digits, and before a capital that begins a word: "LHipJoint" is
/// L, Hip, Joint. Words are in lower case.
inline std::vector<std::string> words_of(std::string_view name) {
    const auto is = [](int (*kind)(int), char c) { return kind(static_cast<unsigned char>(c)) != 0; };
    std::vector<std::string> words;
    for (std::size_t i = 0; i < name.size(); ++i) {
        if (!is(std::isalnum, name[i])) continue;
        const bool after_break = i == 0 || !is(std::isalnum, name[i - 1]);
        const bool capital = is(std::isupper, name[i]) && i > 0 &&
                             (!is(std::isupper, name[i - 1]) || (i + 1 < name.size() && is(std::islower, name[i + 1])));
        if (after_break || capital) words.emplace_back();
        words.back().push_back(static_cast<char>(std::tolower(static_cast<unsigned char>(name[i]))));
    }
    return words;
}

/// Whether a word, with or without a number at its end, is a prefix that programs put before all names.
inline bool is_rig_prefix(const std::string& word) {
    const std::string letters = word.substr(0, word.find_last_not_of("0123456789") + 1);
    for (const char* prefix : {"mixamorig", "bip", "j", "c", "def", "org", "valvebiped", "valve", "biped"})
        if (letters == prefix) return true;
    return false;
}

} // namespace detail

inline JointWords joint_words(std::string_view name) {
    if (const auto colon = name.rfind(':'); colon != std::string_view::npos) name.remove_prefix(colon + 1);
    std::vector<std::string> words = detail::words_of(name);
    while (words.size() > 1 && detail::is_rig_prefix(words.front())) words.erase(words.begin());
    JointWords result;
    const auto side_of = [](const std::string& word) {
        return word == "l" || word == "left" ? 'l' : word == "r" || word == "right" ? 'r' : '\0';
    };
    for (auto word = words.begin(); word != words.end() && words.size() > 1; ++word)
        if ((result.side = side_of(*word)) != 0) {
            words.erase(word);
            break;
        }
    std::string joined;
    for (const auto& word : words) joined += word;
    if (joined.starts_with("mixamorig")) joined.erase(0, 9); // "mixamorigLeftArm" of three.js has no separator
    for (const auto& [word, side] : {std::pair{"left", 'l'}, std::pair{"right", 'r'}}) // "leftupperarm"
        if (result.side == 0 && joined.starts_with(word) && joined.size() > std::string_view(word).size()) {
            result.side = side;
            joined.erase(0, std::string_view(word).size());
        }
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    for (std::size_t i = 0; i < joined.size(); ++i) {
        const bool in_number = !result.part.empty() && is_digit(result.part.back());
        if (joined[i] == '0' && !in_number && i + 1 < joined.size() && is_digit(joined[i + 1])) continue; // leading
        result.part.push_back(joined[i]);
    }
    return result;
}

} // namespace gsh
