// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluation_runs.hpp"
#include "loss/lpips_networks.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/bodies.hpp"
#include "support/contains.hpp"

#include <gsh/camera/pinhole.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/image/image_file.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

/// One capture for all tests here, and configurations with tables small enough for tests, in files.
struct SmallTables : test::SmallCapture {
    SmallTables() {
        const auto write = [&](const char* name) {
            const Json json{{"configuration", name}, {"hash.table_size", 1024}, {"ao.table_size", 1024}};
            write_file(folder / (std::string(name) + ".json"), json.dump());
        };
        for (const char* name : {"paper", "no-ao", "baseline"}) write(name);
    }
    /// "paper,static", with the file of paper in place of its name.
    [[nodiscard]] std::string configs(const std::vector<std::string>& names) const {
        std::string text;
        for (const std::string& name : names)
            text += (text.empty() ? "" : ",") + (name == "static" ? name : (folder / (name + ".json")).string());
        return text;
    }
    [[nodiscard]] std::vector<std::string> evaluate(const fs::path& out, const std::string& list,
                                                    std::vector<std::string> more, const fs::path& of = {}) const {
        std::vector<std::string> words{"gsh-evaluate",
                                       "--capture",
                                       (of.empty() ? path : of).string(),
                                       "--body",
                                       body_file.string(),
                                       "--configs",
                                       list,
                                       "--out",
                                       out.string(),
                                       "--gaussians",
                                       "300"};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    }
};
SmallTables& small_tables() {
    static SmallTables instance;
    return instance;
}

Json ordered_json_of(const fs::path& path) {
    return Json::parse(read_file(path));
}

/// (name, after) of each row of a list in tables.json.
std::vector<std::pair<std::string, std::string>> rows_of(const Json& list) {
    std::vector<std::pair<std::string, std::string>> rows;
    for (const Json& row : list) rows.emplace_back(row.at("name"), row.at("after"));
    return rows;
}
using Rows = std::vector<std::pair<std::string, std::string>>;

/// Figures without measured times.
Json timeless(Json figures) {
    for (Json& row : figures) row.erase("seconds");
    return figures;
}

/// Finds the square of a picture that a crop shows enlarged by a whole number. The crop is `width` pixels wide and
/// begins at the top of column x0. Returns the square's corner, its side and the number, which is 0 if there is none.
struct Enlarged {
    int x = 0, y = 0, side = 0, zoom = 0;

    Enlarged(const PixelImage& picture, int size, int x0, int width) {
        for (zoom = width; zoom > 0; --zoom) {
            side = width / zoom;
            for (y = 0; width % zoom == 0 && y + side <= size; ++y)
                for (x = 0; x + side <= size; ++x)
                    if (shown(picture, x0, width)) return;
        }
    }
    [[nodiscard]] bool shown(const PixelImage& picture, int x0, int width) const {
        for (int v = 0; v < width; ++v)
            for (int u = 0; u < width; ++u)
                if (!std::equal(picture.pixel(v, x0 + u), picture.pixel(v, x0 + u) + 3,
                                picture.pixel(y + v / zoom, x + u / zoom)))
                    return false;
        return true;
    }
};

} // namespace

TEST_CASE("tables, pictures and a page hold every configuration") {
    const SmallTables& s = small_tables();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const test::Outcome outcome =
        run(s.evaluate(out, s.configs({"paper", "no-ao", "static"}), {"--steps", "6,3", "--views", "2"}));
    check_done(outcome);
    for (const char* words : {"| paper ", "| no-ao ", "| static ", "## Contribution of each part", "3 of 6 steps"})
        CHECK(outcome.out == test::contains(words));

    const Json tables = ordered_json_of(out / "tables.json");
    CHECK(tables.at("reference") == "paper");
    CHECK(rows_of(tables.at("figures")) == Rows{{"paper", "3 of 6 steps"},
                                                {"paper", "6 steps"},
                                                {"no-ao", "3 of 6 steps"},
                                                {"no-ao", "6 steps"},
                                                {"static", "3 of 6 steps"},
                                                {"static", "6 steps"}});
    for (const Json& row : tables.at("figures")) {
        CHECK(row.at("psnr") > 5.0);
        CHECK(row.at("ssim").is_number());
        CHECK(row.at("psnr_regions").contains("hands"));
        CHECK(row.at("images").size() == (row.at("name") == "static" ? 1 : 2));
        CHECK(row.at("protocol").get<std::string>().find("Test views of capture") == 0);
        const bool middle =
            row.at("protocol").get<std::string>().find("Judged in the middle of a run, after 3 of 6 steps") !=
            std::string::npos;
        CHECK(middle == (row.at("after") == "3 of 6 steps"));
    }
    // Only avatars were evaluated on the same images.
    REQUIRE(rows_of(tables.at("differences")) == Rows{{"no-ao", "3 of 6 steps"}, {"no-ao", "6 steps"}});
    const Json& difference = tables.at("differences")[1];
    const auto psnr = [&](std::size_t row) { return tables.at("figures")[row].at("psnr").get<double>(); };
    CHECK(difference.at("psnr").get<double>() == doctest::Approx(psnr(3) - psnr(1)));
    CHECK(difference.at("paper")[0].at("psnr").get<double>() == doctest::Approx(38.825 - 40.96));
    CHECK(read_file(out / "tables.md") == test::contains("-2.13 dB, SSIM -0.0031, LPIPS +0.0011 (GalaBasketball)"));

    REQUIRE(tables.at("costs").size() == 3);
    const Json &paper = tables.at("costs")[0], &no_ao = tables.at("costs")[1];
    for (const Json* cost : {&paper, &no_ao}) {
        CHECK(cost->at("gaussians") == 300);
        CHECK(cost->at("lookups") > 300);
        CHECK(cost->at("touched_entries") <= cost->at("entries"));
        CHECK(cost->at("memory_bytes") > 1'000'000);
        CHECK(cost->at("ms_per_step") > 0.0);
        CHECK(cost->at("ms_per_stage").at("render") > 0.0);
    }
    for (const Json& cost : tables.at("costs")) CHECK(cost.at("backend") == "threads");
    CHECK(ordered_json_of(out / "runs/static-6-steps/result.json").at("backend") == "threads");
    CHECK(read_file(out / "tables.md") == test::contains("computed on"));
    CHECK(paper.at("ao_touched_entries") > 0);
    CHECK(no_ao.at("ao_entries") == 0);
    CHECK(no_ao.at("settings").at("ao") == "none");

    // Rows of equal height: the photograph and three configurations. The second view has no static scene.
    const PixelImage first = read_image(out / "grids/test00_0000.png"),
                     second = read_image(out / "grids/test00_0001.png");
    CHECK(first.height == 4 * 64 + 3 * 4);
    CHECK(second.height == 3 * 64 + 2 * 4);
    CHECK(first.width > 2 * 64 + 3 * 12); // render, error, crops
    const std::string page = read_file(out / "report.html");
    CHECK(page != test::contains("http"));
    std::size_t pictures = 0;
    for (std::size_t at = page.find("src=\"data:image/png;base64,"); at != std::string::npos;
         at = page.find("src=\"data:image/png;base64,", at + 1))
        ++pictures;
    CHECK(pictures == 7);
    CHECK(page.ends_with("</html>\n"));
    for (const auto& entry : fs::recursive_directory_iterator(out)) // checkpoints are large
        CHECK(entry.path().extension() != ".gsh");
}

TEST_CASE("a row shows face and hands where they are, at most four times as large") {
    const SmallTables& s = small_tables();
    const test::Temporary folder;
    Capture capture = s.capture; // with plates that are nowhere white, unlike gaps, and differ everywhere
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        PixelImage& plate = capture.backgrounds.emplace_back(4, 64, 64);
        for (int y = 0; y < 64; ++y)
            for (int x = 0; x < 64; ++x) {
                const int rgba[] = {2 * x, 2 * y, 50, 255};
                std::copy_n(rgba, 4, plate.pixel(y, x));
            }
    }
    save_capture(folder / "capture", capture);
    check_done(
        run(s.evaluate(folder / "out", s.configs({"paper"}), {"--steps", "1", "--views", "2"}, folder / "capture")));
    for (std::size_t frame = 0; frame < 2; ++frame) {
        const PixelImage grid = read_image(folder / ("out/grids/test00_000" + std::to_string(frame) + ".png"));
        const auto vertices = test::posed_vertices(s.body, capture.motion, frame);
        const Camera<double>& camera = capture.cameras.back().camera;
        int x = 2 * 64 + 4; // photograph, gap, and the place of the error, which is empty for a photograph
        for (const auto* region : {&s.body.face_vertices, &s.body.left_hand_vertices, &s.body.right_hand_vertices}) {
            x += 4;
            int width = 0;
            while (x + width < grid.width && grid.pixel(0, x + width)[2] != 255) ++width;
            const Enlarged crop(grid, 64, x, width);
            x += width;
            CHECK(crop.zoom >= 2);
            CHECK(crop.zoom <= 4);
            vec2<double> low(64.0), high(0.0);
            for (const int v : *region) {
                const vec2<double> at = to_pixel(camera, to_camera(camera, vertices[static_cast<std::size_t>(v)]));
                low = glm::min(low, at), high = glm::max(high, at);
            }
            for (const auto& [first, from, to] : {std::tuple(crop.x, low.x, high.x), {crop.y, low.y, high.y}}) {
                CHECK(first <= from);
                CHECK(to <= first + crop.side);
                CHECK(std::abs(from + to - 2 * first - crop.side) <= 1); // the square is centred
            }
        }
        CHECK(x == grid.width);
    }
}

TEST_CASE("an interrupted evaluation goes on, and ends with the figures of one that was left alone") {
    const SmallTables& s = small_tables();
    const test::Temporary folder;
    const auto words = [&](const fs::path& out) {
        return s.evaluate(out, s.configs({"baseline", "paper"}), {"--steps", "20,60"});
    };
    check_done(run(words(folder / "whole")));
    {
        test::Process process(words(folder / "parts"));
        REQUIRE(process.wait_until([&] { return process.err().find("paper (2 of 2)") != std::string::npos; }));
        process.send(SIGINT);
        const test::Outcome outcome = process.wait();
        CHECK(outcome.code == 130);
        CHECK(outcome.err == test::contains("stopped; the same command continues from there"));
        CHECK(fs::exists(folder / "parts/runs/paper-60-steps/checkpoint.gsh"));
        CHECK(!fs::exists(folder / "parts/runs/paper-60-steps/result.json"));
        CHECK(ordered_json_of(folder / "parts/tables.json").at("figures").size() == 2); // of the finished runs
    }
    const test::Outcome rest = run(words(folder / "parts"));
    check_done(rest);
    CHECK(rest.out.find("baseline: is finished already") == 0);
    CHECK(timeless(ordered_json_of(folder / "parts/tables.json").at("figures")) ==
          timeless(ordered_json_of(folder / "whole/tables.json").at("figures")));
    CHECK(ordered_json_of(folder / "parts/tables.json").at("differences") ==
          ordered_json_of(folder / "whole/tables.json").at("differences"));
    CHECK(read_file(folder / "parts/grids/test00_0001.png") == read_file(folder / "whole/grids/test00_0001.png"));
    CHECK(!fs::exists(folder / "parts/runs/paper-60-steps/checkpoint.gsh"));
}

TEST_CASE("a second call adds what is new, and runs again what has changed") {
    const SmallTables& s = small_tables();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    check_done(run(s.evaluate(out, s.configs({"paper"}), {"--steps", "2"})));
    const std::string before = read_file(out / "runs/paper-2-steps/result.json");
    const Json first = ordered_json_of(out / "tables.json").at("figures");
    CHECK(rows_of(first) == Rows{{"paper", "2 steps"}});

    check_done(run(s.evaluate(out, s.configs({"no-ao"}), {"--steps", "2"})));
    Json tables = ordered_json_of(out / "tables.json");
    CHECK(rows_of(tables.at("figures")) == Rows{{"paper", "2 steps"}, {"no-ao", "2 steps"}});
    CHECK(tables.at("figures")[0] == first[0]);
    CHECK(read_file(out / "runs/paper-2-steps/result.json") == before);

    // A budget of time and a changed setting give rows of their own. Changed settings under the same name are rerun.
    check_done(run(s.evaluate(out, s.configs({"paper"}), {"--budgets", "0.1s", "--set", "rate.sh=0.001"})));
    tables = ordered_json_of(out / "tables.json");
    REQUIRE(tables.at("figures").size() == 3);
    CHECK(tables.at("figures")[2].at("name") == "paper rate.sh=0.001");
    CHECK(tables.at("figures")[2].at("configuration") == "paper");
    CHECK(tables.at("figures")[2].at("after") == "0.1 s");
    CHECK(tables.at("figures")[2].at("protocol").get<std::string>() == test::contains("Trained for 0.1 s on "));
    const Json other{{"configuration", "no-ao"}, {"hash.table_size", 2048}};
    const std::string kept = read_file(s.folder / "no-ao.json");
    write_file(s.folder / "no-ao.json", other.dump());
    const test::Outcome again = run(s.evaluate(out, s.configs({"paper", "no-ao"}), {"--steps", "2"}));
    write_file(s.folder / "no-ao.json", kept);
    check_done(again);
    CHECK(again.out.find("paper: is finished already\nno-ao: was judged with other settings or after other steps; it "
                         "runs again\nno-ao, 2 steps: PSNR ") == 0);
    CHECK(ordered_json_of(out / "tables.json").at("costs")[1].at("settings").at("hash.table_size") == "2048");

    // Mixed precision gives a row of its own.
    check_done(run(s.evaluate(out, s.configs({"paper"}), {"--steps", "2", "--precision", "mixed"})));
    tables = ordered_json_of(out / "tables.json");
    REQUIRE(tables.at("figures").size() == 4);
    CHECK(rows_of(tables.at("figures"))[3] == std::pair<std::string, std::string>("paper, mixed precision", "2 steps"));
    CHECK(tables.at("figures")[3].at("psnr") != tables.at("figures")[0].at("psnr"));

    // Other regions in a file of the same name are another input.
    const fs::path painted = folder / "painted", regions = folder / "regions.json";
    const auto judge = [&](const char* painting) {
        write_file(regions, painting);
        return run(s.evaluate(painted, s.configs({"paper"}), {"--steps", "1", "--regions", regions.string()}));
    };
    check_done(judge(R"({"high": [0, 1, 2]})"));
    check_done(judge(R"({"high": [0, 1, 2]})"));
    check_refused(judge(R"({"high": [0, 1, 3]})"), "gsh-evaluate", {"evaluation.json", "--regions", "another --out"});
}

TEST_CASE("refined poses are reported as such, and so is LPIPS") {
    const SmallTables& s = small_tables();
    const test::Temporary folder;
    {
        const LpipsNetwork network = test::with_noise(lpips_alexnet());
        NpzWriter file(folder / "lpips.npz");
        std::size_t convolution = 0, slice = 0, inputs = 3;
        for (const LpipsStep& step : network.steps) {
            if (step.is_convolution()) {
                const std::string name = "features." + std::to_string(step.number);
                const auto channels = static_cast<std::size_t>(step.channels),
                           kernel = static_cast<std::size_t>(step.kernel);
                file.add(name + ".weight", network.convolutions[convolution].weight,
                         {channels, inputs, kernel, kernel});
                file.add(name + ".bias", network.convolutions[convolution++].bias);
                inputs = channels;
            }
            if (step.compared)
                file.add("lin" + std::to_string(slice) + ".weight", network.lins[slice], {1, inputs, 1, 1}), ++slice;
        }
        file.commit();
    }
    check_done(run(s.evaluate(folder / "out", s.configs({"paper", "no-ao"}),
                              {"--steps", "1,2", "--refine", "--lpips", (folder / "lpips.npz").string()})));
    const Json tables = ordered_json_of(folder / "out/tables.json"), &figures = tables.at("figures");
    CHECK(rows_of(figures) == Rows{{"paper, refined", "1 of 2 steps"},
                                   {"paper, refined", "2 steps"},
                                   {"no-ao, refined", "1 of 2 steps"},
                                   {"no-ao, refined", "2 steps"}});
    for (const Json& row : figures) {
        const std::string protocol = row.at("protocol");
        CHECK(protocol == test::contains("fitted to the test images at test time"));
        CHECK(protocol == test::contains(" LPIPS "));
        CHECK(row.at("lpips") > 0.0);
    }
    CHECK(tables.at("differences")[0].at("lpips").is_number());
    CHECK(tables.at("differences")[1].at("protocol") == figures[3].at("protocol"));
    CHECK(tables.at("differences")[1].at("reference_protocol") == figures[1].at("protocol"));
    CHECK(read_file(folder / "out/tables.md") == test::contains(" [2] − [2] |"));
    CHECK(read_file(folder / "out/tables.md") == test::contains("| SSIM   | LPIPS"));
}

TEST_CASE("what cannot be evaluated is refused in a line, and leaves nothing") {
    const SmallTables& s = small_tables();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto refuse = [&](const std::string& configs, std::vector<std::string> more,
                            std::initializer_list<std::string_view> said) {
        check_refused(run(s.evaluate(out, configs, std::move(more))), "gsh-evaluate", said);
        CHECK(!fs::exists(out));
    };
    refuse("paper,no-such-thing", {}, {"no-such-thing", "expected one of paper"});
    refuse("paper", {"--set", "rate.nothing=1"}, {"rate.nothing"});
    refuse("paper", {"--steps", "3", "--budgets", "5s"}, {"--steps", "--budgets"});
    refuse("paper", {"--steps", "3,many"}, {"many"});
    refuse("paper", {"--budgets", "5h"}, {"--budgets", "'5h'", "expected one like 5s"});
    refuse("paper", {"--refine-cameras"}, {"--refine-cameras needs --refine"});
    refuse("static", {"--budgets", "5s"}, {"static", "--steps"});
    refuse("static,paper", {"--set", "rate.sh=1"}, {"static", "--set"});
    refuse("static", {"--set", "ao=none"}, {"no setting 'ao'"});
    refuse("paper", {"--lpips-table"}, {"--lpips-table needs --lpips"});
    refuse("static", {"--frame", "7"}, {"2 frames", "expected frame 7"});
    refuse("paper", {"--poses", "none.npz"}, {"none.npz"});
    {
        const test::Temporary trained;
        Capture capture = s.capture;
        for (NamedCamera& camera : capture.cameras) camera.role = NamedCamera::Role::train;
        save_capture(trained / "capture", capture);
        refuse("paper", {"--capture", (trained / "capture").string()}, {"--capture"}); // the option is given twice
        check_refused(run({"gsh-evaluate", "--capture", (trained / "capture").string(), "--body", s.body_file.string(),
                           "--configs", "paper", "--out", out.string()}),
                      "gsh-evaluate", {"capture", "no test views"});
        CHECK(!fs::exists(out));
    }
    write_file(folder / "file", "in the way");
    check_refused(run(s.evaluate(folder / "file", s.configs({"paper"}), {"--steps", "1"})), "gsh-evaluate",
                  {"file", "cannot be created"});
    // A folder belongs to one input.
    check_done(run(s.evaluate(out, s.configs({"paper"}), {"--steps", "1"})));
    const std::string tables = read_file(out / "tables.json");
    check_refused(run(s.evaluate(out, s.configs({"paper"}), {"--steps", "1", "--seed", "1"})), "gsh-evaluate",
                  {"evaluation.json", "--seed '0', not '1'"});
    CHECK(read_file(out / "tables.json") == tables);
    test::truncate_file(out / "runs/paper-1-steps/result.json", 200);
    check_refused(run(s.evaluate(out, s.configs({"paper"}), {"--steps", "1"})), "gsh-evaluate",
                  {"result.json", "truncated"});
}

TEST_CASE("a run keeps its results where its settings are only listed in another order") {
    const Json settings{{"ao", "time"}, {"rate.sh", "0.002"}}, turned{{"rate.sh", "0.002"}, {"ao", "time"}};
    CHECK(programs::same_settings(settings, turned));
    CHECK(!programs::same_settings(settings, Json{{"ao", "time"}, {"rate.sh", "0.003"}}));
    CHECK(!programs::same_settings(settings, Json{{"ao", "time"}}));
}
