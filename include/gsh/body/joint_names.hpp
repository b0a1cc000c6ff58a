// SPDX-License-Identifier: Apache-2.0
/// @file  Names of joints: those of the SMPL family, and the side and part that a rig's own name stands for.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_name_table.hpp>
#include <gsh/core/message.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <map>
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

/// The joint of SMPL-X on the other side, or the same in the middle.
[[nodiscard]] constexpr int mirrored_smplx_joint(int joint) {
    if (joint >= 25) return joint < 40 ? joint + 15 : joint - 15; // fingers
    for (const int left : {1, 4, 7, 10, 13, 16, 18, 20, 23})
        if (joint == left || joint == left + 1) return 2 * left + 1 - joint;
    return joint;
}

/// The names of a body's joints: for 22, 24, 52 and 55 joints those of SMPL, SMPL-H and SMPL-X, for others the model's
/// own, or joint_0, joint_1, …
[[nodiscard]] inline std::vector<std::string> joint_names_of(const BodyModel& model);

/// What a joint's name means, regardless of the program that wrote it: "mixamorig:LeftForeArm", "lowerarm_l" and
/// "J_Bip_L_LowerArm" have side 'l' and parts "forearm" and "lowerarm".
struct JointWords {
    char side = 0;    ///< 'l', 'r', or 0
    std::string part; ///< the other words, joined, lower case, numbers without leading zeros: "index1"
    /// The layer of a rig of Blender's Rigify: joints that deform (DEF-), those without a prefix, ORG-, and MCH-.
    enum class Layer { deforming, none, original, mechanical } layer = Layer::none;
};
[[nodiscard]] inline JointWords joint_words(std::string_view name);

/// The same for all joints of a rig. A word that most names share at their beginning or end is dropped ("Avatar_",
/// "_jnt", the ".001" of Blender's copies), and so are numbers at the ends of most names that count the nodes
/// ("Hips_01", "Spine1_03" of Sketchfab).
[[nodiscard]] inline std::vector<JointWords> joint_words(const std::vector<std::string>& names);

/// Up to `most` names, "and 12 more" after them.
[[nodiscard]] inline std::string list_of_names(const std::vector<std::string>& names, std::size_t most = 12);

/// `name`, or, if it is taken, `name` with "#2", "#3", … behind it, which joint_words ignores. It is added to `taken`,
/// which holds for each name the last number that was given to it, so that many equal names take no quadratic time.
[[nodiscard]] inline std::string unique_joint_name(const std::string& name, std::map<std::string, int>& taken);

/// The most bytes of a joint's name that readers accept. The time to find joints by their names grows with the square
/// of the number of a name's words.
inline constexpr std::size_t longest_joint_name = 256;

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
    for (const char* prefix : {"mixamorig", "bip", "j", "c", "def", "org", "mch", "valvebiped", "valve", "biped", "m",
                               "f", "avg", "cc", "base", "rl"})
        if (letters == prefix) return true;
    return false;
}

inline char side_of(const std::string& word) {
    return word == "l" || word == "left" ? 'l' : word == "r" || word == "right" ? 'r' : '\0';
}
inline bool is_number(std::string_view word) {
    return !word.empty() && word.find_first_not_of("0123456789") == std::string_view::npos;
}

/// The words of a name behind its namespace or path ("rig:", "Armature|"), without prefixes of known programs.
struct NameWords {
    std::vector<std::string> words;
    JointWords::Layer layer = JointWords::Layer::none;

    explicit NameWords(std::string_view name) {
        if (const auto mark = name.rfind('#'); mark != std::string_view::npos && is_number(name.substr(mark + 1)))
            name = name.substr(0, mark); // of unique_joint_name
        if (const auto sign = name.find_last_of(":|/"); sign != std::string_view::npos) name.remove_prefix(sign + 1);
        words = words_of(name);
        while (words.size() > 1 && is_rig_prefix(words.front())) {
            if (words.front() == "def") layer = JointWords::Layer::deforming;
            if (words.front() == "org") layer = JointWords::Layer::original;
            if (words.front() == "mch") layer = JointWords::Layer::mechanical;
            words.erase(words.begin());
        }
        // The middle: Root_M of Advanced Skeleton, head.x of Auto-Rig Pro
        if (words.size() > 1 && (words.back() == "m" || words.back() == "x")) words.pop_back();
    }
    [[nodiscard]] JointWords joined() const;
};

inline JointWords NameWords::joined() const {
    std::vector<std::string> rest = words;
    JointWords result;
    result.layer = layer;
    for (auto word = rest.begin(); word != rest.end() && rest.size() > 1; ++word)
        if ((result.side = side_of(*word)) != 0) {
            rest.erase(word);
            break;
        }
    std::string text;
    for (const auto& word : rest) text += word;
    if (text.starts_with("mixamorig")) text.erase(0, 9); // "mixamorigLeftArm" of three.js has no separator
    for (const auto& [word, side] : {std::pair{"left", 'l'}, std::pair{"right", 'r'}}) // "leftupperarm"
        if (result.side == 0 && text.starts_with(word) && text.size() > std::string_view(word).size()) {
            result.side = side;
            text.erase(0, std::string_view(word).size());
        }
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    const bool finger = text.starts_with("finger"); // of Biped, whose Finger01 is another than Finger1
    for (std::size_t i = 0; i < text.size(); ++i) {
        const bool in_number = !result.part.empty() && is_digit(result.part.back());
        if (!finger && text[i] == '0' && !in_number && i + 1 < text.size() && is_digit(text[i + 1])) continue;
        result.part.push_back(text[i]);
    }
    // "lhip", "rfemur": one word with a side, if that leaves the name of a joint
    if (result.side == 0 && (result.part.starts_with("l") || result.part.starts_with("r")) &&
        is_known_part(std::string_view(result.part).substr(1), true)) {
        result.side = result.part[0];
        result.part.erase(0, 1);
    }
    return result;
}

/// Drops words that most names of a rig share.
class SharedWords {
public:
    explicit SharedWords(std::vector<NameWords>& names) : names_(names) {
        while (drop_first()) {
        }
        while (drop_last()) {
        }
    }

private:
    std::vector<NameWords>& names_;
    std::map<std::string, std::size_t> counts_;

    /// Whether so many names are most of a rig's. The nodes of meshes and scenes share nothing with its joints.
    [[nodiscard]] bool is_most(std::size_t count) const { return count >= 8 && 10 * count >= 6 * names_.size(); }

    /// The word that most names have at a place, unless it is a side or a joint; "" if there is none.
    template <class WordOf>
    std::string shared(const WordOf& word_of) {
        counts_.clear();
        for (const NameWords& name : names_)
            if (name.words.size() > 1) ++counts_[word_of(name)];
        for (const auto& [word, count] : counts_)
            if (is_most(count) && side_of(word) == 0 && !is_known_part(word, false)) return word;
        return {};
    }
    bool drop_first() {
        const std::string word = shared([](const NameWords& name) { return name.words.front(); });
        for (NameWords& name : names_)
            if (!word.empty() && name.words.size() > 1 && name.words.front() == word)
                name.words.erase(name.words.begin());
        return !word.empty();
    }
    bool drop_last() {
        const std::string word = shared([](const NameWords& name) { return name.words.back(); });
        std::size_t numbers = 0;
        for (const auto& [last, count] : counts_) numbers += is_number(last) ? count : 0;
        std::size_t different = 0;
        for (const auto& [last, count] : counts_) different += is_number(last);
        const bool counted = is_most(numbers) && 10 * different >= 8 * numbers; // a number for each node
        for (NameWords& name : names_)
            if (name.words.size() > 1 && (counted ? is_number(name.words.back()) : name.words.back() == word))
                name.words.pop_back();
        return counted || !word.empty() || drop_copy_number();
    }
    /// Blender's ".001" behind the names of a copy, after a program that left out the point: "LeftArm001".
    bool drop_copy_number() {
        const auto ending = [](const std::string& word) {
            const bool numbered = word.size() > 3 && is_number(std::string_view(word).substr(word.size() - 3));
            return numbered ? word.substr(word.size() - 3) : std::string();
        };
        std::map<std::string, std::size_t> counts;
        for (const NameWords& name : names_)
            if (!name.words.empty()) ++counts[ending(name.words.back())];
        for (const auto& [number, count] : counts) {
            if (number.empty() || !is_most(count)) continue;
            for (NameWords& name : names_)
                if (!name.words.empty() && ending(name.words.back()) == number)
                    name.words.back().resize(name.words.back().size() - 3);
            return true;
        }
        return false;
    }
};

} // namespace detail

inline JointWords joint_words(std::string_view name) {
    return detail::NameWords(name).joined();
}

inline std::vector<JointWords> joint_words(const std::vector<std::string>& names) {
    std::vector<detail::NameWords> words(names.begin(), names.end());
    const detail::SharedWords dropped(words);
    std::vector<JointWords> result;
    for (const detail::NameWords& name : words) result.push_back(name.joined());
    return result;
}

inline std::string list_of_names(const std::vector<std::string>& names, std::size_t most) {
    return detail::listed(names, "", most);
}

inline std::string unique_joint_name(const std::string& name, std::map<std::string, int>& taken) {
    const auto [first, is_new] = taken.emplace(name, 1);
    std::string result = name;
    for (bool found = is_new; !found; found = taken.emplace(result, 1).second)
        result = name + "#" + std::to_string(++first->second);
    return result;
}

} // namespace gsh
