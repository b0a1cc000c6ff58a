# Finds stb as Debian packages it: <stb/stb_image.h> and a library with the implementations. If a package has only the
# headers, stb::stb is header-only, and one source file of the program must define STB_IMAGE_IMPLEMENTATION.
find_path(stb_INCLUDE_DIR stb/stb_image.h)
find_library(stb_LIBRARY stb)
mark_as_advanced(stb_INCLUDE_DIR stb_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(stb REQUIRED_VARS stb_INCLUDE_DIR)

if(stb_FOUND AND NOT TARGET stb::stb)
  add_library(stb::stb INTERFACE IMPORTED)
  target_include_directories(stb::stb SYSTEM INTERFACE ${stb_INCLUDE_DIR})
  if(stb_LIBRARY)
    target_link_libraries(stb::stb INTERFACE ${stb_LIBRARY})
  endif()
endif()
