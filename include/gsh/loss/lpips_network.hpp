// SPDX-License-Identifier: Apache-2.0
/// @file  The networks of LPIPS: their steps, weights and feature maps.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// One step of a network: a convolution with bias and ReLU, or a maximum over a window.
struct LpipsStep {
    int number = 0;   ///< index in torchvision's `features`; weight files use it as a name
    int channels = 0; ///< of the output; 0 marks max pooling, which keeps the number of channels
    int kernel = 1, stride = 1, padding = 0;
    bool compared = false; ///< the output contributes to the distance

    [[nodiscard]] bool is_convolution() const { return channels > 0; }
    /// Length of the output along an axis; 0 where the window does not fit.
    [[nodiscard]] int output(int length) const {
        const int room = length + 2 * padding - kernel;
        return room < 0 ? 0 : room / stride + 1;
    }
};

struct LpipsConvolution {
    std::vector<float> weight; // [channels, input channels, kernel, kernel], as PyTorch stores it
    std::vector<float> bias;   // [channels]
};

/// A network with its weights, on the host.
struct LpipsNetwork {
    std::string name;
    std::vector<LpipsStep> steps{};
    std::vector<LpipsConvolution> convolutions{}; // one per convolution, in order
    std::vector<std::vector<float>> lins{};       // one per compared step, [its channels]: weight of each channel
    /// An RGB image in [-1, 1] is normalised as (image - shift) / scale; the numbers are those of version 0.1.
    std::array<float, 3> shift{-0.030f, -0.088f, -0.188f}, scale{0.458f, 0.448f, 0.450f};
};

/// AlexNet's five convolutions without weights; all are compared.
///
/// Source  Krizhevsky, "One weird trick for parallelizing convolutional neural networks", 2014, as in torchvision.
[[nodiscard]] inline LpipsNetwork lpips_alexnet() {
    return {.name = "AlexNet",
            .steps = {{0, 64, 11, 4, 2, true},
                      {2, 0, 3, 2},
                      {3, 192, 5, 1, 2, true},
                      {5, 0, 3, 2},
                      {6, 384, 3, 1, 1, true},
                      {8, 256, 3, 1, 1, true},
                      {10, 256, 3, 1, 1, true}}};
}

/// VGG16's thirteen convolutions without weights; the last of each group is compared.
///
/// Source  Simonyan and Zisserman, "Very deep convolutional networks for large-scale image recognition", 2015.
[[nodiscard]] inline LpipsNetwork lpips_vgg16() {
    LpipsNetwork network{.name = "VGG16"};
    int number = 0;
    for (const auto& [channels, count] : {std::array{64, 2}, {128, 2}, {256, 3}, {512, 3}, {512, 3}}) {
        if (number > 0) network.steps.push_back({number++, 0, 2, 2});
        for (int i = 0; i < count; ++i, number += 2) // a ReLU also has a number in torchvision
            network.steps.push_back({number, channels, 3, 1, 1, i + 1 == count});
    }
    return network;
}

/// Shortest image side for which every step has an output.
[[nodiscard]] inline int smallest_side(const LpipsNetwork& network) {
    int side = 1; // from the last step back to the first: the input side that each step needs
    for (auto step = network.steps.rbegin(); step != network.steps.rend(); ++step)
        side = std::max((side - 1) * step->stride + step->kernel - 2 * step->padding, 1);
    return side;
}

/// Throws ShapeError or ValueError, with `where` in the message, unless steps and weights match.
inline void validate(const LpipsNetwork& network, std::string_view where) {
    std::size_t convolution = 0, compared = 0;
    int channels = 3;
    for (const LpipsStep& step : network.steps) {
        const std::string name = "features." + std::to_string(step.number);
        check_value(step.kernel > 0 && step.stride > 0 && step.padding >= 0 && step.channels >= 0, where,
                    name + " has a window or a stride below 1");
        check_value(step.is_convolution() || step.padding == 0, where, name + " is a pooling with padding");
        if (step.is_convolution()) {
            check_value(convolution < network.convolutions.size(), where, name + " has no weights; fill convolutions");
            const LpipsConvolution& weights = network.convolutions[convolution++];
            const auto count = std::size_t(step.channels) * std::size_t(channels) *
                               std::size_t(step.kernel) * std::size_t(step.kernel);
            check_size(where, name + ".weight", weights.weight.size(), count);
            check_size(where, name + ".bias", weights.bias.size(), std::size_t(step.channels));
            check_finite<float>(where, name + ".weight", weights.weight);
            check_finite<float>(where, name + ".bias", weights.bias);
            channels = step.channels;
        }
        if (step.compared) {
            const std::string lin = "lin" + std::to_string(compared);
            check_value(compared < network.lins.size(), where, lin + " is missing; fill lins");
            check_size(where, lin, network.lins[compared].size(), std::size_t(channels));
            check_finite<float>(where, lin, network.lins[compared++]);
        }
    }
    check_value(compared > 0, where, "no step is compared, expected at least one");
    check_size(where, "convolutions", network.convolutions.size(), convolution, "one per convolution step");
    check_size(where, "lins", network.lins.size(), compared, "one per compared step");
    check_finite<float>(where, "shift", network.shift);
    check_finite<float>(where, "scale", network.scale);
    for (const float s : network.scale) check_value(s != 0, where, "scale holds a 0");
}

/// Range in which images from [0, 1] are passed to the network.
enum class LpipsScaling {
    correct, ///< stretched to [-1, 1], the range for which the network was trained
    table,   ///< unchanged, as published benchmark code on PeopleSnapshot does; its tables hold these numbers
};

/// The network's weights in the backend's memory.
template <Backend B, std::floating_point T = float>
struct LpipsWeights {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    struct Convolution {
        Buffer<T> weight; ///< [channels, kernel, kernel, input channels]: a row has the layout of a patch of a map
        Buffer<T> bias;   ///< [channels]
    };
    std::vector<LpipsStep> steps{};
    std::vector<Convolution> convolutions;
    std::vector<Buffer<T>> lins;
    std::array<T, 3> shift{}, scale{};
};

/// The feature maps of one image that are compared.
template <Backend B, std::floating_point T = float>
struct LpipsFeatures {
    struct Map {
        int height = 0, width = 0, channels = 0;
        typename B::template Buffer<T> values; ///< [height, width, channels]

        [[nodiscard]] std::size_t pixel_count() const { return std::size_t(height) * std::size_t(width); }
        void resize(int new_height, int new_width, int new_channels) {
            height = new_height, width = new_width, channels = new_channels;
            values.resize(pixel_count() * std::size_t(channels));
        }
    };
    int height = 0, width = 0; ///< of the image
    std::vector<Map> maps;
};

namespace detail {

/// Runs a network's steps over an image of the features' size. begin(out) writes the image as a map of three channels;
/// convolve(in, step, weights, out) and pool(in, step, out) fill the map of a step. Maps that are compared are those of
/// `features`, and the others alternate between two buffers.
template <Backend B, std::floating_point T, class Begin, class Convolve, class Pool>
void run_lpips_steps(const LpipsWeights<B, T>& network, LpipsFeatures<B, T>& features, const Begin& begin,
                     const Convolve& convolve, const Pool& pool) {
    using Map = typename LpipsFeatures<B, T>::Map;
    Map work[2];
    Map* in = &work[0];
    in->resize(features.height, features.width, 3);
    begin(*in);
    std::size_t convolution = 0, compared = 0;
    for (const LpipsStep& step : network.steps) {
        Map& out = step.compared ? features.maps[compared++] : work[in == &work[0] ? 1 : 0];
        out.resize(step.output(in->height), step.output(in->width),
                   step.is_convolution() ? step.channels : in->channels);
        if (step.is_convolution())
            convolve(std::as_const(*in), step, network.convolutions[convolution++], out);
        else
            pool(std::as_const(*in), step, out);
        in = &out;
    }
}

} // namespace detail

} // namespace gsh
