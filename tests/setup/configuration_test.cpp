// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/model/configuration_file.hpp>
#include <gsh/setup/configuration.hpp>

#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <set>
#include <string>
#include <string_view>
#include <type_traits>

using namespace gsh;

namespace {

/// Sets every bounded setting to the ends of its range and to the nearest values outside. Returns the number of ends.
template <class C>
std::size_t try_ends(const C& defaults) {
    std::size_t ends = 0;
    for_each_setting(defaults, [&](std::string_view name, const auto& value, const SettingRange& range) {
        using V = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_arithmetic_v<V> && !std::is_same_v<V, bool>) {
            CAPTURE(name);
            CHECK(range.holds(value));
            const auto check = [&](V number, bool accepted) {
                const std::string text = gsh::detail::setting_text(number);
                CAPTURE(text);
                C c = defaults;
                if (!accepted) {
                    const std::string message = "--set: " + std::string(name) + " is '" + text + "', expected ";
                    CHECK_THROWS_WITH_AS(set_setting(c, name, text, "--set"), doctest::Contains(message.c_str()),
                                         ValueError);
                    CHECK(settings_of(c) == settings_of(defaults));
                    return;
                }
                CHECK_NOTHROW(set_setting(c, name, text, "--set"));
                for_each_setting(c, [&](std::string_view other, const auto& now, const SettingRange&) {
                    if (other == name) CHECK(gsh::detail::setting_text(now) == text);
                });
            };
            const auto next = [](double number, int way) { // the next larger or smaller number
                if constexpr (std::integral<V>)
                    return static_cast<V>(static_cast<V>(number) + way);
                else
                    return static_cast<V>(std::nextafter(number, way * std::numeric_limits<double>::infinity()));
            };
            const auto end = [&](double number, bool counts, int outwards) {
                if (std::isinf(number)) return;
                ++ends;
                check(static_cast<V>(number), counts);
                check(next(number, -outwards), true);
                if (std::signed_integral<V> || std::floating_point<V> || number > 0 || outwards > 0)
                    check(next(number, outwards), false);
            };
            end(range.least, range.with_least, -1);
            end(range.most, range.with_most, 1);
            if (range.powers_of_two) check(3, false), check(4, true), check(1000, false);
            if constexpr (std::floating_point<V>) // all settings must be finite, bounded or not
                for (const char* text : {"inf", "-inf", "nan"}) {
                    C c = defaults;
                    CHECK_THROWS_WITH_AS(set_setting(c, name, text, "--set"), doctest::Contains("a finite number"),
                                         ValueError);
                }
        }
    });
    return ends;
}

} // namespace

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

TEST_CASE("the default is one of the named configurations, and the pages name it") {
    CHECK(named_configuration(default_configuration).name == default_configuration);
    const std::filesystem::path docs = std::filesystem::path(GSH_SOURCE_DIR) / "docs";
    const std::string name = std::string("`").append(default_configuration).append("`");
    CHECK(read_file(docs / "configurations.md") == test::contains("\n| " + name + " | the default: "));
    CHECK(read_file(docs / "programs.md") == test::contains(name + " (the default)"));
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
    CHECK(differences("no-multiscale") == std::set<std::string>{"fine_levels"});
    CHECK(differences("coarse-only") == std::set<std::string>{"fine_levels"});
    CHECK(differences("smpl-init") == std::set<std::string>{"joints", "region.samples"});
    CHECK(differences("light") == std::set<std::string>{"light", "ao.width", "ao.table_size", "ao.points", "ao.start",
                                                        "sh_start", "gain.rate", "schedule.stride",
                                                        "schedule.all_points", "schedule.stored", "rate.stored_sh",
                                                        "rate.stored_displacements", "rate.log_scales", "rate.quats"});
}

TEST_CASE("settings read back what they print") {
    Configuration odd = named_configuration("baseline");
    odd.avatar.appearance.sh_rate = 0.1 + 0.2; // all digits are needed to restore it
    odd.avatar.model.deformation = Deformation::dual_quaternion;
    odd.avatar.appearance.field.grid.table_size = 1u << 19;
    Configuration copy;
    for (const auto& [key, text] : settings_of(odd)) set_setting(copy, key, text, "test");
    CHECK(settings_of(copy) == settings_of(odd));
    CHECK(copy.avatar.appearance.sh_rate == odd.avatar.appearance.sh_rate);
}

TEST_CASE("docs/configurations.md lists every configuration, and every setting with the paper's value") {
    const std::string page = read_file(std::filesystem::path(GSH_SOURCE_DIR) / "docs" / "configurations.md");
    for (const std::string_view name : configuration_names) {
        CAPTURE(name);
        CHECK(page == test::contains(std::string("`").append(name).append("`")));
    }
    const auto settings = settings_of(named_configuration("paper"));
    for (const auto& [key, text] : settings) {
        const std::string row = std::string("\n| `").append(key).append("` | ").append(text).append(" | ");
        CAPTURE(row);
        CHECK(page == test::contains(row));
    }
    const auto rows = [](std::string_view table) { // and no other settings
        std::size_t count = 0;
        for (std::size_t at = table.find("\n| `"); at != std::string::npos; at = table.find("\n| `", at + 1)) ++count;
        return count;
    };
    const std::size_t begin = page.find("| setting |"), end = page.find("## A static scene");
    REQUIRE(end != std::string::npos);
    CHECK(rows(std::string_view(page).substr(begin, end - begin)) == settings.size());
    const auto scene = settings_of(static_model_params(3000));
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
    message("mlp.width", "3000000000", "expected a whole number of at least 1 that fits 32 bits");
    message("rate.sh", "-1", "--set: rate.sh is '-1', expected a number of at least 0");
    message("region.sigma", "0", "region.sigma is '0', expected a number above 0");
    message("sh_start", "2", "sh_start is '2', expected a number of at least 0 and at most 1");
    message("ao.start", "2", "ao.start is '2', expected a number of at least 0 and at most 1");
    message("rate.final", "0", "expected a number above 0 and at most 1");
    message("initial_opacity", "1", "expected a number above 0 and below 1");
    message("hash.fine_level", "17", "expected a whole number of at least 0 and at most 16");
    message("hash.table_size", "1000", "hash.table_size is '1000', expected a power of two");
    message("sh_dc_scale", "inf", "sh_dc_scale is 'inf', expected a finite number");
    CHECK(settings_of(c) == before);
}

TEST_CASE("messages show no characters that a terminal cannot, and long texts not whole") {
    const auto message_of = [](const auto& call) {
        try {
            call();
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    const std::string hidden = "a\xEF\xBB\xBF"
                               "b\x1B",
                      text_long(1000, 'x');
    Configuration config;
    for (const std::string& text : {hidden, text_long})
        for (const std::string& message :
             {message_of([&] { set_setting(config, text, "1", "--set"); }),
              message_of([&] { set_setting(config, "rate.sh", text, "--set"); }),
              message_of([&] { static_cast<void>(named_configuration(text, "--config")); })}) {
            CHECK(message.starts_with("--"));
            CHECK(message.size() < 300);
            CHECK(message.find('\xEF') == std::string::npos);
            CHECK(message.find('\x1B') == std::string::npos);
        }
}

TEST_CASE("every setting is accepted up to the ends of its range and refused beyond them") {
    CHECK(try_ends(Configuration()) > 60);
    CHECK(try_ends(static_model_params(3000)) > 25);
    const auto refuse = [](const char* key, const char* text, const char* expected) {
        StaticModelParams c;
        CHECK_THROWS_WITH_AS(set_setting(c, key, text, "--set"), doctest::Contains(expected), ValueError);
    };
    refuse("density.interval", "0", "density.interval is '0', expected a whole number of at least 1");
    refuse("density.start", "-1", "expected a whole number of at least 0");
    refuse("density.min_opacity", "0", "expected a number above 0 and below 1");
    refuse("sh_interval", "0", "expected a whole number of at least 1");
}

TEST_CASE("settings that do not go together are refused by their names") {
    const auto message = [](std::initializer_list<std::pair<const char*, const char*>> settings, const char* expected) {
        Configuration c;
        for (const auto& [key, text] : settings) set_setting(c, key, text, "--set");
        CHECK_THROWS_WITH_AS(check_settings(c, "--set"), doctest::Contains(expected), ValueError);
    };
    message({{"ao.initial", "2"}, {"ao.largest", "1.5"}}, "--set: ao.initial is 2 and ao.largest 1.5, expected");
    message({{"ao.initial", "1.5"}, {"ao.largest", "1.5"}}, "expected ao.initial below ao.largest");
    message({{"region.samples_base", "0"}, {"region.samples_high", "0"}}, "or region.samples false");
    message({{"heads.time", "true"}, {"hash_sh", "false"}, {"hash_displacement", "false"}},
            "--set: heads.time is true");
    message({{"ao", "space"}}, "--set: ao is 'space', expected one of none, time, pose");
    message({{"appearance", "paint"}},
            "--set: appearance is 'paint', expected one of shared_field, separate_fields, color_field");
    Configuration c;
    for (const auto& [key, text] : {std::pair("region.samples", "false"),
                                    {"region.samples_base", "0"},
                                    {"region.samples_high", "0"},
                                    {"heads.time", "true"},
                                    {"hash_sh", "false"}})
        set_setting(c, key, text, "--set");
    CHECK_NOTHROW(check_settings(c, "--set"));
}

TEST_CASE("what the named configurations say lies within the ranges") {
    const auto check = [](const auto& c) {
        auto copy = c;
        for (const auto& [key, text] : settings_of(c)) CHECK_NOTHROW(set_setting(copy, key, text, "its own"));
    };
    for (const std::string_view name : configuration_names) {
        check(named_configuration(name));
        CHECK_NOTHROW(check_settings(named_configuration(name), "its own"));
    }
    for (const int steps : {1, 7, 3000, 30000, 1000000}) check(static_model_params(steps));
}

TEST_CASE("a file names where it starts from and what differs") {
    const test::Temporary folder;
    const auto write = [&](const std::string& text) {
        write_file(folder / "mine.json", text);
        return (folder / "mine.json").string();
    };
    const Configuration mine = find_configuration(write(
        R"({"configuration": "baseline-x", "rate.sh": 1e-3, "ao": "none", "fine_levels": "region", "mlp.width": 32})"));
    CHECK(mine.name == "mine");
    CHECK(mine.avatar.heads == Heads::separate);
    CHECK(mine.avatar.appearance.sh_rate == 1e-3);
    CHECK(mine.avatar.ao == AmbientOcclusion::none);
    CHECK(mine.fine_levels == FineLevels::region);
    CHECK(mine.avatar.appearance.field.width == 32);
    CHECK(find_configuration(write(R"({"configuration": "no-depth"})")).name == "no-depth");
    CHECK(find_configuration("no-ao").avatar.ao == AmbientOcclusion::none);
    Configuration changed = named_configuration(default_configuration); // a file without a configuration changes this
    set_setting(changed, "rate.sh", "0.001", "test");
    CHECK(settings_of(find_configuration(write(R"({"rate.sh": 1e-3})"))) == settings_of(changed));
    CHECK(find_configuration(write("{}")).name == default_configuration);

    const auto refused = [&](const std::string& text, const char* message) {
        CHECK_THROWS_WITH((void)find_configuration(write(text)), doctest::Contains(message));
    };
    refused("{", "mine.json");
    refused("[1]", "must hold one JSON object");
    const std::string file = (folder / "mine.json").string();
    refused(R"({"configuration": 3})", (file + ": there is no configuration '3'").c_str());
    refused(R"({"configuration": "x"})", (file + ": there is no configuration 'x', expected one of paper").c_str());
    refused(R"({"configuration": "x"})", "pose-ao, light, static");
    refused(R"({"configuration": "static"})", (file + ": static is no person's").c_str());
    refused(R"({"rate.sh": -1})", (file + ": rate.sh is '-1', expected a number of at least 0").c_str());
    refused(R"({"ao.start": 2})", (file + ": ao.start is '2'").c_str());
    refused(R"({"rate.sh": [1]})", "rate.sh must be a number");
    refused(R"({"rate.sh": null})", "rate.sh must be a number");
    refused(R"({"rate.tables": 1})", "there is no setting 'rate.tables'");
    CHECK_THROWS_AS((void)find_configuration((folder / "none.json").string()), IoError);
    CHECK_THROWS_WITH_AS((void)find_static_configuration(write(R"({"configuration": "static", "sh_degree": 5})"), 100),
                         (file + ": sh_degree is '5', expected a whole number of at least 0 and at most 4").c_str(),
                         ValueError);
}

TEST_CASE("a name that no configuration has is refused with the option, and with all that would do") {
    std::string names;
    for (const std::string_view name : configuration_names) names.append(name).append(", ");
    CHECK_THROWS_WITH_AS(
        (void)find_configuration("papr", "--config"),
        ("--config: there is no configuration 'papr', expected one of " + names + "static, or a JSON file of settings")
            .c_str(),
        ValueError);
    CHECK_THROWS_WITH_AS((void)find_configuration("static", "--config"), doctest::Contains("--config: static is no"),
                         ValueError);
}
