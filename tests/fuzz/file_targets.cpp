// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include <gsh/io/file/archive.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/file/safetensors.hpp>
#include <gsh/io/model/configuration_file.hpp>
#include <gsh/io/model/lpips_file.hpp>

#include <cmath>
#include <cstdint>

namespace gsh::fuzz {

namespace {

template <class T>
void check_numbers(const NpyArray<T>& array) {
    must(array.data.size() == detail::element_count(array.shape), "an array's size is not that of its shape");
    for (const T value : array.data)
        must(std::isfinite(static_cast<double>(value)), "an array holds what is not finite");
}

/// Calls read(), where gsh's errors are expected: a dtype that does not fit is none of the file's faults.
template <class Read>
void attempt(const Read& read) {
    try {
        read();
    } catch (const Error&) {
    }
}

const Registered npy_target("npy", "a.npy", [](const InputFile& file) {
    attempt([&] { check_numbers(read_npy<float>(file, Numbers::any)); });
    attempt([&] { check_numbers(read_npy<std::int32_t>(file)); });
    const NpyArray<double> array = read_npy<double>(file);
    check_numbers(array);
    must_come_back(
        "array.npy", array,
        [](const auto& path, const NpyArray<double>& value) { write_npy<double>(path, value.data, value.shape); },
        [](const auto& path) { return read_npy<double>(path); });
});

const Registered npz_target("npz", "a.npz", [](const InputFile& file) {
    attempt([&] { (void)archive_kind(file); });
    const NpzReader archive(file);
    for (const std::string& key : archive.keys()) {
        if (!archive.has_array(key)) continue;
        if (archive.header(key).is_text())
            (void)archive.read_texts(key);
        else
            check_numbers(archive.read<double>(key, Numbers::any));
    }
});

const Registered safetensors_target("safetensors", "a.safetensors", [](const InputFile& file) {
    const SafetensorsReader tensors(file);
    for (const std::string& key : tensors.keys()) attempt([&] { check_numbers(tensors.read<float>(key)); });
});

const Registered json_target("json", "a.json", [](const InputFile& file) {
    const detail::Json value = detail::read_json(file);
    must(detail::parse_json(value.dump(), "again") == value, "JSON that is written and read again differs");
});

const Registered configuration_target("configuration", "a.json", [](const InputFile& file) {
    const Configuration read = read_configuration(file);
    const StaticModelParams scene = find_static_configuration("static", 100);
    must(!read.name.empty() && scene.sh_degree >= 0, "a configuration has no name");
});

void read_network(const InputFile& file) {
    (void)read_lpips(file);
}
const Registered lpips_target("lpips", "a.safetensors", read_network);
const Registered lpips_npz_target("lpips-npz", "a.npz", read_network);

} // namespace

} // namespace gsh::fuzz
