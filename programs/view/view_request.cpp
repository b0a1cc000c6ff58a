// SPDX-License-Identifier: Apache-2.0
#include "view/view_request.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/json_file.hpp>

#include <cmath>
#include <initializer_list>
#include <string>

namespace gsh::programs {

namespace {

using Json = nlohmann::json;

Json parse(std::string_view text) {
    try {
        return detail::parse_json<Json>(text, "request", {.depth = 8});
    } catch (const IoError& error) { // no file is at fault
        throw ValueError(error.what());
    }
}

/// A value of the request with its name, for messages.
class Field {
public:
    Field(const Json& value, std::string name) : value_(&value), name_(std::move(name)) {}

    [[nodiscard]] Field operator[](const char* member) const {
        check_value(value_->is_object(), name_, "is " + found() + ", expected an object");
        const auto at = value_->find(member);
        check_value(at != value_->end(), inner(member), "is missing");
        return {*at, inner(member)};
    }
    /// Throws unless all members of an object are among the known ones.
    void only(std::initializer_list<std::string_view> known) const {
        check_value(value_->is_object(), name_, "is " + found() + ", expected an object");
        for (const auto& [key, value] : value_->items()) {
            bool is_known = false;
            for (const std::string_view name : known) is_known = is_known || key == name;
            check_value(is_known, name_, "has an unknown member '" + detail::shortened(key) + "'");
        }
    }
    [[nodiscard]] double number() const {
        constexpr double limit = 1e6;
        check_value(value_->is_number(), name_, "is " + found() + ", expected a number");
        const double number = value_->get<double>();
        check_value(std::isfinite(number) && std::abs(number) <= limit, name_,
                    "is " + detail::number_text(number) + ", expected a number within 1000000");
        return number;
    }
    [[nodiscard]] int pixels() const {
        const double value = number();
        check_value(value >= 16 && value <= largest_view && value == std::floor(value), name_,
                    "is " + detail::number_text(value) + ", expected whole pixels from 16 to " +
                        std::to_string(largest_view));
        return static_cast<int>(value);
    }
    [[nodiscard]] bool flag() const {
        check_value(value_->is_boolean(), name_, "is " + found() + ", expected true or false");
        return value_->get<bool>();
    }
    /// Whether a text is the second of two choices.
    [[nodiscard]] bool second_of(const char* first, const char* second) const {
        const bool is_second = value_->is_string() && *value_ == second;
        check_value(is_second || (value_->is_string() && *value_ == first), name_,
                    "is " + found() + ", expected '" + first + "' or '" + second + "'");
        return is_second;
    }
    [[nodiscard]] std::vector<Field> list(std::size_t count) const {
        check_value(value_->is_array(), name_, "is " + found() + ", expected a list");
        check_value(value_->size() == count, name_,
                    "has " + std::to_string(value_->size()) + " elements, expected " + std::to_string(count));
        std::vector<Field> fields;
        for (std::size_t i = 0; i < count; ++i)
            fields.emplace_back((*value_)[i], name_ + '[' + std::to_string(i) + ']');
        return fields;
    }
    [[nodiscard]] std::vector<double> numbers(std::size_t count) const {
        std::vector<double> result;
        for (const Field& field : list(count)) result.push_back(field.number());
        return result;
    }
    [[nodiscard]] vec3<double> vector() const {
        const auto v = numbers(3);
        return {v[0], v[1], v[2]};
    }

private:
    [[nodiscard]] std::string found() const {
        return value_->is_string() ? "'" + detail::shortened(value_->get<std::string>()) + "'" : value_->type_name();
    }
    [[nodiscard]] std::string inner(const char* member) const {
        return name_ == "request" ? member : name_ + '.' + member;
    }

    const Json* value_;
    std::string name_;
};

Camera<double> camera_of(const Field& field) {
    field.only({"size", "focal", "centre", "R", "t"});
    const auto size = field["size"].list(2), focal = field["focal"].list(2), centre = field["centre"].list(2);
    const std::vector<double> R = field["R"].numbers(9);
    Camera<double> camera;
    camera.width = size[0].pixels(), camera.height = size[1].pixels();
    camera.fx = focal[0].number(), camera.fy = focal[1].number();
    camera.cx = centre[0].number(), camera.cy = centre[1].number();
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            camera.R[column][row] = R[static_cast<std::size_t>(3 * row + column)];
    camera.t = field["t"].vector();
    check_camera("request", "camera", camera);
    return camera;
}

Motion person_of(const Field& field, const PersonSize& size) {
    field.only({"pose", "betas", "expression", "transl"});
    Motion motion;
    motion.joint_count = size.joints;
    motion.expression_count = size.expressions;
    for (std::size_t j = 0; const double x : field["pose"].numbers(3 * size.joints)) {
        if (j % 3 == 0) motion.pose.emplace_back(0);
        motion.pose.back()[static_cast<int>(j++ % 3)] = x;
    }
    motion.betas = field["betas"].numbers(size.betas);
    motion.expression = field["expression"].numbers(size.expressions);
    motion.transl.push_back(field["transl"].vector());
    motion.timestamps.push_back(0);
    return motion;
}

} // namespace

ViewRequest parse_view_request(std::string_view text, const std::vector<PersonSize>& people) {
    const Json json = parse(text);
    const Field request(json, "request");
    request.only({"camera", "background", "show", "shadows", "light_turn", "format", "people"});
    ViewRequest result;
    result.camera = camera_of(request["camera"]);
    result.background = vec3<float>(request["background"].vector());
    for (int c = 0; c < 3; ++c)
        check_value(result.background[c] >= 0 && result.background[c] <= 1, "background",
                    "has the number " + gsh::detail::number_text(double(result.background[c])) + ", expected 0 to 1");
    if (request["show"].second_of("splats", "ellipsoids")) result.show = ViewRequest::Show::ellipsoids;
    result.shadows = request["shadows"].flag();
    result.light_turn = request["light_turn"].number();
    result.lossless = request["format"].second_of("jpeg", "png");
    const auto fields = request["people"].list(people.size());
    for (std::size_t p = 0; p < people.size(); ++p) result.people.push_back(person_of(fields[p], people[p]));
    return result;
}

} // namespace gsh::programs
