// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/usda.hpp>

#include "io/file_size_limit.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>

#include <charconv>
#include <string>
#include <string_view>

using namespace gsh;

namespace {

std::size_t occurrences(const std::string& text, std::string_view word) {
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text.find(word, at)) != std::string::npos; at += word.size()) ++count;
    return count;
}

/// Two Gaussians with numbers that are short in decimal.
GaussianCloud<float> plain_cloud() {
    GaussianCloud<float> cloud(2, 1);
    cloud.means = {{1, 2.5f, -3}, {0, 0, 0.125f}};
    cloud.quats[1] = {0, 0, 2, 0};
    cloud.opacity_logits = {0, 100};
    cloud.sh[5] = {0.5f, 0.25f, -1};
    return cloud;
}

} // namespace

TEST_CASE("a still layer holds a prim with plain values") {
    const test::Temporary folder;
    UsdaSplats file(folder / "a.usda", PixelFilter{0.1, true});
    file.add(plain_cloud());
    CHECK_THROWS_AS(file.add(plain_cloud()), ValueError);
    file.commit();
    const std::string text = read_file(folder / "a.usda");
    CHECK(text.starts_with("#usda 1.0\n"));
    for (const char* line :
         {"upAxis = \"Y\"", "string generator = \"gsh ", "double gshFilterDilation = 0.1\n",
          "def ParticleField3DGaussianSplat \"Splats\"", "point3f[] positions = [(1, 2.5, -3), (0, 0, 0.125)]\n",
          "quatf[] orientations = [(1, 0, 0, 0), (0, 0, 1, 0)]\n", "float3[] scales = [(1, 1, 1), (1, 1, 1)]\n",
          "float[] opacities = [0.5, 1]\n", "float3[] extent = [(-3, -3, -6), (4, 5.5, 3.125)]\n",
          "uniform int radiance:sphericalHarmonicsDegree = 1\n",
          "(0, 0, 0), (0.5, 0.25, -1), (0, 0, 0), (0, 0, 0)]\n"}) {
        INFO(line);
        CHECK(text == test::contains(line));
    }
    CHECK(text != test::contains("timeSamples"));
    CHECK(occurrences(text, "{") == occurrences(text, "}"));
}

TEST_CASE("a moving layer has a sample for each frame") {
    const test::Temporary folder;
    UsdaSplats file(folder / "a.usda", {}, 29.97);
    auto cloud = plain_cloud();
    for (int frame = 0; frame < 3; ++frame) {
        cloud.means[0].x = static_cast<float>(frame);
        file.add(cloud);
    }
    CHECK_THROWS_AS(file.add(test::splat_cloud(3, 1)), ShapeError);
    CHECK_THROWS_AS(file.add(test::splat_cloud(2, 0)), ShapeError);
    file.commit();
    const std::string text = read_file(folder / "a.usda");
    for (const char* line :
         {"endTimeCode = 2\n", "timeCodesPerSecond = 29.97\n", "point3f[] positions.timeSamples = {\n",
          "            2: [(2, 2.5, -3), (0, 0, 0.125)],\n"})
        CHECK(text == test::contains(line));
    CHECK(occurrences(text, ".timeSamples") == 5);
    CHECK(occurrences(text, "            1: [") == 5);
    CHECK(occurrences(text, "opacities") == 1);
}

TEST_CASE("the extent is finite, wherever the Gaussians are") {
    const test::Temporary folder;
    auto cloud = plain_cloud();
    cloud.means[0].x = 3.4e38f, cloud.log_scales[0] = vec3<float>(44);
    UsdaSplats file(folder / "a.usda");
    file.add(cloud);
    file.commit();
    CHECK(read_file(folder / "a.usda") != test::contains("inf"));
}

TEST_CASE("numbers come back as the floats that they were") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(200, 0);
    for (auto& mean : cloud.means) mean = mean + vec3<float>(100000);
    UsdaSplats file(folder / "a.usda");
    file.add(cloud);
    file.commit();
    const std::string text = read_file(folder / "a.usda");
    const char* at = text.data() + text.find("positions = [(") + 14;
    for (const auto& mean : cloud.means)
        for (int axis = 0; axis < 3; ++axis) {
            float number = 0;
            at = std::from_chars(at, text.data() + text.size(), number).ptr;
            CHECK(number == mean[axis]);
            at += std::string_view(at).find_first_of("-0123456789");
        }
}

TEST_CASE("temporary files that cannot be written, because the disk is full, are an error") {
    UsdaSplats file("/dev/null"); // which the limit does not concern
    const test::FileSizeLimit full(10);
    file.add(plain_cloud()); // few bytes, which wait in the memory of the C library
    test::check_throws<IoError>([&] { file.commit(); }, {"/dev/null", "temporary file cannot be written"});
}

TEST_CASE("nothing is written without a commit or a cloud") {
    const test::Temporary folder;
    {
        UsdaSplats file(folder / "a.usda");
        file.add(plain_cloud());
    }
    CHECK(folder.file_count() == 0);
    UsdaSplats empty(folder / "b.usda");
    CHECK_THROWS_AS(empty.commit(), ValueError);
    CHECK_THROWS_AS(empty.add(test::splat_cloud(0, 0)), ValueError);
    CHECK_THROWS_AS(UsdaSplats(folder / "no/such/folder.usda"), IoError);
}
