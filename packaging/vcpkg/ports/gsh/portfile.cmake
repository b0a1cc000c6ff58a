# The port of a checkout of gsh: vcpkg install gsh --overlay-ports=GSH/packaging/vcpkg/ports
# It has the core. gsh::io needs libraries of stb and tinygltf, whose ports have headers only.
get_filename_component(SOURCE_PATH "${CMAKE_CURRENT_LIST_DIR}/../../../.." ABSOLUTE)
if(NOT EXISTS "${SOURCE_PATH}/include/gsh/core/config.hpp")
  message(FATAL_ERROR "${SOURCE_PATH} is not a checkout of gsh; give --overlay-ports the folder packaging/vcpkg/ports of one")
endif()

set(VCPKG_BUILD_TYPE release) # headers only
vcpkg_cmake_configure(
  SOURCE_PATH "${SOURCE_PATH}"
  OPTIONS -DGSH_BUILD_TESTS=OFF -DGSH_BUILD_EXAMPLES=OFF -DGSH_BUILD_BENCH=OFF -DGSH_REQUIRE_COMPONENTS=OFF
          -DCMAKE_DISABLE_FIND_PACKAGE_libzip=ON # also where the machine has what gsh::io needs
)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH share/cmake/gsh)
vcpkg_fixup_pkgconfig()
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE")
