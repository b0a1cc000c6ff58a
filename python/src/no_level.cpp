// SPDX-License-Identifier: Apache-2.0
/// @file  What is loaded as libgsh-python where the dynamic loader takes none of the libraries for an instruction set.
///
/// From glibc 2.33 on, this means that the processor has none of them. Older ones do not look into glibc-hwcaps/, so the
/// library is chosen here.

#include "posing_interface.hpp"

#include <dlfcn.h>
#ifdef __GLIBC__
#include <gnu/libc-version.h>
#endif

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

/// Whether the dynamic loader chooses among the libraries itself.
bool loader_chooses() {
#ifdef __GLIBC__
    int major = 0, minor = 0;
    return std::sscanf(gnu_get_libc_version(), "%d.%d", &major, &minor) != 2 || major != 2 || minor >= 33;
#else
    return true;
#endif
}

struct Chosen {
    void* library = nullptr;
    std::string refusal;

    Chosen() {
        refusal = "this processor has none of the instruction sets that the package was built for "
                  "(" GSH_PYTHON_LEVELS ")";
        if (loader_chooses()) return;
        __builtin_cpu_init();
        const char* const level = __builtin_cpu_supports("x86-64-v4") && has("x86-64-v4")   ? "x86-64-v4"
                                  : __builtin_cpu_supports("x86-64-v3") && has("x86-64-v3") ? "x86-64-v3"
                                                                                             : nullptr;
        Dl_info self{};
        if (level == nullptr || dladdr(reinterpret_cast<const void*>(&gsh_python_api), &self) == 0) return;
        std::string path = self.dli_fname;
        const auto slash = path.rfind('/');
        path = (slash == std::string::npos ? "" : path.substr(0, slash + 1)) + "glibc-hwcaps/" + level +
               "/libgsh-python.so";
        library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
        if (library == nullptr) refusal = dlerror();
    }

    /// Whether the package was built for a level.
    static bool has(const char* level) { return std::strstr(GSH_PYTHON_LEVELS, level) != nullptr; }

    template <class Function>
    [[nodiscard]] Function function(const char* name) const {
        return library == nullptr ? nullptr : reinterpret_cast<Function>(dlsym(library, name));
    }
};

const Chosen& chosen() {
    static const Chosen one;
    return one;
}

} // namespace

extern "C" const gsh_python::Api* gsh_python_api() {
    if (const auto function = chosen().function<decltype(&gsh_python_api)>("gsh_python_api")) return function();
    static const std::string refusal = "gsh: " + chosen().refusal;
    static const gsh_python::Api none = [] {
        gsh_python::Api api{};
        api.refusal = refusal.c_str();
        return api;
    }();
    return &none;
}

extern "C" const gsh_python::PosingApi* gsh_python_posing_api() {
    const auto function = chosen().function<decltype(&gsh_python_posing_api)>("gsh_python_posing_api");
    return function != nullptr ? function() : nullptr;
}

extern "C" int gsh_run_program(const char* name, int argc, char** argv) {
    if (const auto function = chosen().function<int (*)(const char*, int, char**)>("gsh_run_program"))
        return function(name, argc, argv);
    std::fprintf(stderr, "%s: %s\n", name, chosen().refusal.c_str());
    return 2;
}
