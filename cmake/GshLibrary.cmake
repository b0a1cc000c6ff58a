# The targets that a program links. gsh::gsh is the core: all folders but those below, with Eigen, GLM and oneTBB. The
# others are opt-in components. Each is a target with the dependencies of its folder:
#   gsh::io           io/           libzip, zlib, zstd, stb, nlohmann-json, tinygltf
#   gsh::check        check/        those of gsh::io
#   gsh::reconstruct  reconstruct/  those of gsh::io
#   gsh::synthetic    synthetic/    Embree, and those of gsh::io
#   gsh::cuda         *.cuh         CUDA's runtime; sources that include a .cuh are compiled by nvcc
set(gsh_components io check reconstruct synthetic cuda)

include(GshPrecompile) # a function for users' targets, which the installed package has, too

find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(glm REQUIRED)
find_package(TBB REQUIRED)
find_package(Threads REQUIRED)

set(gsh_include_dir ${PROJECT_SOURCE_DIR}/include)
file(GLOB_RECURSE gsh_headers CONFIGURE_DEPENDS ${gsh_include_dir}/gsh/*.hpp)
foreach(component IN LISTS gsh_components)
  set(gsh_${component}_headers ${gsh_headers})
  list(FILTER gsh_${component}_headers INCLUDE REGEX "/gsh/${component}/")
  list(FILTER gsh_headers EXCLUDE REGEX "/gsh/${component}/")
endforeach()
file(GLOB_RECURSE gsh_cuda_headers CONFIGURE_DEPENDS ${gsh_include_dir}/gsh/*.cuh)

add_library(gsh INTERFACE)
add_library(gsh::gsh ALIAS gsh)
target_sources(gsh INTERFACE FILE_SET HEADERS BASE_DIRS ${gsh_include_dir} FILES ${gsh_headers})
target_compile_features(gsh INTERFACE cxx_std_20)
target_link_libraries(gsh INTERFACE glm::glm Eigen3::Eigen TBB::tbb Threads::Threads)

# gsh_add_component(name targets...): adds the opt-in target gsh::name with its headers and their dependencies.
function(gsh_add_component name)
  add_library(gsh_${name} INTERFACE)
  add_library(gsh::${name} ALIAS gsh_${name})
  set_target_properties(gsh_${name} PROPERTIES EXPORT_NAME ${name})
  target_sources(gsh_${name} INTERFACE FILE_SET HEADERS BASE_DIRS ${gsh_include_dir} FILES ${gsh_${name}_headers})
  target_link_libraries(gsh_${name} INTERFACE gsh ${ARGN})
endfunction()

# A component exists if its libraries are found.
option(GSH_REQUIRE_COMPONENTS "Stop where a library of an opt-in component is missing" ${PROJECT_IS_TOP_LEVEL})
if(GSH_REQUIRE_COMPONENTS)
  set(gsh_need REQUIRED)
else()
  set(gsh_need QUIET)
endif()
find_package(libzip ${gsh_need} MODULE)
find_package(ZLIB ${gsh_need} MODULE)
find_package(zstd ${gsh_need} MODULE)
find_package(stb ${gsh_need} MODULE)
find_package(nlohmann_json ${gsh_need})
find_package(tinygltf ${gsh_need} MODULE)
find_package(embree 3 ${gsh_need})
find_package(CUDAToolkit QUIET) # optional everywhere

if(libzip_FOUND AND ZLIB_FOUND AND zstd_FOUND AND stb_FOUND AND nlohmann_json_FOUND AND tinygltf_FOUND)
  gsh_add_component(io libzip::zip ZLIB::ZLIB zstd::zstd stb::stb nlohmann_json::nlohmann_json tinygltf::tinygltf)
  gsh_add_component(check gsh_io)
  gsh_add_component(reconstruct gsh_io)
  if(embree_FOUND)
    gsh_add_component(synthetic gsh_io embree)
  endif()
endif()
if(CUDAToolkit_FOUND OR GSH_INSTALL) # a package may be made where there is no CUDA
  gsh_add_component(cuda CUDA::cudart)
  # CMake 3.25 does not know that nvcc has C++20, so the feature cuda_std_20 would be an error.
  target_compile_options(gsh_cuda INTERFACE $<$<COMPILE_LANG_AND_ID:CUDA,NVIDIA>:-std=c++20>)
  # `cmake --preset dev` compiles each header of a file set alone, with the C++ compiler; .cuh headers need nvcc.
  set_target_properties(gsh_cuda PROPERTIES VERIFY_INTERFACE_HEADER_SETS OFF)
endif()
