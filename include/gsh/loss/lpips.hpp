// SPDX-License-Identifier: Apache-2.0
/// @file  LPIPS: the perceptual distance of two images in the features of a trained network.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/lpips_network.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void lpips_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Lpips: include its backend's overloads, <gsh/loss/cpu/lpips.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
double lpips_distance(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Lpips: include its backend's overloads, <gsh/loss/cpu/lpips.hpp> or <gsh/cpu.hpp>");
    return {};
}

/// d(a, b) = sum over maps l of mean over pixels of sum_c w_lc (â_lc - b̂_lc)², where â is the feature vector of a map
/// at a pixel, scaled to length 1.
///
/// Shapes  images [3, height, width], RGB, at least smallest_side(network) long and wide (31 for AlexNet).
/// Units   display-referred sRGB in [0, 1]; `scaling` selects the range that the network receives.
/// Errors  ShapeError for images without three planes or of two sizes; ValueError for images that are too small or hold
///         a NaN, and for a network that validate() refuses.
/// Source  Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", 2018, version 0.1.
template <Backend B, std::floating_point T = float>
class Lpips {
public:
    using Features = LpipsFeatures<B, T>;

    /// Copies the weights.
    Lpips(B& backend, const LpipsNetwork& network, LpipsScaling scaling = LpipsScaling::correct);

    /// The maps of one image. An image that many renders are compared with needs them only once.
    void forward(const ImageView<const T>& image, Features& features) const {
        constexpr std::string_view where = "Lpips::forward";
        check_image(where, "image", image, 3, image.height, image.width);
        check_memory(*backend_, where, "image", image);
        check_value(image.height >= smallest_side_ && image.width >= smallest_side_, where,
                    "image is " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                        " pixels, expected at least " + std::to_string(smallest_side_) + " each way for " + name_);
        features.height = image.height, features.width = image.width;
        features.maps.resize(weights_.lins.size());
        lpips_forward(*backend_, weights_, image, scaling_, features); // the backend's own overload
    }

    /// The distance of two images from their maps: 0 for equal images, and symmetric.
    [[nodiscard]] double distance(const Features& a, const Features& b) const {
        constexpr std::string_view where = "Lpips::distance";
        for (const Features* features : {&a, &b})
            check_size(where, "features.maps", features->maps.size(), weights_.lins.size(), "call forward first");
        if (a.height != b.height || a.width != b.width)
            throw ShapeError(std::string(where) + ": features come from images of " + std::to_string(a.width) + " x " +
                             std::to_string(a.height) + " and " + std::to_string(b.width) + " x " +
                             std::to_string(b.height) + " pixels, expected one size");
        for (const Features* features : {&a, &b})
            for (std::size_t k = 0; k < features->maps.size(); ++k)
                check_size(where, "a pixel of features.maps", std::size_t(features->maps[k].channels),
                           weights_.lins[k].size(), "the features come from another network");
        const double result = lpips_distance(*backend_, weights_, a, b);
        check_value(std::isfinite(result), where, "the network's numbers overflow; are these the right weights?");
        return result;
    }

    /// The distance of two images.
    [[nodiscard]] double distance(const ImageView<const T>& image, const ImageView<const T>& truth) const {
        check_image("Lpips::distance", "image", image, 3, truth.height, truth.width);
        Features a, b;
        forward(image, a);
        forward(truth, b);
        return distance(a, b);
    }

    /// Description of the metric for a report: "AlexNet v0.1, images fed in [-1, 1]".
    [[nodiscard]] std::string protocol() const {
        return name_ + " v0.1, images fed in " + (scaling_ == LpipsScaling::correct ? "[-1, 1]" : "[0, 1]");
    }

private:
    B* backend_;
    std::string name_;
    LpipsScaling scaling_;
    LpipsWeights<B, T> weights_;
    int smallest_side_ = 1;
};

// -------------------------------------------------------------------------------------------------------------

template <Backend B, std::floating_point T>
Lpips<B, T>::Lpips(B& backend, const LpipsNetwork& network, LpipsScaling scaling)
    : backend_(&backend), name_(network.name), scaling_(scaling) {
    validate(network, "Lpips");
    smallest_side_ = smallest_side(network);
    weights_.steps = network.steps;
    weights_.convolutions.resize(network.convolutions.size());
    weights_.lins.resize(network.lins.size());
    const auto cast = [](const std::vector<float>& from) { return std::vector<T>(from.begin(), from.end()); };

    std::size_t convolution = 0, inputs = 3;
    for (const LpipsStep& step : network.steps) {
        if (!step.is_convolution()) continue;
        const LpipsConvolution& from = network.convolutions[convolution];
        const auto channels = std::size_t(step.channels), window = std::size_t(step.kernel) * std::size_t(step.kernel);
        std::vector<T> weight(from.weight.size());
        for (std::size_t o = 0; o < channels; ++o)
            for (std::size_t i = 0; i < inputs; ++i)
                for (std::size_t k = 0; k < window; ++k)
                    weight[(o * window + k) * inputs + i] = T(from.weight[(o * inputs + i) * window + k]);
        assign(*backend_, weight, weights_.convolutions[convolution].weight);
        assign(*backend_, cast(from.bias), weights_.convolutions[convolution].bias);
        ++convolution, inputs = channels;
    }
    for (std::size_t k = 0; k < network.lins.size(); ++k) assign(*backend_, cast(network.lins[k]), weights_.lins[k]);
    std::copy(network.shift.begin(), network.shift.end(), weights_.shift.begin());
    std::copy(network.scale.begin(), network.scale.end(), weights_.scale.begin());
}

} // namespace gsh
