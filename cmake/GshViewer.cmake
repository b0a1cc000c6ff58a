# The page of gsh-view (programs/web/, compiled in as text) and its server (programs/view/).
find_package(PkgConfig REQUIRED)
pkg_check_modules(httplib REQUIRED IMPORTED_TARGET GLOBAL cpp-httplib)
pkg_check_modules(turbojpeg REQUIRED IMPORTED_TARGET GLOBAL libturbojpeg)

set(web ${PROJECT_SOURCE_DIR}/programs/web)
file(GLOB web_names RELATIVE ${web} CONFIGURE_DEPENDS ${web}/*.html ${web}/*.css ${web}/*.js)
set(web_files ${web_names})
list(TRANSFORM web_files PREPEND ${web}/)
list(JOIN web_names "," web_names)
set(web_source ${CMAKE_CURRENT_BINARY_DIR}/web_files.cpp)
add_custom_command(
  OUTPUT ${web_source}
  COMMAND ${CMAKE_COMMAND} -D folder=${web} -D names=${web_names} -D output=${web_source}
          -P ${PROJECT_SOURCE_DIR}/cmake/EmbedFiles.cmake
  DEPENDS ${web_files} ${PROJECT_SOURCE_DIR}/cmake/EmbedFiles.cmake
  VERBATIM)

file(GLOB viewer_sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/programs/view/*.cpp)
add_custom_target(gsh_web_files DEPENDS ${web_source}) # written once, for several libraries

# gsh_add_viewer(name programs): adds a library with both, for programs that link the library `programs`.
function(gsh_add_viewer name programs)
  add_library(${name} STATIC ${viewer_sources} ${web_source})
  target_link_libraries(${name} PUBLIC ${programs} PkgConfig::httplib PRIVATE PkgConfig::turbojpeg)
  if(GSH_JOIN_SOURCES)
    set_target_properties(${name} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
    target_compile_options(${name} PRIVATE ${gsh_joined_options}) # not gsh_brief_options, see there
  endif()
  add_dependencies(${name} gsh_web_files)
endfunction()
