// SPDX-License-Identifier: Apache-2.0
/// @file  The kind and the version that gsh's own files state.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

namespace gsh::detail {

/// The name of a text "KIND VERSION" in gsh's own files: a member of an archive or of a JSON object. Motions, bodies
/// and JSON files without it are of version 1 of their kind; the next version will state it.
inline constexpr const char* format_member = "gsh_format";

/// Throws unless `format` is `kind` in one of the versions `oldest` to `newest`. Without a kind, any kind will do.
///
/// Errors  IoError, beginning with `file`, that names what was found and what is read.
inline void check_format(const std::string& file, const std::string& format, std::string_view kind, int newest,
                         int oldest) {
    const std::size_t space = std::min(format.find(' '), format.size());
    const std::string found(format, 0, space), version(format, std::min(space + 1, format.size()));
    const std::string expected_kind = kind.empty() ? shortened(found) : std::string(kind);
    const auto named = [&](int number) { return "'" + expected_kind + " " + std::to_string(number) + "'"; };
    const std::string expected = (oldest < newest ? named(oldest) + " to " : "") + named(newest);
    if (!kind.empty() && found != kind)
        throw IoError(file + ": holds '" + shortened(format) + "', expected " + expected +
                      "; give the file of that kind");
    for (int read = oldest; read <= newest; ++read)
        if (version == std::to_string(read)) return;
    // As texts, since a number of a damaged file may be of any length.
    const bool digits = !version.empty() && version[0] != '0' &&
                        version.find_first_not_of("0123456789") == std::string::npos;
    const std::string last = std::to_string(newest);
    const bool later = version.size() > last.size() || (version.size() == last.size() && version > last);
    throw IoError(file + ": holds '" + shortened(format) + "', but this program reads " + expected + "; " +
                  (!digits ? "the file is damaged"
                   : later ? "take the later version of gsh that wrote it"
                           : "make the file again, or take the older version of gsh that wrote it"));
}

} // namespace gsh::detail
