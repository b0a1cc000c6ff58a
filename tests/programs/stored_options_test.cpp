// SPDX-License-Identifier: Apache-2.0
/// @file  Options that a checkpoint stores come back, and what given_options did not write is refused by one message.
#include "common/stored_options.hpp"
#include "support/contains.hpp"

#include <gsh/core/error.hpp>

#include <doctest/doctest.h>

#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct StoredCommand {
    CLI::App app;
    int steps = 0;
    std::vector<std::string> names;

    StoredCommand() {
        app.add_option("--steps", steps);
        app.add_option("--names", names);
    }
};

std::string restore_error(const std::string& text) {
    StoredCommand command;
    try {
        restore_options(command.app, text, "c.gsh");
    } catch (const Error& error) {
        return error.what();
    }
    return "none";
}

} // namespace

TEST_CASE("stored options come back where a command line leaves them out") {
    StoredCommand earlier, now;
    earlier.app.parse("--steps 7 --names a b");
    const std::string text = given_options(earlier.app, {});
    now.app.parse("--steps 8");
    restore_options(now.app, text, "c.gsh");
    CHECK(now.steps == 8);
    CHECK(now.names == std::vector<std::string>{"a", "b"});
}

TEST_CASE("stored options are compared in all that is not left out") {
    const auto text = [](const std::string& words) {
        StoredCommand command;
        command.app.parse(words);
        return given_options(command.app, {});
    };
    CHECK(same_options(text("--steps 7 --names a b"), text("--names a b --steps 7"), {}));
    CHECK(!same_options(text("--steps 7"), text("--steps 8"), {}));
    CHECK(!same_options(text("--steps 7"), text(""), {}));
    CHECK(same_options(text("--steps 7 --names a"), text("--steps 8 --names a"), {"--steps"}));
    CHECK(same_options(text(""), text(""), {}));
    for (const char* other : {"", "{", "[]", R"({"options": 3})"}) CHECK(!same_options(other, other, {}));
}

TEST_CASE("options that no program stored are refused") {
    const std::string cannot = "c.gsh: holds options that cannot be read; name all options again";
    CHECK(restore_error(R"({"options": {}})") == "none");
    CHECK(restore_error(R"([])") == cannot);
    CHECK(restore_error(R"({"options": 3})") == cannot);
    CHECK(restore_error(R"({"folder": 3, "options": {}})") == cannot);
    CHECK(restore_error(R"({"options": {"--steps": [3]}})") ==
          "c.gsh: --steps holds a word that is no text; name all options again");
    CHECK(restore_error(R"({"options": {"--none": ["3"]}})") ==
          test::contains("c.gsh: was written with --none, which is no option any more"));
    CHECK(restore_error("{") == test::contains("c.gsh: options: is not JSON"));
    CHECK(restore_error(std::string(100, '[')) == test::contains("c.gsh: options: "));
}
