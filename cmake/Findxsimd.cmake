# Finds xsimd by its header. The target that Debian 12 exports links a library "xtl", which does not exist.
find_path(xsimd_INCLUDE_DIR xsimd/xsimd.hpp)
mark_as_advanced(xsimd_INCLUDE_DIR)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(xsimd REQUIRED_VARS xsimd_INCLUDE_DIR)

if(xsimd_FOUND AND NOT TARGET xsimd::headers)
  add_library(xsimd::headers INTERFACE IMPORTED)
  target_include_directories(xsimd::headers SYSTEM INTERFACE ${xsimd_INCLUDE_DIR})
endif()
