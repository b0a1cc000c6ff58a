// SPDX-License-Identifier: Apache-2.0
/// @file  CHECK(text == contains("part")): a failed check prints the text and the part.
#pragma once

#include <ostream>
#include <string>
#include <string_view>

namespace gsh::test {

/// Equal to every text that contains `part`.
struct Containing {
    std::string part;

    friend bool operator==(std::string_view text, const Containing& containing) {
        return text.find(containing.part) != std::string_view::npos;
    }
    friend std::ostream& operator<<(std::ostream& out, const Containing& containing) {
        return out << "a text with \"" << containing.part << '"';
    }
};

[[nodiscard]] inline Containing contains(std::string_view part) {
    return {std::string(part)};
}

} // namespace gsh::test
