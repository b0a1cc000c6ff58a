// SPDX-License-Identifier: Apache-2.0
/// @file  Each public reader of foreign bytes in io/ has a fuzz target: tests/fuzz names it, or what calls it.
#include <gsh/io/file/input_file.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace {

bool is_name(char c) {
    return std::isalnum(static_cast<unsigned char>(c)) || c == '_';
}

/// The names in a text.
std::set<std::string> names_in(std::string_view text) {
    std::set<std::string> names;
    for (std::size_t i = 0; i < text.size(); ++i) {
        std::size_t end = i;
        while (end < text.size() && is_name(text[end])) ++end;
        if (end > i && !std::isdigit(static_cast<unsigned char>(text[i]))) names.emplace(text.substr(i, end - i));
        if (end > i) i = end;
    }
    return names;
}

/// C++ without comments, literals and preprocessor lines.
std::string bare_code(std::string_view text) {
    std::string code;
    for (std::size_t i = 0; i < text.size();) {
        const std::string_view rest = text.substr(i);
        const auto skip_to = [&](std::string_view end, std::size_t from) {
            const std::size_t at = rest.find(end, from);
            i = at == std::string_view::npos ? text.size() : i + at + end.size();
        };
        if (rest.starts_with("//") || (rest[0] == '#' && (code.empty() || code.back() == '\n'))) {
            skip_to("\n", 0);
            code += '\n';
        } else if (rest.starts_with("/*")) {
            skip_to("*/", 2);
        } else if (rest.starts_with("R\"") && (code.empty() || !is_name(code.back()))) {
            skip_to(")" + std::string(rest.substr(2, rest.find('(') - 2)) + "\"", 2);
        } else if (rest[0] == '"' || (rest[0] == '\'' && !(code.size() > 0 && std::isdigit(code.back())))) {
            std::size_t end = 1;
            while (end < rest.size() && rest[end] != rest[0]) end += rest[end] == '\\' ? 2 : 1;
            i += std::min(end + 1, rest.size());
        } else {
            code += text[i++];
        }
    }
    return code;
}

/// A function, a class or a table at the scope of a namespace.
struct Entity {
    std::string name; ///< of a member function that is defined outside of its class: the class
    std::string head; ///< up to the body
    std::string body; ///< empty for a declaration
    bool is_class = false, is_detail = false;
};

/// The names and lengths of a head's parts that decide what it declares.
Entity entity_of(std::string head, std::string body, bool is_detail) {
    Entity entity{{}, std::move(head), std::move(body), false, is_detail};
    int parentheses = 0, angles = 0;
    std::string last, before;
    bool qualified = false;
    for (std::size_t i = 0; i < entity.head.size(); ++i) {
        const char c = entity.head[i];
        if (c == '<') ++angles;
        if (c == '>' && (i == 0 || entity.head[i - 1] != '-')) angles = std::max(angles - 1, 0);
        if (c == ')') --parentheses;
        if (c == '(' && parentheses++ == 0 && angles == 0 && !last.empty() && last != "requires") {
            entity.name = qualified ? before : last;
            return entity;
        }
        if (c == '=' && parentheses == 0 && angles == 0) { // a table, whose braces may be within parentheses
            entity.body += entity.head.substr(i);
            break;
        }
        if (parentheses > 0 || angles > 0 || !is_name(c)) continue;
        std::size_t end = i;
        while (end < entity.head.size() && is_name(entity.head[end])) ++end;
        const std::string word = entity.head.substr(i, end - i);
        qualified = i >= 2 && entity.head.compare(i - 2, 2, "::") == 0;
        before = std::exchange(last, word);
        if (before == "class" || before == "struct" || before == "union") {
            entity.is_class = true, entity.name = word;
            return entity;
        }
        i = end - 1;
    }
    entity.name = last;
    return entity;
}

/// Reads what stands in a namespace, from `at` on, up to its end.
void read_namespace(std::string_view code, std::size_t& at, bool is_detail, std::vector<Entity>& found) {
    std::string head;
    for (int parentheses = 0; at < code.size(); ++at) {
        const char c = code[at];
        parentheses += (c == '(') - (c == ')');
        if (parentheses > 0 || (c != ';' && c != '{' && c != '}')) {
            head += c;
            continue;
        }
        if (c == '}') return;
        const std::set<std::string> words = names_in(head);
        if (c == '{' && words.contains("namespace")) {
            const bool hides = words.contains("detail") || words.size() == 1; // or without a name
            read_namespace(code, ++at, is_detail || hides, found);
        } else {
            const std::size_t begin = at;
            for (int depth = 0; c == '{' && at < code.size(); ++at) {
                depth += (code[at] == '{') - (code[at] == '}');
                if (depth == 0) break;
            }
            if (!words.empty())
                found.push_back(entity_of(head, std::string(code.substr(begin, at - begin)), is_detail));
        }
        head.clear();
    }
}

std::vector<Entity> entities_of(std::string_view text) {
    std::vector<Entity> found;
    const std::string code = bare_code(text);
    std::size_t at = 0;
    read_namespace(code, at, false, found);
    return found;
}

/// Whether users can give it a file or a folder to read.
bool is_public_reader(const Entity& entity) {
    if (entity.is_detail || entity.name == "operator") return false;
    if (entity.is_class) return entity.body.find(entity.name + "(const InputFile&") != std::string::npos;
    if (entity.head.find(entity.name + "(") == std::string::npos) return false; // a table, or a member of a class
    if (entity.head.find("const InputFile&") != std::string::npos) return true;
    const bool reads =
        entity.name.starts_with("read_") || entity.name.starts_with("load_") || entity.name.starts_with("recognise_");
    return reads && entity.head.find("filesystem::path") != std::string::npos;
}

/// Public readers that neither `fuzz`, the text of the fuzz targets, nor what it names calls: "b.hpp: read_b". A call is
/// followed through functions, classes and tables of the headers.
std::set<std::string> readers_without_target(const std::map<std::string, std::string>& headers,
                                             const std::string& fuzz) {
    std::vector<std::pair<std::string, Entity>> entities;
    std::map<std::string, std::set<std::string>> names_of_entity;
    for (const auto& [path, text] : headers)
        for (Entity& entity : entities_of(text)) {
            names_of_entity[entity.name].merge(names_in(entity.body));
            entities.emplace_back(path, std::move(entity));
        }
    std::set<std::string> reached;
    std::vector<std::string> open;
    for (const std::string& name : names_in(bare_code(fuzz))) open.push_back(name);
    while (!open.empty()) {
        const std::string name = open.back();
        open.pop_back();
        if (!reached.insert(name).second) continue;
        if (const auto at = names_of_entity.find(name); at != names_of_entity.end())
            open.insert(open.end(), at->second.begin(), at->second.end());
    }
    std::set<std::string> missing;
    for (const auto& [path, entity] : entities)
        if (is_public_reader(entity) && !reached.contains(entity.name)) missing.insert(path + ": " + entity.name);
    return missing;
}

std::map<std::string, std::string> texts_below(const std::filesystem::path& folder, std::string_view ending) {
    std::map<std::string, std::string> texts;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
        if (entry.path().extension() == ending)
            texts[std::filesystem::relative(entry.path(), folder).generic_string()] = gsh::read_file(entry.path());
    return texts;
}

} // namespace

TEST_CASE("each public reader of io/ has a fuzz target") {
    const std::filesystem::path root = GSH_SOURCE_DIR;
    auto headers = texts_below(root / "include" / "gsh" / "io", ".hpp");
    CHECK(headers.size() > 80);
    headers.erase("file/input_file.hpp"); // the door itself: InputStream and read_file, which all readers call
    std::string fuzz;
    for (const auto& [path, text] : texts_below(root / "tests" / "fuzz", ".cpp")) fuzz += text;
    for (const std::string& reader : readers_without_target(headers, fuzz))
        CHECK_MESSAGE(false, reader << " has no fuzz target: no file of tests/fuzz names it, or what calls it");
    CHECK(readers_without_target(headers, "").size() > 40); // the check sees the readers
}

TEST_CASE("the check of fuzz targets finds a reader without one") {
    const std::map<std::string, std::string> headers{
        {"a.hpp", "namespace gsh {\n"
                  "/// read_nothing(const InputFile& file) in a comment\n"
                  "[[nodiscard]] inline A read_a(const InputFile& file, Options o = {});\n"
                  "inline void write_a(const std::filesystem::path& path, const A& a);\n"
                  "namespace detail {\ninline A read_inner(const InputFile& file) { return called(file); }\n}\n"
                  "inline A read_a(const InputFile& file, Options o) { return detail::read_inner(file); }\n"
                  "inline A called(const InputFile& file) { return {}; }\n}"},
        {"b.hpp", "namespace gsh {\nclass Table {\npublic:\n    explicit Table(const InputFile& file) : at_{0} {}\n};\n"
                  "template <class E>\n    requires(true)\nB load_b(E& e, const std::filesystem::path& folder);\n"
                  "inline constexpr std::array kinds = std::to_array<Kind>({{\"c\", load_c}});\n"
                  "inline C load_c(const std::filesystem::path& folder) { return {}; }\n}"}};
    using Readers = std::set<std::string>;
    CHECK(readers_without_target(headers, "") ==
          Readers{"a.hpp: called", "a.hpp: read_a", "b.hpp: Table", "b.hpp: load_b", "b.hpp: load_c"});
    CHECK(readers_without_target(headers, "run(read_a(file)); // load_b") ==
          Readers{"b.hpp: Table", "b.hpp: load_b", "b.hpp: load_c"});
    CHECK(readers_without_target(headers, "read_a(f); kinds; Table(f); load_b(e, f);").empty());
}
