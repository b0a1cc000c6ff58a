// SPDX-License-Identifier: Apache-2.0
#include <gsh/train/configuration.hpp>
#include <gsh/train/configuration_file.hpp>

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <set>
#include <string>
#include <string_view>

using namespace gsh;

TEST_CASE("every named configuration exists under its own name, and differs from the paper's") {
    const auto paper = settings_of(named_configuration("paper"));
    for (const std::string_view name : configuration_names) {
        const Configuration c = named_configuration(name);
        CHECK(c.name == name);
        if (name != "paper") CHECK(settings_of(c) != paper);
    }
    CHECK_THROWS_WITH_AS((void)named_configuration("papier"), doctest::Contains("expected one of paper, baseline"),
                         ValueError);
}

TEST_CASE("an ablation differs from the paper's in its own part alone") {
    const auto paper = settings_of(named_configuration("paper"));
    const auto differences = [&](std::string_view name) {
        std::set<std::string> result;
        const auto settings = settings_of(named_configuration(name));
        for (std::size_t i = 0; i < settings.size(); ++i)
            if (settings[i] != paper[i]) result.insert(settings[i].first);
        return result;
    };
    CHECK(differences("no-ao") == std::set<std::string>{"ao"});
    CHECK(differences("pose-ao") == std::set<std::string>{"ao"});
    CHECK(differences("no-hash-sh") == std::set<std::string>{"hash_sh"});
    CHECK(differences("no-hash-vd") == std::set<std::string>{"hash_displacement"});
    CHECK(differences("no-depth") == std::set<std::string>{"prior.depth"});
    CHECK(differences("no-normals") == std::set<std::string>{"prior.normals"});
    CHECK(differences("no-multiscale") == std::set<std::string>{"multi_scale"});
    CHECK(differences("smpl-init") == std::set<std::string>{"joints", "region.samples"});
}

TEST_CASE("settings read back what they print") {
    Configuration odd = named_configuration("baseline");
    odd.train.rates.sh = 0.1 + 0.2; // needs all digits
    odd.avatar.deformation = Deformation::dual_quaternion;
    odd.avatar.hash_table_size = 1u << 19;
    Configuration copy;
    for (const auto& [key, text] : settings_of(odd)) set_setting(copy, key, text, "test");
    CHECK(settings_of(copy) == settings_of(odd));
    CHECK(copy.train.rates.sh == odd.train.rates.sh);
}

TEST_CASE("docs/configurations.md lists every configuration, and every setting with the paper's value") {
    const std::string page = read_file(std::filesystem::path(GSH_SOURCE_DIR) / "docs" / "configurations.md");
    for (const std::string_view name : configuration_names) {
        CAPTURE(name);
        CHECK(page.find(std::string("`").append(name).append("`")) != std::string::npos);
    }
    const auto settings = settings_of(named_configuration("paper"));
    for (const auto& [key, text] : settings) {
        const std::string row = std::string("\n| `").append(key).append("` | ").append(text).append(" | ");
        CAPTURE(row);
        CHECK(page.find(row) != std::string::npos);
    }
    const auto rows = [](std::string_view table) { // and no other
        std::size_t count = 0;
        for (std::size_t at = table.find("\n| `"); at != std::string::npos; at = table.find("\n| `", at + 1)) ++count;
        return count;
    };
    const std::size_t begin = page.find("| setting |"), end = page.find("## A static scene");
    REQUIRE(end != std::string::npos);
    CHECK(rows(std::string_view(page).substr(begin, end - begin)) == settings.size());
    const auto scene = settings_of(static_config(3000));
    for (const auto& [key, text] : scene) {
        const std::string row = std::string("\n| `").append(key).append("` | ").append(text).append(" | ");
        CAPTURE(row);
        CHECK(page.find(row, end) != std::string::npos);
    }
    CHECK(rows(std::string_view(page).substr(end)) == scene.size());
}

TEST_CASE("settings have names of their own") {
    std::set<std::string> names;
    const auto settings = settings_of(Configuration());
    for (const auto& [key, text] : settings) names.insert(key);
    CHECK(names.size() == settings.size());
}

TEST_CASE("a setting that cannot be is refused with its name, and nothing changes") {
    Configuration c;
    const auto before = settings_of(c);
    const auto message = [&](const char* key, const char* text, const char* expected) {
        CHECK_THROWS_WITH_AS(set_setting(c, key, text, "--set"), doctest::Contains(expected), ValueError);
    };
    message("rate.shh", "1", "--set: there is no setting 'rate.shh'");
    message("rate.sh", "fast", "--set: rate.sh is 'fast', expected a number");
    message("rate.sh", "1e-3x", "expected a number");
    message("rate.sh", "nan", "expected a finite number");
    message("mlp.width", "6.5", "expected a number");
    message("multi_scale", "yes", "expected true or false");
    message("ao", "space", "expected one of none, time, pose");
    CHECK(settings_of(c) == before);
}

TEST_CASE("a file names where it starts from and what differs") {
    const test::Temporary folder;
    const auto write = [&](const std::string& text) {
        write_file(folder / "mine.json", text);
        return (folder / "mine.json").string();
    };
    const Configuration mine = find_configuration(write(
        R"({"configuration": "baseline-x", "rate.sh": 1e-3, "ao": "none", "multi_scale": true, "mlp.width": 32})"));
    CHECK(mine.name == "mine");
    CHECK(mine.avatar.heads == Heads::separate);
    CHECK(mine.train.rates.sh == 1e-3);
    CHECK(mine.avatar.ao == AmbientOcclusion::none);
    CHECK(mine.multi_scale);
    CHECK(mine.avatar.mlp_width == 32);
    CHECK(find_configuration(write(R"({"configuration": "no-depth"})")).name == "no-depth");
    CHECK(find_configuration("no-ao").avatar.ao == AmbientOcclusion::none);

    const auto refused = [&](const std::string& text, const char* message) {
        CHECK_THROWS_WITH((void)find_configuration(write(text)), doctest::Contains(message));
    };
    refused("{", "mine.json");
    refused("[1]", "must hold one JSON object");
    refused(R"({"configuration": 3})", "there is no configuration '3'");
    refused(R"({"configuration": "x"})", "there is no configuration 'x'");
    refused(R"({"rate.sh": [1]})", "rate.sh must be a number");
    refused(R"({"rate.sh": null})", "rate.sh must be a number");
    refused(R"({"rate.tables": 1})", "there is no setting 'rate.tables'");
    CHECK_THROWS_AS((void)find_configuration((folder / "none.json").string()), IoError);
}
