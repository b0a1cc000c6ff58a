// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-evaluate on a GPU: tables and pictures are those of the CPU's threads.
#include "programs/cuda/on_cuda.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>

using namespace gsh;
using test::check_done;
using test::json_of;
using test::on_cuda;
using test::run;
using test::studio;
using test::Words;
using test::operator+;
namespace fs = std::filesystem;

TEST_CASE("avatars and a scene, judged in the middle and at the end, with refined poses") {
    const test::Temporary folder;
    const fs::path out = folder / "out", configuration = folder / "paper.json";
    write_file(configuration,
               R"({"configuration": "paper", "hash.table_size": 512, "ao.table_size": 512, "ao.start": 0,
                   "refine.test_steps": 2})");
    const auto evaluate = [&](const Words& more) {
        return run(Words{"gsh-evaluate", "--capture", studio().path.string(), "--body", studio().body_file.string(),
                         "--configs", configuration.string() + ",static", "--out", out.string(), "--gaussians", "150",
                         "--steps", "2,4", "--refine", "--no-registration", "--threads", "2"} +
                   more);
    };
    // Runs of both backends stand side by side.
    check_done(evaluate({}));
    check_done(evaluate(on_cuda));
    const auto tables = json_of(out / "tables.json");
    const auto &figures = tables.at("figures"), &costs = tables.at("costs");
    REQUIRE(figures.size() == 8);
    for (std::size_t row = 0; row < 4; ++row) {
        const auto &expected = figures[row], &found = figures[4 + row];
        CHECK(found.at("name") == expected.at("name").get<std::string>() + ", cuda");
        CHECK(found.at("after") == expected.at("after"));
        for (const char* key : {"psnr", "ssim"})
            CHECK(found.at(key).get<double>() == doctest::Approx(expected.at(key).get<double>()).epsilon(2e-3));
    }
    REQUIRE(costs.size() == 4);
    for (std::size_t row = 0; row < 2; ++row) {
        const auto &expected = costs[row], &found = costs[2 + row];
        test::check_says_cuda(found);
        for (const char* key : {"gaussians", "lookups", "entries", "touched_entries", "ao_touched_entries"})
            CHECK(found.value(key, 0) == expected.value(key, 0));
        CHECK(found.at("ms_per_step") > 0.0);
        CHECK(read_file(out / "tables.md") == test::contains(found.at("device").get<std::string>()));
    }
    // The pictures of each run: render, error, crops.
    std::vector<fs::path> runs;
    for (const auto& entry : fs::directory_iterator(out / "runs"))
        if (entry.path().filename().string().find("cuda") == std::string::npos) runs.push_back(entry.path());
    REQUIRE(runs.size() == 2);
    std::size_t compared = 0;
    for (const fs::path& threads : runs) {
        std::string name = threads.filename().string();
        name.insert(name.rfind("-4-steps"), "+cuda");
        for (const auto& entry : fs::directory_iterator(threads)) {
            if (entry.path().extension() != ".png") continue;
            const PixelImage expected = read_image(entry.path()),
                             found = read_image(out / "runs" / name / entry.path().filename());
            CAPTURE(entry.path());
            CHECK(test::decibels(found, expected, 64) >= 60);
            ++compared;
        }
    }
    CHECK(compared == 3);
    const test::Outcome again = evaluate(on_cuda);
    check_done(again);
    CHECK(again.out == test::contains("cuda: is finished already"));
}
