// SPDX-License-Identifier: Apache-2.0
/// @file  A motion's arrays under the names of SMPL-X programs, collected from files with other names.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/npy.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Has the reading interface of NpzReader. A reader of a foreign format fills a table with global_orient, body_pose, …,
/// or with poses; the motion is then assembled as from our own files.
class MotionTable {
public:
    /// `path` is the prefix of messages.
    explicit MotionTable(std::filesystem::path path) : path_(std::move(path)) {}

    /// `name` is the array's name in the file.
    void add(std::string key, std::string name, NpyArray<double> array) {
        check_size(path_.string(), name, array.size(), detail::element_count(array.shape), "the shape says so");
        columns_[std::move(key)] = {std::move(name), std::move(array)};
    }
    void add(std::string key, std::string name, std::vector<double> data, Shape shape) {
        add(std::move(key), std::move(name), NpyArray<double>{std::move(shape), std::move(data)});
    }

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] bool has(std::string_view key) const { return columns_.find(key) != columns_.end(); }
    [[nodiscard]] bool has_array(std::string_view key) const { return has(key); }
    [[nodiscard]] std::string name_of(std::string_view key) const {
        const auto column = columns_.find(key);
        return path_.string() + ": " + (column == columns_.end() ? std::string(key) : column->second.name);
    }
    [[nodiscard]] NpyHeader header(std::string_view key) const {
        NpyHeader header;
        header.kind = 'f', header.width = sizeof(double), header.shape = at(key).shape;
        return header;
    }
    template <class T>
    [[nodiscard]] NpyArray<T> read(std::string_view key, Numbers = Numbers::same_kind) const {
        const NpyArray<double>& array = at(key);
        return {array.shape, std::vector<T>(array.data.begin(), array.data.end())};
    }
    template <class T>
    [[nodiscard]] NpyArray<T> read(std::string_view key, std::initializer_list<std::int64_t> pattern,
                                   Numbers = Numbers::same_kind) const {
        detail::check_shape(name_of(key), at(key).shape, Span<const std::int64_t>(pattern.begin(), pattern.size()));
        return read<T>(key);
    }
    template <class T>
    [[nodiscard]] T read_number(std::string_view key, Numbers = Numbers::same_kind) const {
        check_size(path_.string(), key, at(key).size(), 1, "expected a single number");
        return static_cast<T>(at(key).data[0]);
    }

private:
    struct Column {
        std::string name;
        NpyArray<double> array;
    };
    std::filesystem::path path_;
    std::map<std::string, Column, std::less<>> columns_;

    [[nodiscard]] const NpyArray<double>& at(std::string_view key) const {
        const auto column = columns_.find(key);
        if (column == columns_.end()) throw IoError(path_.string() + ": " + std::string(key) + " is missing");
        return column->second.array;
    }
};

} // namespace gsh
