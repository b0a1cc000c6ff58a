// SPDX-License-Identifier: Apache-2.0
/// @file  Writes Gaussians as OpenUSD text (.usda), still or with a sample for each frame of a motion.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/file_author.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// Writes a ParticleField3DGaussianSplat prim, /Avatar/Splats. With frames_per_second, positions, orientations, scales
/// and SH have a sample for each cloud that is added, at time codes 0, 1, 2, …; programs interpolate between them.
/// Opacities are those of the first cloud. Without frames_per_second, exactly one cloud is added.
///
/// USD has y up here, as gsh has. The layer's data states author and pixel filter. Numbers have as many digits
/// as bring the same float back. Samples of frames are kept in unnamed temporary files until the end, not in memory.
///
/// Errors  IoError with the file; ShapeError for a cloud of another size or degree than the first.
/// Source  Pixar, OpenUSD 26.03, usdVol/schema.usda.
class UsdaSplats {
public:
    UsdaSplats(std::filesystem::path path, std::optional<PixelFilter> filter = {},
               std::optional<double> frames_per_second = {})
        : file_(std::move(path)), filter_(filter), frames_per_second_(frames_per_second) {
        for (auto& sample : samples_) {
            sample.reset(std::tmpfile());
            if (!sample) throw IoError(file_.path().string() + ": no temporary file can be created");
        }
    }

    void add(const GaussianCloud<float>& cloud);

    /// Makes the file appear.
    void commit();

private:
    struct Close {
        void operator()(std::FILE* file) const { std::fclose(file); }
    };
    /// The attributes that may change from frame to frame.
    enum Attribute { extent, positions, orientations, scales, coefficients, attribute_count };
    static constexpr std::array<std::string_view, attribute_count> declarations_ = {
        "float3[] extent", "point3f[] positions", "quatf[] orientations", "float3[] scales",
        "float3[] radiance:sphericalHarmonicsCoefficients"};

    AtomicFile file_;
    std::optional<PixelFilter> filter_;
    std::optional<double> frames_per_second_;
    std::array<std::unique_ptr<std::FILE, Close>, attribute_count> samples_;
    std::string opacities_;
    std::size_t frames_ = 0, size_ = 0;
    int sh_degree_ = 0;

    static void append(std::string& text, float number) {
        char digits[32];
        text.append(digits, std::to_chars(digits, digits + sizeof digits, number).ptr);
    }
    /// "[(a, b, c), …]" of tuples, or "[a, …]" of single numbers.
    static std::string list(Span<const float> numbers, std::size_t width) {
        std::string text = "[";
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            const std::size_t c = i % width;
            if (i) text += ", ";
            if (width > 1 && c == 0) text += "(";
            append(text, numbers[i]);
            if (width > 1 && c + 1 == width) text += ")";
        }
        return text + "]";
    }
    void store(Attribute attribute, const std::vector<float>& numbers, std::size_t width) {
        std::string text = list(numbers, width);
        if (frames_per_second_) text = "            " + std::to_string(frames_) + ": " + text + ",\n";
        if (std::fwrite(text.data(), 1, text.size(), samples_[attribute].get()) != text.size())
            throw IoError(file_.path().string() + ": a temporary file cannot be written; free some space");
    }
    void write_samples(Attribute attribute);
};

// -------------------------------------------------------------------------------------------------------------

inline void UsdaSplats::add(const GaussianCloud<float>& cloud) {
    check_writable("UsdaSplats", cloud);
    check_value(cloud.size() > 0, "UsdaSplats", "there must be a Gaussian");
    check_value(frames_ == 0 || frames_per_second_, "UsdaSplats", "a still file holds one cloud");
    if (frames_ == 0) size_ = cloud.size(), sh_degree_ = cloud.sh_degree;
    check_size("UsdaSplats", "cloud", cloud.size(), size_, "all frames have the Gaussians of the first");
    check_size("UsdaSplats", "sh_degree", static_cast<std::size_t>(cloud.sh_degree),
               static_cast<std::size_t>(sh_degree_), "all frames have the degree of the first");
    std::vector<float> values[attribute_count], alphas;
    vec3<float> low(std::numeric_limits<float>::infinity()), high(-low);
    const auto put = [](std::vector<float>& to, const vec3<float>& v) { to.insert(to.end(), {v.x, v.y, v.z}); };
    for (std::size_t i = 0; i < size_; ++i) {
        const vec3<float> scale(std::exp(cloud.log_scales[i].x), std::exp(cloud.log_scales[i].y),
                                std::exp(cloud.log_scales[i].z));
        const float reach = 3 * std::max({scale.x, scale.y, scale.z});
        low = glm::min(low, cloud.means[i] - reach), high = glm::max(high, cloud.means[i] + reach);
        const quat<float> q = normalize(cloud.quats[i]);
        put(values[positions], cloud.means[i]);
        put(values[scales], scale);
        values[orientations].insert(values[orientations].end(), {q.w, q.x, q.y, q.z});
        if (frames_ == 0) alphas.push_back(sigmoid(cloud.opacity_logits[i]));
    }
    const vec3<float> most(std::numeric_limits<float>::max()); // an extent must be finite
    put(values[extent], glm::max(low, -most)), put(values[extent], glm::min(high, most));
    for (const vec3<float>& c : cloud.sh) put(values[coefficients], c);
    if (frames_ == 0) opacities_ = list(alphas, 1);
    for (int a = 0; a < attribute_count; ++a) store(static_cast<Attribute>(a), values[a], a == orientations ? 4 : 3);
    ++frames_;
}

inline void UsdaSplats::write_samples(Attribute attribute) {
    file_.write("        " + std::string(declarations_[attribute]) +
                (frames_per_second_ ? ".timeSamples = {\n" : " = "));
    std::FILE* const samples = samples_[attribute].get();
    if (std::fflush(samples) != 0 || std::ferror(samples)) // rewind would write, and forget an error
        throw IoError(file_.path().string() + ": a temporary file cannot be written; free some space");
    std::rewind(samples);
    char block[1 << 16];
    while (const std::size_t count = std::fread(block, 1, sizeof block, samples)) file_.write(block, count);
    if (std::ferror(samples)) throw IoError(file_.path().string() + ": a temporary file cannot be read");
    file_.write(frames_per_second_ ? "        }\n" : "\n");
}

inline void UsdaSplats::commit() {
    check_value(frames_ > 0, "UsdaSplats::commit", "no cloud was added");
    const auto number = [](double value) {
        char digits[32];
        return std::string(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
    };
    std::string head = "#usda 1.0\n(\n    customLayerData = {\n        string generator = \"" + file_author() + "\"\n";
    if (filter_)
        head += "        double gshFilterDilation = " + number(filter_->dilation) +
                "\n        bool gshFilterCompensatesOpacity = " + (filter_->compensate_opacity ? "1" : "0") + "\n";
    head += "    }\n    defaultPrim = \"Avatar\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n";
    if (frames_per_second_)
        head += "    startTimeCode = 0\n    endTimeCode = " + std::to_string(frames_ - 1) +
                "\n    timeCodesPerSecond = " + number(*frames_per_second_) +
                "\n    framesPerSecond = " + number(*frames_per_second_) + "\n";
    file_.write(head + ")\n\ndef Xform \"Avatar\"\n{\n    def ParticleField3DGaussianSplat \"Splats\"\n    {\n");
    for (int a = 0; a < attribute_count; ++a) write_samples(static_cast<Attribute>(a));
    file_.write("        float[] opacities = " + opacities_ +
                "\n        uniform int radiance:sphericalHarmonicsDegree = " + std::to_string(sh_degree_) +
                "\n        uniform token projectionModeHint = \"perspective\"\n"
                "        uniform token sortingModeHint = \"zDepth\"\n    }\n}\n");
    file_.commit();
}

} // namespace gsh
