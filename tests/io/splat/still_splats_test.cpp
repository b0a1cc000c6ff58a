// SPDX-License-Identifier: Apache-2.0
/// What no Gaussian has is refused by all writers, and nothing is written.
#include <gsh/io/splat/any_splats.hpp>
#include <gsh/io/splat/compressed_ply.hpp>
#include <gsh/io/splat/gltf_splats.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/io/splat/splat_file.hpp>
#include <gsh/io/splat/spz.hpp>
#include <gsh/io/splat/usda.hpp>

#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <limits>
#include <vector>

using namespace gsh;

TEST_CASE("writers refuse numbers that are not finite, and quaternions of length 0") {
    const test::Temporary folder;
    const auto path = folder / "a";
    using Cloud = GaussianCloud<float>;
    const std::vector<std::function<void(const Cloud&)>> writers{
        [&](const Cloud& cloud) { write_spz(path, cloud); },
        [&](const Cloud& cloud) { write_splat(path, cloud); },
        [&](const Cloud& cloud) { write_gltf_splats(path, cloud); },
        [&](const Cloud& cloud) { write_gaussian_ply(path, cloud); },
        [&](const Cloud& cloud) { write_compressed_ply(path, cloud); },
        [&](const Cloud& cloud) {
            UsdaSplats file(path);
            file.add(cloud);
            file.commit();
        }};
    constexpr float none = std::numeric_limits<float>::quiet_NaN(), endless = std::numeric_limits<float>::infinity();
    const auto refused = [&](const std::function<void(Cloud&)>& change, const char* word) {
        Cloud cloud = test::splat_cloud(4, 1);
        change(cloud);
        for (std::size_t w = 0; w < writers.size(); ++w) {
            CAPTURE(w);
            test::check_throws<ValueError>([&] { writers[w](cloud); }, {word, "Gaussian 2", "not finite"});
        }
    };
    refused([&](Cloud& cloud) { cloud.means[2].y = none; }, "mean");
    refused([&](Cloud& cloud) { cloud.means[2].z = -endless; }, "mean");
    refused([&](Cloud& cloud) { cloud.log_scales[2].x = 89; }, "e^89"); // more than a float holds
    refused([&](Cloud& cloud) { cloud.log_scales[2].y = 45; }, "e^45"); // the variance is more
    refused([&](Cloud& cloud) { cloud.log_scales[2].x = -endless; }, "scale");
    refused([&](Cloud& cloud) { cloud.quats[2] = {0, 0, 0, 0}; }, "quaternion");
    refused([&](Cloud& cloud) { cloud.quats[2].w = none; }, "quaternion");
    refused([&](Cloud& cloud) { cloud.opacity_logits[2] = none; }, "opacity");
    refused([&](Cloud& cloud) { cloud.sh[11].x = endless; }, "colour");
    CHECK(folder.file_count() == 0);
}

TEST_CASE("a quaternion of any length in a file is a rotation, which comes back from another file") {
    CHECK(!detail::rotation_of_file({0, 0, 0, 0}));
    const auto own = detail::rotation_of_file({2, 0, 0, -1}), tiny = detail::rotation_of_file({0, 3e-30, 0, 4e-30}),
               large = detail::rotation_of_file({0, 3e30, 0, -4e30});
    CHECK((own->w == 2 && own->z == -1));
    CHECK((tiny->x == 0.6f && tiny->z == 0.8f));
    CHECK((large->x == 0.6f && large->z == -0.8f));

    const test::Temporary folder;
    const StillSplats read = load_any_splats( // its last rotation is -8.4e18 long
        std::filesystem::path(GSH_SOURCE_DIR) / "tests/fuzz/corpus/gltf-splats/long_quaternion.gltf");
    const auto norm = [](const quat<float>& q) { return std::sqrt(dot(q, q)); };
    CHECK(norm(read.cloud.quats.at(5)) == doctest::Approx(1));
    write_gaussian_ply(folder / "a.ply", read.cloud);
    write_gaussian_ply(folder / "b.ply", read_gaussian_ply(folder / "a.ply"));
    CHECK(read_file(folder / "a.ply") == read_file(folder / "b.ply"));
}

TEST_CASE("a Gaussian's size is its middle axis") {
    CHECK(size_of({0, -20, -1}) == doctest::Approx(std::exp(-1.0)));
    CHECK(size_of({-2, 5, -2}) == doctest::Approx(std::exp(-2.0)));
}

TEST_CASE("losses of several files add up") {
    SplatLosses losses{.gaussians = 2, .positions = 1, .position_step = 0.5};
    losses +=
        {.gaussians = 3, .scales = 2, .colors = 4, .coefficients = 5, .coarse = 6, .fillers = 7, .position_step = 0.25};
    CHECK(losses.gaussians == 5);
    CHECK(losses.positions == 1);
    CHECK(losses.scales + losses.colors + losses.coefficients + losses.coarse + losses.fillers == 24);
    CHECK(losses.position_step == 0.5);
}
