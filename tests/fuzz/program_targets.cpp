// SPDX-License-Identifier: Apache-2.0
// What the programs read beside the files of io/: command lines, settings, and what an earlier run stored.
#include "fuzz/target.hpp"

#include "common/program.hpp"
#include "common/stored_options.hpp"
#include "evaluate/evaluation_result.hpp"
#include "evaluate/evaluation_runs.hpp"
#include "export/export_options.hpp"
#include "reconstruct/reconstruct_command.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/io/file/json_file.hpp>
#include <gsh/setup/configuration.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::programs {

/// Takes the place of run_program in the sources of the programs below: the command line is read, and no work is done.
template <class Work>
int read_only(CLI::App& app, int argc, char** argv, const Work&) {
    parse_command_line(app, argc, argv);
    return exit_done;
}

} // namespace gsh::programs

#define run_program read_only
#define main gsh_animate_main
#include "gsh_animate.cpp"
#undef main
#define main gsh_body_main
#include "gsh_body.cpp"
#undef main
#define main gsh_check_main
#include "gsh_check.cpp"
#undef main
#define main gsh_evaluate_main
#include "gsh_evaluate.cpp"
#undef main
#define main gsh_export_main
#include "gsh_export.cpp"
#undef main
#define main gsh_fit_main
#include "gsh_fit.cpp"
#undef main
#define main gsh_motion_main
#include "gsh_motion.cpp"
#undef main
#define main gsh_reconstruct_main
#include "gsh_reconstruct.cpp"
#undef main
#define main gsh_render_main
#include "gsh_render.cpp"
#undef main
#define main gsh_video_main
#include "gsh_video.cpp"
#undef main
#define main gsh_view_main
#include "gsh_view.cpp"
#undef main
#undef run_program

namespace gsh::fuzz {

namespace {

using namespace gsh::programs;

/// The words of an input, one a line, as C strings.
std::vector<std::string> words_of(const InputFile& file) {
    std::vector<std::string> words;
    const std::string text = read_file(file);
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find('\n', begin), text.size());
        words.emplace_back(text.substr(begin, end - begin).c_str()); // up to a zero
        begin = end + 1;
    }
    return words;
}

/// Reads words as a command line, of which the first names the program.
template <class Main>
void read_line(std::vector<std::string> words, const Main& program) {
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    program(static_cast<int>(words.size()), arguments.data());
}

/// Whether a word may be looked up as a file: not one that waits for input, or has no end.
bool is_plain_word(const std::string& word) {
    return !word.starts_with("/dev") && !word.starts_with("/proc") && !word.starts_with("/sys");
}

/// Calls read(), where the errors that a user sees as one line are expected. They are of no file.
template <class Read>
void expect_one_line(const Read& read) {
    try {
        read();
    } catch (const CLI::ParseError& error) {
        must(error.get_exit_code() == 0 || error.what()[0] != '\0', "an error without a message");
    } catch (const Error& error) {
        must(error.what()[0] != '\0', "an error without a message");
    }
}

constexpr std::array<int (*)(int, char**), 11> mains{
    gsh_animate_main, gsh_body_main,   gsh_check_main,       gsh_evaluate_main, gsh_export_main, gsh_fit_main,
    gsh_motion_main,  gsh_render_main, gsh_reconstruct_main, gsh_video_main,    gsh_view_main};
constexpr std::array<std::string_view, 11> main_names{"gsh-animate",     "gsh-body",  "gsh-check",  "gsh-evaluate",
                                                      "gsh-export",      "gsh-fit",   "gsh-motion", "gsh-render",
                                                      "gsh-reconstruct", "gsh-video", "gsh-view"};

const Registered command_line_target("command-line", "words", [](const InputFile& file) {
    const std::vector<std::string> words = words_of(file);
    for (std::size_t i = 0; i < mains.size(); ++i)
        if (words[0] == main_names[i]) expect_one_line([&] { read_line(words, mains[i]); });
    for (const std::string& word : words)
        if (!is_plain_word(word)) return;
    // The checks that these programs make before they open a file.
    if (words[0] == "gsh-reconstruct")
        expect_one_line([&] {
            ReconstructOptions options;
            CLI::App app;
            ::add_options(app, options);
            read_line(words, [&](int argc, char** argv) { app.parse(argc, argv); });
            const std::string given = given_options(app, {"--out"});
            check_options(options);
            CLI::App again;
            ReconstructOptions restored;
            ::add_options(again, restored);
            restore_options(again, given, "again");
            must(restored.steps == options.steps || options.synthetic || is_scene(options),
                 "options that were stored come back with other steps");
        });
    if (words[0] == "gsh-evaluate")
        expect_one_line([&] {
            EvaluateOptions options;
            CLI::App app;
            ::add_options(app, options);
            read_line(words, [&](int argc, char** argv) { app.parse(argc, argv); });
            complete_poses(options.common);
            check_companions(options.common);
            options.common.priors.clear(); // would be read
            must(!planned_runs(options).empty(), "no run was planned");
        });
    if (words[0] == "gsh-export")
        expect_one_line([&] {
            ExportOptions options;
            CLI::App app;
            ::add_options(app, options);
            read_line(words, [&](int argc, char** argv) { app.parse(argc, argv); });
            (void)check_options(options);
            if (options.is_moving()) must(frames_of(options.frames, 1000).size() <= 1000, "--frames has frames twice");
        });
});

const Registered settings_target("setting", "settings", [](const InputFile& file) { // the words of several --set
    ReconstructOptions options;
    options.set = words_of(file);
    for (const std::string_view name : configuration_names) {
        options.config = std::string(name);
        expect_one_line([&] { (void)configuration_of(options); });
    }
    options.config = "static", options.steps = 100;
    expect_one_line([&] { (void)scene_configuration_of(options); });
});

const Registered stored_options_target("stored-options", "checkpoint", [](const InputFile& file) {
    ReconstructOptions options;
    CLI::App app;
    add_options(app, options);
    try {
        restore_options(app, read_file(file), file.name(), {"--steps", "--seconds"});
    } catch (const CLI::ParseError&) { // of a word that does not fit its option
    }
});

const Registered evaluation_target("evaluation-result", "result.json", [](const InputFile& file) {
    const auto parsed = [](const gsh::detail::Json& json, const std::string& name) {
        try {
            return result_of(json);
        } catch (const nlohmann::json::exception&) { // read_own_json adds the file's name
            throw IoError(name + ": is not in the form that gsh-evaluate writes");
        }
    };
    const std::string once = result_json(parsed(gsh::detail::read_json(file), file.name())).dump();
    const std::string twice =
        result_json(parsed(gsh::detail::parse_json(once, file.name()), "what was written again")).dump();
    must(once == twice, "a result that is written again and read again differs");
});

} // namespace

} // namespace gsh::fuzz
