// SPDX-License-Identifier: Apache-2.0
/// @file  Reads JSON, bounded in depth, memory and time; and an object's fields, with their place in messages.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/format_version.hpp>
#include <gsh/io/file/input_file.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::detail {

using Json = nlohmann::ordered_json;

/// What JSON may ask for. A text of the largest size could otherwise take thirty times its size in memory.
struct JsonLimits {
    std::size_t depth = 64;                        ///< lists and objects in each other
    std::size_t containers = std::size_t(1) << 22; ///< lists and objects
    std::size_t values = std::size_t(1) << 24;     ///< numbers, texts and all others
};

/// Owns a value, and takes it apart without memory. nlohmann's own destructor allocates: without memory, a program
/// would end where a list or an object goes out of scope.
template <class Value = Json>
class OwnedJson {
public:
    OwnedJson() = default;
    explicit OwnedJson(Value value) noexcept : value_(std::move(value)) {}
    OwnedJson(const OwnedJson&) = delete;
    OwnedJson& operator=(const OwnedJson&) = delete;
    ~OwnedJson() { take_apart(value_); }

    [[nodiscard]] Value& operator*() { return value_; }
    [[nodiscard]] const Value& operator*() const { return value_; }
    [[nodiscard]] Value* operator->() { return &value_; }
    /// The value, which is not owned any more.
    [[nodiscard]] Value take() { return std::move(value_); }

private:
    Value value_;

    static void take_apart(Value& value) noexcept {
        if (auto* const list = value.template get_ptr<typename Value::array_t*>()) {
            for (Value& element : *list) take_apart(element);
            list->clear();
        } else if (auto* const object = value.template get_ptr<typename Value::object_t*>()) {
            for (auto& member : *object) take_apart(member.second);
            object->clear();
        }
    }
};

/// Parses JSON in a time that grows with its length, n log n where objects have many members.
///
/// Every reader of JSON calls this function or read_json: a value that is nested deeply exhausts the stack where it is
/// copied or written, and nlohmann::ordered_json looks for each key of an object among all keys before it.
///
/// Errors  IoError, beginning with `what`, for a text that is not JSON, a number beyond double, a key that an object
///         has twice, and for more than the limits allow.
template <class Value = Json>
[[nodiscard]] Value parse_json(std::string_view text, const std::string& what, const JsonLimits& limits = {});

/// Reads a file of at most 64 MiB; a thousand cameras take 1 MiB. `kind` is the name of a kind of gsh's own files, or
/// empty for those of other programs. An object may state it in format_member, which is left out of the result.
///
/// Errors  those of read_file, parse_json and check_format.
[[nodiscard]] inline Json read_json(const InputFile& input, std::string_view kind = {}) {
    const std::string text = read_file(input, std::size_t(1) << 26), name = input.name();
    OwnedJson<> json;
    try {
        *json = parse_json(text, name);
    } catch (const IoError&) {
        const std::string foreign = text.empty() ? "" : not_the_kind(input, "JSON", "json", "");
        if (!foreign.empty()) throw IoError(name + ": " + foreign);
        throw;
    }
    if (!json->is_object() || !json->contains(format_member)) return json.take();
    const Json& format = (*json)[format_member];
    if (!format.is_string())
        throw IoError(name + ": " + format_member + " is " + format.type_name() + ", expected text");
    check_format(name, format.get<std::string>(), kind, 1, 1);
    json->erase(format_member);
    return json.take();
}

/// A JSON object and its place in the file, for messages.
class JsonObject {
public:
    JsonObject(const Json& json, std::string where) : json_(json), where_(std::move(where)) {
        if (!json_.is_object()) throw IoError(where_ + " is " + json_.type_name() + ", expected an object");
    }
    [[nodiscard]] bool has(const char* field) const { return json_.contains(field) && !json_[field].is_null(); }
    [[nodiscard]] const Json& at(const char* field) const {
        if (!has(field)) throw IoError(where_ + ": " + field + " is missing");
        return json_[field];
    }
    [[nodiscard]] double number(const char* field) const {
        const Json& value = at(field);
        if (!value.is_number()) throw wrong(field, value, "a number");
        return finite(field, value.get<double>());
    }
    [[nodiscard]] int integer(const char* field) const { return integer(field, at(field)); }
    [[nodiscard]] bool boolean(const char* field) const {
        const Json& value = at(field);
        if (!value.is_boolean()) throw wrong(field, value, "true or false");
        return value.get<bool>();
    }
    [[nodiscard]] std::string text(const char* field) const {
        const Json& value = at(field);
        if (!value.is_string()) throw wrong(field, value, "text");
        return value.get<std::string>();
    }
    /// The numbers of a list, or of a list of rows.
    [[nodiscard]] std::vector<double> numbers(const char* field) const {
        std::vector<double> values;
        gather(field, at(field), values, 2);
        return values;
    }
    [[nodiscard]] std::vector<double> numbers(const char* field, std::size_t count) const {
        std::vector<double> values = numbers(field);
        if (values.size() != count)
            throw ShapeError(where_ + ": " + field + " has " + std::to_string(values.size()) + " numbers, expected " +
                             std::to_string(count));
        return values;
    }
    [[nodiscard]] std::vector<int> integers(const char* field) const {
        const Json& list = at(field);
        if (!list.is_array()) throw wrong(field, list, "a list of integers");
        std::vector<int> values;
        for (const Json& value : list) values.push_back(integer(field, value));
        return values;
    }
    [[nodiscard]] const std::string& where() const { return where_; }

    /// Throws IoError for an unknown field, which may be misspelt.
    void expect_only(std::initializer_list<std::string_view> known) const {
        for (const auto& item : json_.items()) {
            if (std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
            std::string all;
            for (const std::string_view field : known) all.append(all.empty() ? "" : ", ").append(field);
            throw IoError(where_ + ": holds the unknown field '" + shortened(item.key()) + "', expected " + all);
        }
    }

private:
    const Json& json_;
    std::string where_;

    [[nodiscard]] IoError wrong(const char* field, const Json& value, const char* expected) const {
        return IoError(where_ + ": " + field + " is " + value.type_name() + ", expected " + expected);
    }
    [[nodiscard]] double finite(const char* field, double value) const {
        check_value(std::isfinite(value), where_, std::string(field) + " is not finite");
        return value;
    }
    [[nodiscard]] int integer(const char* field, const Json& value) const {
        if (!value.is_number_integer()) throw wrong(field, value, "an integer");
        const double number = value.get<double>();
        check_value(std::abs(number) <= 2147483647, where_, std::string(field) + " is beyond 32 bits");
        return static_cast<int>(number);
    }
    void gather(const char* field, const Json& value, std::vector<double>& values, int levels) const {
        if (value.is_number()) {
            values.push_back(finite(field, value.get<double>()));
        } else if (value.is_array() && levels > 0) {
            for (const Json& element : value) gather(field, element, values, levels - 1);
        } else {
            throw wrong(field, value, "numbers");
        }
    }
};

// -------------------------------------------------------------------------------------------------------------

/// Builds a value from nlohmann's events. Members of an object are appended, and compared when the object ends.
template <class Value>
class JsonBuilder {
public:
    JsonBuilder(std::string_view text, const std::string& what, const JsonLimits& limits)
        : text_(text), what_(what), limits_(limits) {}

    [[nodiscard]] Value take() { return root_.take(); }

    bool null() { return add(Value()), true; }
    bool boolean(bool value) { return add(Value(value)), true; }
    bool number_integer(typename Value::number_integer_t value) { return add(Value(value)), true; }
    bool number_unsigned(typename Value::number_unsigned_t value) { return add(Value(value)), true; }
    bool number_float(typename Value::number_float_t value, const std::string&) { return add(Value(value)), true; }
    bool string(std::string& value) { return add(Value(std::move(value))), true; }
    bool binary(typename Value::binary_t&) { return false; } // not in JSON text
    bool start_object(std::size_t) { return open(Value::object()), true; }
    bool start_array(std::size_t) { return open(Value::array()), true; }
    bool key(std::string& key) {
        key_ = std::move(key);
        return true;
    }
    bool end_array() { return open_.pop_back(), true; }
    bool end_object() {
        if constexpr (is_ordered) check_keys(object());
        open_.pop_back();
        return true;
    }
    bool parse_error(std::size_t position, const std::string& token, const nlohmann::json::exception& error) {
        const std::string_view before = text_.substr(0, std::min(position, text_.size()));
        const auto line = 1 + std::count(before.begin(), before.end(), '\n');
        constexpr int out_of_range = 406;
        throw IoError(
            what_ +
            (error.id == out_of_range ? ": holds a number beyond the range of double" : ": is not JSON, or truncated") +
            ", in line " + std::to_string(line) +
            (token.empty() ? std::string(", at its end") : " at '" + shortened(token) + "'"));
    }

private:
    static constexpr bool is_ordered = std::is_same_v<Value, nlohmann::ordered_json>;
    using Object = typename Value::object_t;

    std::string_view text_;
    const std::string& what_;
    JsonLimits limits_;
    OwnedJson<Value> root_;
    std::vector<Value*> open_; // lists and objects, from the outermost; each is the last element of the one before
    std::string key_;
    std::size_t containers_ = 0, values_ = 0;

    [[nodiscard]] Object& object() { return open_.back()->template get_ref<Object&>(); }

    Value& add(Value value) {
        if (++values_ > limits_.values)
            throw IoError(what_ + ": holds more than " + std::to_string(limits_.values) +
                          " values, the most that is read");
        if (open_.empty()) return *root_ = std::move(value);
        if (open_.back()->is_array()) {
            auto& list = open_.back()->template get_ref<typename Value::array_t&>();
            return list.emplace_back(std::move(value));
        }
        if constexpr (is_ordered) {
            typename Object::Container& members = object(); // the map's own functions compare all keys
            if (members.size() == members.capacity()) grow(members);
            return members.emplace_back(std::move(key_), std::move(value)).second;
        } else {
            const auto [member, fresh] = object().emplace(std::move(key_), std::move(value));
            if (!fresh) fail_twice(member->first);
            return member->second;
        }
    }
    /// Makes room for more members, and moves the values. The vector itself would copy them, as a const key cannot be
    /// moved, and nlohmann's destructor of the old ones needs memory.
    template <class Members>
    static void grow(Members& members) {
        Members larger;
        larger.reserve(std::max<std::size_t>(4, 2 * members.size()));
        for (auto& member : members) larger.emplace_back(member.first, std::move(member.second));
        members.swap(larger);
    }
    void open(Value value) {
        if (open_.size() == limits_.depth)
            throw IoError(what_ + ": is JSON that is nested deeper than " + std::to_string(limits_.depth) + " levels");
        if (++containers_ > limits_.containers)
            throw IoError(what_ + ": holds more than " + std::to_string(limits_.containers) +
                          " lists and objects, the most that is read");
        open_.push_back(&add(std::move(value)));
    }
    void check_keys(const Object& members) const {
        std::vector<std::string_view> keys;
        keys.reserve(members.size());
        for (const auto& member : members) keys.emplace_back(member.first);
        std::sort(keys.begin(), keys.end());
        const auto twice = std::adjacent_find(keys.begin(), keys.end());
        if (twice != keys.end()) fail_twice(*twice);
    }
    [[noreturn]] void fail_twice(std::string_view key) const {
        throw IoError(what_ + ": an object has the member '" + shortened(key) + "' twice, expected each name once");
    }
};

template <class Value>
Value parse_json(std::string_view text, const std::string& what, const JsonLimits& limits) {
    JsonBuilder<Value> builder(text, what, limits);
    (void)Value::sax_parse(text.begin(), text.end(), &builder);
    return builder.take();
}

} // namespace gsh::detail
