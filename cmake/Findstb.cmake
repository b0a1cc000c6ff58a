# stb as Debian ships it: <stb/stb_image.h> and a library with the implementations. Where a packager ships the headers
# alone, stb::stb is header-only, and one source of the program defines STB_IMAGE_IMPLEMENTATION itself.
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
