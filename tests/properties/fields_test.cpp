// SPDX-License-Identifier: Apache-2.0
/// The fields and the losses: linear maps with their transposes, SSIM, and images that are resampled.
#include "properties/properties.hpp"
#include "support/gradient.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/loss/cpu/photometric.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::test;

namespace {

using WildGrid = HashGrid<3, 2>;

double inner_product(const std::vector<double>& a, const std::vector<double>& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

template <class T>
Image<T> any_image(int width, int height) {
    Image<T> image(3, height, width);
    const auto numbers = gsh::test::Rng(below(1000)).numbers(image.data.size(), 0, 1);
    std::ranges::copy(numbers, image.data.begin());
    if (rarely(4)) std::ranges::fill(image.data, T(one_of({0.0, 1.0, 0.25})));
    return image;
}

template <class B>
PhotometricValues loss_of(B& backend, const Image<double>& a, const Image<double>& b, double weight,
                          Image<double>* gradient = nullptr, double dL_dloss = 1) {
    const PhotometricLoss<B, double> loss(backend, {.ssim_weight = weight});
    typename PhotometricLoss<B, double>::Cache cache;
    loss.forward(a.view(), b.view(), cache);
    if (gradient) {
        *gradient = Image<double>(a.channels, a.height, a.width);
        loss.backward(a.view(), b.view(), dL_dloss, cache, gradient->view());
    }
    return loss.values(cache);
}

} // namespace

TEST_CASE("a hash grid is linear in its table, and its adjoint is the transpose") {
    check_property([] {
        const WildGrid grid({.base = one_of({3.0, 1.5, 8.5}),
                             .growth = one_of({1.7, 1.0, 2.5}),
                             .table_size = one_of({64u, 8u, 4096u})});
        const std::size_t N = up_to(40), outputs = 6;
        std::vector<vec3<double>> points(N);
        for (auto& p : points)
            for (int k = 0; k < 3; ++k) p[k] = rarely(3) ? one_of({0.0, 1.0, 0.5, 0.25, 1e-17}) : 0.5 + around(0, 0.5);
        gsh::test::Rng rng(below(1000));
        const auto a = rng.numbers(grid.parameter_count()), b = rng.numbers(grid.parameter_count());
        const auto w = rng.numbers(N * outputs);
        const double s = around(1, 3);
        std::vector<double> sum(a.size());
        for (std::size_t i = 0; i < a.size(); ++i) sum[i] = a[i] + s * b[i];
        std::vector<double> first;
        const auto check = [&](auto& backend) {
            WildGrid::Query<std::remove_reference_t<decltype(backend)>, double> query;
            grid.prepare(backend, points, query);
            const auto features_of = [&](const std::vector<double>& table) {
                std::vector<double> features(N * outputs);
                grid.forward(backend, table, query, {features, N, outputs, outputs});
                return features;
            };
            const auto one = features_of(a), other = features_of(b), both = features_of(sum);
            for (std::size_t i = 0; i < one.size(); ++i)
                require(std::abs(both[i] - one[i] - s * other[i]) <= 1e-13, [] { return "the sum"; });
            std::vector<double> ones(a.size(), 1.0), dL_da(a.size(), 0.0);
            for (const double f : features_of(ones)) // weights of a cell's corners sum to 1
                require(std::abs(f - 1) <= 1e-14, [&] { return "weights sum to " + digits(f); });
            grid.backward(backend, FeatureView<const double>(w, N, outputs, outputs), query, dL_da);
            require(std::abs(inner_product(one, w) - inner_product(a, dL_da)) <= 1e-11, [] { return "the transpose"; });
            if (first.empty()) first = dL_da;
            require(first == dL_da, [] { return "threads change bits"; });
        };
        static cpu::Serial serial;
        static cpu::Threads threads(3);
        check(serial), check(threads);
    });
}

TEST_CASE("the loss of equal images is 0, with no gradient, and it is symmetric") {
    check_property([] {
        const int width = 1 + int(below(30)), height = 1 + int(below(30));
        const Image<double> a = any_image<double>(width, height), b = any_image<double>(width, height);
        const double weight = one_of({0.2, 0.0, 1.0});
        const auto check = [&](auto& backend) {
            Image<double> gradient, scaled;
            const auto same = loss_of(backend, a, a, weight, &gradient);
            require(same.loss == 0, [&] { return "the loss is " + digits(same.loss); });
            for (const double g : gradient.data) require(g == 0, [&] { return "a gradient of " + digits(g); });
            const auto one = loss_of(backend, a, b, weight, &gradient), other = loss_of(backend, b, a, weight);
            require(std::abs(one.loss - other.loss) <= 1e-15, [] { return "not symmetric"; });
            require(one.loss >= 0 && one.loss <= 2, [&] { return "a loss of " + digits(one.loss); });
            (void)loss_of(backend, a, b, weight, &scaled, -8);
            for (std::size_t i = 0; i < gradient.data.size(); ++i)
                require(scaled.data[i] == -8 * gradient.data[i], [] { return "a scaled loss has another gradient"; });
        };
        static cpu::Serial serial;
        static cpu::Threads threads(3);
        check(serial), check(threads);
    });
}

TEST_CASE("SSIM of equal images is 1, it is symmetric, and lies in [-1, 1]") {
    check_property([] {
        const int width = 11 + int(below(10)), height = 11 + int(below(10));
        const auto a = any_image<float>(width, height), b = any_image<float>(width, height);
        const auto of = [](const Image<float>& x, const Image<float>& y) { return ssim(x.view(), y.view()); };
        require(of(a, a) == 1, [&] { return "of equal images: " + digits(of(a, a)); });
        require(std::abs(of(a, b) - of(b, a)) <= 1e-15, [] { return "not symmetric"; });
        require(of(a, b) <= 1 && of(a, b) >= -1, [&] { return digits(of(a, b)); });
        Image<float> turned = a, other = b; // upside down
        std::ranges::reverse(turned.data), std::ranges::reverse(other.data);
        require(std::abs(of(turned, other) - of(a, b)) <= 1e-12, [] { return "another value upside down"; });
        require(mean_squared_error(a.view(), b.view()) == mean_squared_error(b.view(), a.view()), [] { return "MSE"; });
    });
}

TEST_CASE("an image that is resampled by the identity is the same, and bilinear values lie between their four") {
    check_property([] {
        const int width = 1 + int(below(12)), height = 1 + int(below(12));
        const Image<float> image = any_image<float>(width, height);
        static cpu::Serial backend;
        Image<float> same(3, height, width), scaled(3, 1 + int(below(20)), 1 + int(below(20)));
        resample(backend, image.view(), ScaleMap<float>{1, 1}, same.view());
        require(same.data == image.data, [] { return "not the same"; });
        const ScaleMap<float> map{float(width) / float(scaled.width), float(height) / float(scaled.height)};
        resample(backend, image.view(), map, scaled.view());
        const auto [low, high] = std::ranges::minmax(image.data);
        for (const float v : scaled.data)
            require(v >= -1e-6f && v <= high + 1e-6f, [&] { return digits(v) + " above " + digits(high); });
        // Pixels beyond the border count as 0, so only those inside are at least the smallest.
        for (int y = 0; y < scaled.height; ++y)
            for (int x = 0; x < scaled.width; ++x) {
                const vec2<float> p = map(vec2<float>(float(x) + 0.5f, float(y) + 0.5f));
                if (p.x < 0.5f || p.y < 0.5f || p.x > float(width) - 0.5f || p.y > float(height) - 0.5f) continue;
                require(scaled.at(0, y, x) >= low - 1e-6f, [] { return "below the smallest"; });
            }
    });
}
