// SPDX-License-Identifier: Apache-2.0
/// Avatars in another light, through the programs as a user runs them: output and refused input.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
using test::same_file;
namespace fs = std::filesystem;

namespace {

/// An environment with a bright patch, `column` degrees to the right of the image's centre, over a grey.
PixelImage patch_environment(double column) {
    PixelImage image(3, 36, 72);
    for (int y = 0; y < 36; ++y)
        for (int x = 0; x < 72; ++x) {
            const double longitude = std::remainder(5.0 * (x - 35.5) - column, 360.0), latitude = 5.0 * (17.5 - y);
            const bool bright = std::abs(longitude) < 40 && std::abs(latitude - 20) < 30;
            for (int c = 0; c < 3; ++c) image.pixel(y, x)[c] = bright ? 255 : 40;
        }
    return image;
}

/// Two trained avatars, one with and one without a light.
struct LitActor {
    test::Temporary folder;
    fs::path lit = folder / "lit/avatar.gsh", unlit = folder / "unlit/avatar.gsh", scene = folder / "unlit/avatar.ply",
             left = folder / "left.png", right = folder / "right.png";

    LitActor() {
        const test::SmallCapture& s = test::studio();
        check_done(run(s.reconstruct(folder / "lit", {"--steps", "30"})));
        check_done(run(s.reconstruct(folder / "unlit", {"--config", "paper", "--steps", "2"})));
        write_png(left, patch_environment(-90));
        write_png(right, patch_environment(90));
    }
    [[nodiscard]] std::vector<std::string> render(const fs::path& scene_file, const std::string& out,
                                                  std::vector<std::string> more) const {
        std::vector<std::string> words{"gsh-render", scene_file.string(),
                                       "--camera",   test::studio().camera.string(),
                                       "--out",      (folder / out).string()};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    }
    /// Renders the lit avatar.
    [[nodiscard]] PixelImage shown(const std::string& out, const std::vector<std::string>& more) const {
        check_done(run(render(lit, out, more)));
        return read_image(folder / out);
    }
};
const LitActor& lit_actor() {
    static const LitActor instance;
    return instance;
}

/// Number of pixels that differ by more than two steps.
int changed_pixels(const PixelImage& a, const PixelImage& b) {
    REQUIRE(a.data.size() == b.data.size());
    int count = 0;
    for (std::size_t i = 0; i < a.data.size(); i += 4) {
        bool differs = false;
        for (std::size_t c = 0; c < 3; ++c) differs = differs || std::abs(int(a.data[i + c]) - int(b.data[i + c])) > 2;
        count += differs;
    }
    return count;
}

double mean_value(const PixelImage& image) {
    double sum = 0;
    for (std::size_t i = 0; i < image.data.size(); i += 4) sum += image.data[i] + image.data[i + 1] + image.data[i + 2];
    return sum / (0.75 * static_cast<double>(image.data.size()));
}

} // namespace

TEST_CASE("an avatar is shown in its own light, in even light, and in that of an image") {
    const LitActor& s = lit_actor();
    const PixelImage own = s.shown("own.png", {}), even = s.shown("even.png", {"--light", "even"}),
                     left = s.shown("at_left.png", {"--light", s.left.string()}),
                     right = s.shown("at_right.png", {"--light", s.right.string()});
    (void)s.shown("estimated.png", {"--light", "estimated"});
    CHECK(same_file(s.folder / "own.png", s.folder / "estimated.png"));
    for (const PixelImage* other : {&even, &left, &right}) CHECK(changed_pixels(own, *other) > 100);
    CHECK(changed_pixels(even, left) > 100);
    CHECK(changed_pixels(left, right) > 100);

    // Turning by half a circle exchanges left and right.
    const PixelImage turned = s.shown("turned.png", {"--light", s.left.string(), "--light-turn", "180"});
    CHECK(changed_pixels(turned, left) > 100);
    CHECK(changed_pixels(turned, right) < changed_pixels(turned, left) / 4);

    const PixelImage darker = s.shown("darker.png", {"--exposure", "-1"}),
                     brighter = s.shown("brighter.png", {"--light", "even", "--exposure", "0.5"});
    CHECK(mean_value(darker) < 0.85 * mean_value(own));
    CHECK(mean_value(brighter) > 1.05 * mean_value(even));
}

TEST_CASE("the light of an image comes from where the image shows it") {
    // Seen from in front by a camera that looks along -z, what is right in the image is on the right in the picture.
    const LitActor& s = lit_actor();
    const auto animate = [&](const fs::path& light, const std::string& out) {
        check_done(run({"gsh-animate", s.lit.string(), "--poses", test::studio().dance.string(), "--size", "96",
                        "--light", light.string(), "--background", "0,0,0", "--out", (s.folder / out).string()}));
        return read_image(s.folder / out / "0000.png");
    };
    const PixelImage left = animate(s.left, "frames_left"), right = animate(s.right, "frames_right");
    const auto half = [](const PixelImage& image, int from) {
        double sum = 0;
        for (int y = 0; y < image.height; ++y)
            for (int x = from; x < from + image.width / 2; ++x) sum += image.pixel(y, x)[1];
        return sum;
    };
    CHECK(half(left, 0) > 1.05 * half(right, 0));
    CHECK(half(right, 48) > 1.05 * half(left, 48));
}

TEST_CASE("people in one picture shadow each other") {
    const LitActor& s = lit_actor();
    Motion motion = actor_motion(ActorMotion::talk, 2);
    save_motion(s.folder / "here.npz", motion);
    for (auto& transl : motion.transl) transl.x += 0.8;
    save_motion(s.folder / "beside.npz", motion);
    const std::string here = (s.folder / "here.npz").string(), beside = (s.folder / "beside.npz").string();
    const auto alone = [&](const std::string& out, const std::string& poses, const fs::path& light) {
        return s.shown(out, {"--poses", poses, "--light", light.string()});
    };
    // Pixels that show nothing of the second person, and differ from those without that person.
    const auto shadowed = [&](const fs::path& light) {
        const PixelImage first = alone("first.png", here, light), second = alone("second.png", beside, light),
                         both = s.shown("both.png", {s.lit.string(), "--poses", here, "--poses", beside, "--light",
                                                     light.string()});
        int darker = 0, brighter = 0;
        for (std::size_t i = 0; i < both.data.size(); i += 4) {
            if (second.data[i] || second.data[i + 1] || second.data[i + 2]) continue;
            darker += both.data[i + 1] + 4 < first.data[i + 1], brighter += both.data[i + 1] > first.data[i + 1] + 4;
        }
        CHECK(brighter == 0);
        return darker;
    };
    CHECK(shadowed(s.right) > 40); // the other person is between the first one and the light
    CHECK(shadowed(s.right) > 2 * shadowed(s.left));
}

TEST_CASE("a light that cannot be used is refused in a line") {
    const LitActor& s = lit_actor();
    const auto refuse = [&](const fs::path& scene, const std::vector<std::string>& more,
                            std::initializer_list<std::string_view> words) {
        check_refused(run(s.render(scene, "refused.png", more)), "gsh-render", words);
        CHECK(!fs::exists(s.folder / "refused.png"));
    };
    for (const std::string light : {"even", "left.png"})
        refuse(s.unlit, {"--light", light}, {"unlit/avatar.gsh", "without a light", "gsh-reconstruct --config light"});
    refuse(s.unlit, {"--exposure", "1"}, {"unlit/avatar.gsh", "--config light"});
    check_refused(run({"gsh-animate", s.unlit.string(), "--poses", test::studio().dance.string(), "--light", "even",
                       "--out", (s.folder / "none").string()}),
                  "gsh-animate", {"unlit/avatar.gsh", "--config light"});
    check_done(run(s.render(s.unlit, "unlit.png", {"--light", "estimated"})));
    refuse(s.scene, {"--light", "even"}, {"avatar.ply", "--light", "need avatars"});
    refuse(s.lit, {"--light", "evne"}, {"evne"});
    refuse(s.lit, {"--light", "even", "--light-turn", "10"}, {"--light-turn", "--light FILE"});
    refuse(s.lit, {"--exposure", "nan"}, {"--exposure", "nan"});
    write_png(s.folder / "square.png", PixelImage(3, 8, 8));
    refuse(s.lit, {"--light", (s.folder / "square.png").string()}, {"square.png", "8 x 8", "twice as wide as high"});
    write_png(s.folder / "black.png", PixelImage(3, 8, 16));
    refuse(s.lit, {"--light", (s.folder / "black.png").string()}, {"black.png", "black"});
    write_file(s.folder / "text.hdr", "no image");
    refuse(s.lit, {"--light", (s.folder / "text.hdr").string()}, {"text.hdr", "Radiance HDR"});
}

TEST_CASE("without a pixel to read the light from, the way out is named") {
    const test::SmallCapture& s = test::studio();
    const test::Temporary folder;
    Capture faint = s.capture; // masks that are nowhere full
    for (PixelImage& image : faint.images)
        for (std::size_t i = 3; i < image.data.size(); i += 4)
            image.data[i] = std::min(image.data[i], std::uint8_t(240));
    save_capture(folder / "capture", faint);
    const auto reconstruct = [&](std::vector<std::string> more) {
        more.insert(more.end(), {"--steps", "1"});
        return run(s.reconstruct(folder / "out", more, folder / "capture"));
    };
    check_refused(reconstruct({}), "gsh-reconstruct",
                  {"no vertex of a mesh is seen", "alpha of at least 250", "--config paper"});
    CHECK(!fs::exists(folder / "out"));
    check_done(reconstruct({"--config", "paper"}));
    CHECK(!load_avatar(folder / "out/avatar.gsh").light.has_value());
}
