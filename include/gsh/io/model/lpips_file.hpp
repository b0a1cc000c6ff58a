// SPDX-License-Identifier: Apache-2.0
/// @file  Reads LPIPS weights from a .safetensors or .npz file with PyTorch's names.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/safetensors.hpp>
#include <gsh/loss/lpips_network.hpp>

#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads AlexNet or VGG16, which is determined by the file's first convolution.
///
/// Names, with any prefix before a dot: features.N.weight and .bias (torchvision), or sliceK.N.weight and .bias
/// (lpips); linK.model.1.weight or lins.K.model.1.weight (lpips), or simply linK.weight or linK. Other tensors, such as
/// torchvision's classifier, are not read. docs/components/lpips.md has five lines of Python that write such a file.
///
/// Errors  IoError for a file that is missing, damaged, or lacks a tensor; ShapeError for a shape of neither network;
///         ValueError for NaN.
[[nodiscard]] inline LpipsNetwork read_lpips(const InputFile& input);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The name that ends in one of `endings`; earlier endings take precedence. Throws IoError if two names have the same
/// ending, or if no name matches.
inline std::string find_tensor(const std::vector<std::string>& keys, const std::vector<std::string>& endings,
                               const std::string& file) {
    for (const std::string& ending : endings) {
        std::string found;
        for (const std::string& key : keys) {
            if (key == ending) return key;
            if (!key.ends_with("." + ending)) continue;
            if (!found.empty())
                throw IoError(file + ": both " + shortened(found) + " and " + shortened(key) + " could be " + ending +
                              "; keep one network in the file");
            found = key;
        }
        if (!found.empty()) return found;
    }
    std::string wanted;
    for (const std::string& ending : endings) wanted += (wanted.empty() ? "" : " or ") + ending;
    throw IoError(file + ": " + wanted + " is missing; the file holds: " + listed(keys, "no arrays") +
                  "; docs/components/lpips.md says how to export the weights");
}

/// Possible names of features.`number`; `slice` counts the compared layers from 1.
inline std::vector<std::string> lpips_convolution_names(int number, std::size_t slice, const std::string& what) {
    const std::string tail = std::to_string(number) + "." + what;
    return {"features." + tail, "slice" + std::to_string(slice) + "." + tail};
}

template <class Reader>
LpipsNetwork read_lpips_tensors(const Reader& file) {
    const std::vector<std::string> keys = file.keys();
    const std::string path = file.path().string();
    const std::string first = find_tensor(keys, lpips_convolution_names(0, 1, "weight"), path);
    const Shape shape = file.header(first).shape;
    LpipsNetwork network;
    if (shape == Shape{64, 3, 11, 11})
        network = lpips_alexnet();
    else if (shape == Shape{64, 3, 3, 3})
        network = lpips_vgg16();
    else
        throw ShapeError(file.name_of(first) + " has shape " + shape_text(shape) +
                         ", expected (64, 3, 11, 11) of AlexNet or (64, 3, 3, 3) of VGG16");

    std::int64_t inputs = 3;
    for (const LpipsStep& step : network.steps) {
        const std::size_t slice = network.lins.size();
        if (step.is_convolution()) {
            const auto named = [&](const char* what) {
                return find_tensor(keys, lpips_convolution_names(step.number, slice + 1, what), path);
            };
            network.convolutions.push_back(
                {file.template read<float>(named("weight"), {step.channels, inputs, step.kernel, step.kernel}).data,
                 file.template read<float>(named("bias"), {step.channels}).data});
            inputs = step.channels;
        }
        if (!step.compared) continue;
        const std::string k = std::to_string(slice), lin = "lin" + k;
        const std::string name = find_tensor(
            keys,
            {lin + ".model.1.weight", "lins." + k + ".model.1.weight", lin + ".model.0.weight", lin + ".weight", lin},
            path);
        const Shape found = file.header(name).shape; // (1, C, 1, 1) of a convolution, or with axes of length 1 removed
        std::size_t longest = 1, count = 1;
        for (const std::size_t length : found) longest = std::max(longest, length);
        if (!checked_bytes(found, 1, count) || count != longest || count != std::size_t(inputs))
            throw ShapeError(file.name_of(name) + " has shape " + shape_text(found) + ", expected (1, " +
                             std::to_string(inputs) + ", 1, 1)");
        network.lins.push_back(file.template read<float>(name).data);
    }
    return network;
}

} // namespace detail

inline LpipsNetwork read_lpips(const InputFile& input) {
    const std::string extension = input.ending();
    if (extension == ".pth" || extension == ".pt")
        throw IoError(input.name() + " is a PyTorch pickle, expected .safetensors or .npz; docs/components/lpips.md "
                                     "says how to export the weights");
    if (extension == ".npz") return detail::read_lpips_tensors(NpzReader(input));
    return detail::read_lpips_tensors(SafetensorsReader(input));
}

} // namespace gsh
