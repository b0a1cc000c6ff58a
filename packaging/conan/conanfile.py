"""gsh for Conan 2: `conan create packaging/conan` in a checkout of gsh. docs/packages.md describes it."""

import re
from pathlib import Path

from conan import ConanFile
from conan.tools.build import check_min_cppstd
from conan.tools.cmake import CMake, CMakeDeps, CMakeToolchain, cmake_layout
from conan.tools.files import copy

required_conan_version = ">=2.0"


class GshConan(ConanFile):
    name = "gsh"
    description = "Animatable 3D Gaussian humans, header-only C++20"
    license = "Apache-2.0"
    topics = ("gaussian-splatting", "avatars", "header-only")
    package_type = "header-library"
    settings = "os", "arch", "compiler", "build_type"
    options = {"system_libraries": [True, False]}  # take Eigen, GLM and oneTBB from the machine, not from Conan
    default_options = {"system_libraries": False}
    no_copy_source = True

    def _checkout(self):
        return Path(self.recipe_folder).parent.parent

    def set_version(self):
        text = (self._checkout() / "include/gsh/core/config.hpp").read_text()
        self.version = ".".join(re.findall(r"#define GSH_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", text))

    def export_sources(self):
        for pattern in ("CMakeLists.txt", "LICENSE", "cmake/*", "include/*"):
            copy(self, pattern, src=self._checkout(), dst=self.export_sources_folder)

    def layout(self):
        cmake_layout(self)

    def requirements(self):
        if not self.options.system_libraries:
            self.requires("eigen/3.4.0", transitive_headers=True)
            self.requires("glm/cci.20230113", transitive_headers=True)
            self.requires("onetbb/2021.12.0", transitive_headers=True, transitive_libs=True)

    def validate(self):
        check_min_cppstd(self, 20)

    def package_id(self):
        self.info.clear()

    def generate(self):
        CMakeDeps(self).generate()
        toolchain = CMakeToolchain(self)
        for part in ("TESTS", "EXAMPLES", "BENCH"):
            toolchain.cache_variables[f"GSH_BUILD_{part}"] = False
        toolchain.cache_variables["GSH_REQUIRE_COMPONENTS"] = False
        toolchain.generate()

    def build(self):
        cmake = CMake(self)
        cmake.configure()

    def package(self):
        copy(self, "LICENSE", src=self.source_folder, dst=Path(self.package_folder) / "licenses")
        CMake(self).install()

    def package_info(self):
        # gsh's own CMake files serve a user's project, so that targets and components are those of every other way.
        self.cpp_info.bindirs = self.cpp_info.libdirs = []
        self.cpp_info.set_property("cmake_find_mode", "none")
        self.cpp_info.builddirs = ["share/cmake/gsh"]
