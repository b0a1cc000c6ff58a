// SPDX-License-Identifier: Apache-2.0
/// @file  Reads EasyMocap's results: bodies as JSON, a list of people per frame.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>
#include <gsh/io/motion/smplx_json_file.hpp>
#include <gsh/io/motion/up_warning.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Reads FOLDER/NUMBER.json, each a list of people (or {"annots": list}) with id, Rh [3], Th [3], poses, shapes [10],
/// and optionally expression, handl, handr. options.person is the id; it is not needed if there is only one person.
///
/// poses holds 72 numbers (SMPL), 78 (SMPL+H: 66, then 6 principal components per hand), 87 (SMPL-X: 66, two hands of
/// 6, then jaw and eyes), 156 or 165 (all joints), 66 (the body alone), or three fewer: without the root, which is Rh.
/// Principal components are relative to the mean hand; hands given by all joints are not. handl and handr are the hands
/// where poses has none. They count, as expression does, if the first frame has them; later frames must then have them,
/// too, and otherwise theirs are left out with a warning.
///
/// Frame   EasyMocap rotates the posed body about the origin, x = Rh body + Th. The SMPL family rotates it about the
///         root's rest position J₀. Hence transl = Th + Rh J₀ - J₀, with J₀ of this body, shape and expression.
/// Units   timestamps are NUMBER / fps (30 without options.fps, with a warning).
/// Errors  IoError, ShapeError, ValueError naming file and field; also for a person who is missing in a frame.
[[nodiscard]] inline Motion load_easymocap_motion(const std::filesystem::path& folder, const BodyModel& model,
                                                  const MotionFileOptions& options = {},
                                                  std::vector<std::string>* warnings = nullptr);

/// The folder of a person's poses in a folder that EasyMocap has filled: a capture, or the folder that was given to its
/// program as --out. Its quick start leaves them in output/smpl/smpl and output/smplx/smpl; smpl_full beside it holds
/// the same with whole hands. Empty if there is none.
[[nodiscard]] inline std::filesystem::path easymocap_pose_folder(const std::filesystem::path& folder);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A person of one frame.
struct EasyMocapPerson {
    std::vector<double> Rh, Th, poses, shapes, expression, handl, handr;
};

inline EasyMocapPerson read_easymocap_person(const InputFile& input, int person) {
    const Json json = read_json(input);
    const Json& list = json.is_array() ? json : JsonObject(json, input.name()).at("annots");
    if (!list.is_array()) throw IoError(input.name() + ": holds no list of people");
    if (list.empty()) throw IoError(input.name() + ": holds no person in this frame; leave it and its photographs out");
    std::vector<std::string> known;
    for (std::size_t i = 0; i < list.size(); ++i) {
        const JsonObject object(list[i], input.name() + ": [" + std::to_string(i) + "]");
        const int id = object.has("id")         ? object.integer("id")
                       : object.has("personID") ? object.integer("personID")
                                                : static_cast<int>(i);
        known.push_back(std::to_string(id));
        if (id != person && list.size() > 1) continue;
        const auto optional = [&](const char* field) {
            return object.has(field) ? object.numbers(field) : std::vector<double>();
        };
        return {optional("Rh"),         object.numbers("Th", 3), object.numbers("poses"), object.numbers("shapes"),
                optional("expression"), optional("handl"),       optional("handr")};
    }
    throw IoError(input.name() + ": person " + std::to_string(person) + " is missing, there are " +
                  listed(known, "none") + "; choose a person who is in every frame, or leave out the other frames");
}

/// A part of the numbers of `poses`, and its name in SMPL-X programs.
struct EasyMocapPart {
    const char* key;
    std::size_t first, count;
};

/// How the numbers of `poses` are divided; empty for a width that is not known.
inline std::vector<EasyMocapPart> easymocap_parts(std::size_t width) {
    struct Layout {
        std::size_t width; ///< with the root
        std::size_t body, hand;
        bool hands_first, face; ///< the face follows the hands in 87, and precedes them in 165
    };
    for (const Layout& l : {Layout{66, 63, 0, true, false},
                            {72, 69, 0, true, false},
                            {78, 63, 6, true, false},
                            {87, 63, 6, true, true},
                            {156, 63, 45, true, false},
                            {165, 63, 45, false, true}}) {
        if (width != l.width && width + 3 != l.width) continue;
        std::vector<EasyMocapPart> parts;
        std::size_t next = 0;
        const auto add = [&](const char* key, std::size_t count) {
            if (count > 0) parts.push_back({key, next, count});
            next += count;
        };
        const auto add_hands = [&] { add("left_hand_pose", l.hand), add("right_hand_pose", l.hand); };
        if (width == l.width) add("global_orient", 3);
        add("body_pose", l.body);
        if (l.hands_first) add_hands();
        if (l.face) add("jaw_pose", 3), add("leye_pose", 3), add("reye_pose", 3);
        if (!l.hands_first) add_hands();
        return parts;
    }
    return {};
}

/// The rows of all frames, by the names of SMPL-X programs.
class EasyMocapColumns {
public:
    void add(const std::string& key, const double* row, std::size_t count) {
        Column& column = columns_[key];
        column.numbers.insert(column.numbers.end(), row, row + count);
        column.width = count;
    }
    [[nodiscard]] bool has(const std::string& key) const { return columns_.contains(key); }
    void fill(MotionTable& table, std::size_t frames) {
        for (auto& [key, column] : columns_) table.add(key, key, std::move(column.numbers), {frames, column.width});
    }

private:
    struct Column {
        std::vector<double> numbers;
        std::size_t width = 0;
    };
    std::map<std::string, Column> columns_;
};

} // namespace detail

inline Motion load_easymocap_motion(const std::filesystem::path& folder, const BodyModel& model,
                                    const MotionFileOptions& options, std::vector<std::string>* warnings) {
    const auto files = detail::list_numbered(folder, ".json");
    if (files.empty()) throw IoError(folder.string() + ": holds no files NUMBER.json, expected one per frame");
    const std::size_t T = files.size();
    /// A field beside `poses`.
    struct Field {
        const char *name, *key;
        const std::vector<double> detail::EasyMocapPerson::* numbers;
        bool taken = false;              ///< the first frame has it, and poses does not
        std::size_t width = 0, late = 0; ///< of the first frame; frames that have it although the first has not
    };
    Field fields[] = {{"handl", "left_hand_pose", &detail::EasyMocapPerson::handl},
                      {"handr", "right_hand_pose", &detail::EasyMocapPerson::handr},
                      {"expression", "expression", &detail::EasyMocapPerson::expression}};
    detail::EasyMocapColumns columns;
    std::vector<detail::EasyMocapPart> parts;
    std::vector<double> numbers, Rh, Th, shapes;
    std::size_t width = 0, shape_count = 0;
    bool whole_hands = false;
    for (std::size_t t = 0; t < T; ++t) {
        const std::string where = files[t].path.string();
        const detail::EasyMocapPerson p = detail::read_easymocap_person(files[t].path, options.person);
        const auto expect = [&](const char* field, std::size_t found, std::size_t expected) {
            if (found != expected)
                throw ShapeError(where + ": " + field + " has " + std::to_string(found) + " numbers, expected " +
                                 std::to_string(expected) + " as in the first frame");
        };
        if (t == 0) {
            width = p.poses.size(), shape_count = p.shapes.size();
            parts = detail::easymocap_parts(width);
            if (parts.empty())
                throw ShapeError(where + ": poses has " + std::to_string(width) +
                                 " numbers, expected 72 (SMPL), 78 or 156 (SMPL+H), 87 or 165 (SMPL-X), 66 (the body), "
                                 "or three fewer without the root");
            for (const auto& part : parts)
                whole_hands = whole_hands || (part.count == 45 && part.key == std::string("left_hand_pose"));
        }
        expect("poses", p.poses.size(), width);
        expect("shapes", p.shapes.size(), shape_count);
        const std::vector<double> no_turn(3, 0.0);
        if (parts[0].key != std::string("global_orient")) columns.add("global_orient", no_turn.data(), 3);
        for (const auto& part : parts) columns.add(part.key, &p.poses[part.first], part.count);
        for (Field& field : fields) {
            const std::vector<double>& given = p.*field.numbers;
            if (t == 0) field.taken = !given.empty() && !columns.has(field.key), field.width = given.size();
            if (field.taken) {
                expect(field.name, given.size(), field.width);
                columns.add(field.key, given.data(), given.size());
            } else if (!given.empty() && !columns.has(field.key)) {
                ++field.late;
            }
        }
        const std::vector<double>& turn = p.Rh.empty() ? no_turn : p.Rh;
        if (turn.size() != 3)
            throw ShapeError(where + ": Rh has " + std::to_string(turn.size()) + " numbers, expected 3");
        Rh.insert(Rh.end(), turn.begin(), turn.end());
        Th.insert(Th.end(), p.Th.begin(), p.Th.end());
        shapes.insert(shapes.end(), p.shapes.begin(), p.shapes.end());
        numbers.push_back(static_cast<double>(files[t].number));
    }
    for (const Field& field : fields)
        if (field.late > 0 && warnings)
            warnings->push_back(folder.string() + ": " + field.name + " is in " + std::to_string(field.late) +
                                " frames, but not in the first, " + files[0].path.filename().string() +
                                ", and is left out");

    MotionTable table(folder);
    columns.fill(table, T);
    table.add("transl", "Th", std::vector<double>(3 * T, 0.0), {T, 3});
    table.add("betas", "shapes", std::move(shapes), {T, shape_count});
    table.add(detail::frame_numbers_key, "the numbers of its files", std::move(numbers), {T});
    table.add("flat_hand", "flat_hand", std::vector<double>{whole_hands ? 1.0 : 0.0}, {});
    MotionFileOptions as_stored = options;
    as_stored.world = MotionFileOptions::World::as_stored; // the change of world follows move_frame
    Motion motion = detail::MotionReader<MotionTable>(std::move(table), model, as_stored, warnings).read();
    for (std::size_t t = 0; t < T; ++t)
        move_frame(model, motion, t,
                   {rotation_from_axis_angle(vec3<double>(Rh[3 * t], Rh[3 * t + 1], Rh[3 * t + 2])),
                    vec3<double>(Th[3 * t], Th[3 * t + 1], Th[3 * t + 2])});
    detail::turn_upright(model, motion, options, folder.string(), warnings);
    validate(motion, model, folder.string());
    return motion;
}

inline std::filesystem::path easymocap_pose_folder(const std::filesystem::path& folder) {
    std::error_code ignored;
    std::vector<std::filesystem::path> programs; // the folders that --out has named
    for (const auto& above : {folder / "output", folder})
        for (const char* model : {"smplx", "smplh", "smpl"}) programs.push_back(above / model);
    programs.insert(programs.end(), {folder / "output", folder});
    for (const std::filesystem::path& program : programs)
        for (const char* inner : {"smplx", "smplh", "smpl", "smpl_full", ""}) {
            const auto candidate = *inner ? program / inner : program;
            if (std::filesystem::is_directory(candidate, ignored) && !detail::list_numbered(candidate, ".json").empty())
                return candidate;
        }
    return {};
}

} // namespace gsh
