# What a program links. gsh::gsh is the core: all headers but those below, with Eigen, GLM and oneTBB. The rest is
# opt-in, each target with the dependencies of its headers:
#   gsh::simd       math/pack.hpp        xsimd
#   gsh::io         io/                  libzip, stb, nlohmann-json
#   gsh::synthetic  synthetic/           Embree (and gsh::io)
set(gsh_components simd io synthetic)

find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(glm REQUIRED)
find_package(TBB REQUIRED)
find_package(Threads REQUIRED)

set(gsh_include_dir ${PROJECT_SOURCE_DIR}/include)
file(GLOB_RECURSE gsh_headers CONFIGURE_DEPENDS ${gsh_include_dir}/gsh/*.hpp)
set(gsh_simd_headers ${gsh_headers})
set(gsh_io_headers ${gsh_headers})
set(gsh_synthetic_headers ${gsh_headers})
list(FILTER gsh_simd_headers INCLUDE REGEX "/gsh/math/pack\\.hpp$")
list(FILTER gsh_io_headers INCLUDE REGEX "/gsh/io/")
list(FILTER gsh_synthetic_headers INCLUDE REGEX "/gsh/synthetic/")
list(REMOVE_ITEM gsh_headers ${gsh_simd_headers} ${gsh_io_headers} ${gsh_synthetic_headers})

add_library(gsh INTERFACE)
add_library(gsh::gsh ALIAS gsh)
target_sources(gsh INTERFACE FILE_SET HEADERS BASE_DIRS ${gsh_include_dir} FILES ${gsh_headers})
target_compile_features(gsh INTERFACE cxx_std_20)
target_link_libraries(gsh INTERFACE glm::glm Eigen3::Eigen TBB::tbb Threads::Threads)

# gsh_add_component(name targets...): the opt-in target gsh::name with its headers and what they need.
function(gsh_add_component name)
  add_library(gsh_${name} INTERFACE)
  add_library(gsh::${name} ALIAS gsh_${name})
  set_target_properties(gsh_${name} PROPERTIES EXPORT_NAME ${name})
  target_sources(gsh_${name} INTERFACE FILE_SET HEADERS BASE_DIRS ${gsh_include_dir} FILES ${gsh_${name}_headers})
  target_link_libraries(gsh_${name} INTERFACE gsh ${ARGN})
endfunction()

# A component comes with the libraries that it needs: as a subproject we take what is there, on our own we insist.
if(PROJECT_IS_TOP_LEVEL)
  set(gsh_need REQUIRED)
else()
  set(gsh_need QUIET)
endif()
find_package(xsimd ${gsh_need} MODULE)
find_package(libzip ${gsh_need} MODULE)
find_package(stb ${gsh_need} MODULE)
find_package(nlohmann_json ${gsh_need})
find_package(embree 3 ${gsh_need})

if(xsimd_FOUND)
  gsh_add_component(simd xsimd::headers)
endif()
if(libzip_FOUND AND stb_FOUND AND nlohmann_json_FOUND)
  gsh_add_component(io libzip::zip stb::stb nlohmann_json::nlohmann_json)
  if(embree_FOUND)
    gsh_add_component(synthetic gsh_io embree)
  endif()
endif()
