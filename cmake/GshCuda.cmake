# Device code of gsh's own tests and programs. Custom commands call nvcc, so configuring needs neither CUDA nor a GPU.
set(GSH_CUDA AUTO CACHE STRING "Compile device code with nvcc: AUTO (if nvcc is found), ON or OFF")
set_property(CACHE GSH_CUDA PROPERTY STRINGS AUTO ON OFF)
option(GSH_PROGRAMS_CUDA "Build the programs with --backend cuda" OFF)
find_program(GSH_NVCC nvcc HINTS ENV CUDA_HOME PATHS /usr/local/cuda PATH_SUFFIXES bin)
set(GSH_CUDA_ARCHITECTURES sm_90 CACHE STRING
    "Architectures of device code: one, as for nvcc -arch, or a list such as sm_80;sm_90;compute_90 (PTX)")

set(gsh_with_cuda OFF)
if(GSH_CUDA AND GSH_NVCC AND NOT GSH_SANITIZE)
  set(gsh_with_cuda ON)
elseif(GSH_CUDA STREQUAL "ON" AND NOT GSH_NVCC)
  message(FATAL_ERROR "GSH_CUDA is ON, but nvcc is not found; put it into PATH, or set GSH_CUDA to AUTO")
elseif(GSH_PROGRAMS_CUDA AND GSH_BUILD_EXAMPLES)
  message(FATAL_ERROR "GSH_PROGRAMS_CUDA needs nvcc in PATH, GSH_CUDA other than OFF, and no sanitizer")
endif()

list(LENGTH GSH_CUDA_ARCHITECTURES count)
if(count EQUAL 1)
  set(gsh_nvcc_architectures -arch=${GSH_CUDA_ARCHITECTURES})
else()
  set(gsh_nvcc_architectures)
  foreach(architecture IN LISTS GSH_CUDA_ARCHITECTURES)
    if(NOT architecture MATCHES "^(sm|compute)_([0-9]+[af]?)$")
      message(FATAL_ERROR "GSH_CUDA_ARCHITECTURES has \"${architecture}\" in a list, expected sm_N or compute_N")
    endif()
    list(APPEND gsh_nvcc_architectures -gencode=arch=compute_${CMAKE_MATCH_2},code=${architecture})
  endforeach()
endif()

# Without optimisation, GCC takes a quarter to a half less time for the host code. It suits tests that no GPU will run.
set(GSH_DEVICE_TESTS_HOST_OPTIMIZATION -O1 CACHE STRING "Optimisation of host code in nvcc's tests: -O0 or -O1")

# The middle of a command that compiles device code with warnings as errors. In front of it come nvcc.sh and the name of
# a report, which scripts/kernel-registers reads. -O is for host code; device code is always optimised.
set(gsh_nvcc_report ${PROJECT_SOURCE_DIR}/cmake/nvcc.sh)
set(gsh_eigen_includes $<TARGET_PROPERTY:Eigen3::Eigen,INTERFACE_INCLUDE_DIRECTORIES>)
set(gsh_nvcc_command
    ${GSH_NVCC} -std=c++20 ${gsh_nvcc_architectures} --Werror all-warnings -Xcompiler -Wall,-Wextra,-Werror
    -I${PROJECT_SOURCE_DIR}/include "-isystem=$<JOIN:${gsh_eigen_includes},$<SEMICOLON>-isystem=>")

# As in gsh_joined_options, for the host compiler.
set(gsh_nvcc_joined_options)
if(gsh_collector_options)
  list(JOIN gsh_collector_options "," gsh_nvcc_joined_options)
  list(PREPEND gsh_nvcc_joined_options -Xcompiler)
endif()

# Host code beside device code is compiled like that of gsh_project, because the linker merges the functions that both
# compilers emit. This follows -Xcompiler.
set(gsh_host_options -ffp-contract=off,-fno-math-errno)
if(GSH_NATIVE)
  string(APPEND gsh_host_options ",-march=native")
endif()

# gsh_add_device_code(target sources...): compiles .cu files with nvcc into objects of a target.
function(gsh_add_device_code target)
  # Off, because nvcc.sh takes any output for a failure.
  list(TRANSFORM gsh_inlining_warnings REPLACE "^-Wno-error=" "-Xcompiler=-Wno-" OUTPUT_VARIABLE host_warnings)
  foreach(source IN LISTS ARGN)
    set(object ${CMAKE_CURRENT_BINARY_DIR}/${source}.o)
    add_custom_command(
      OUTPUT ${object}
      COMMAND ${gsh_nvcc_report} ${object}.kernels ${gsh_nvcc_command} -O3 -Xcompiler ${gsh_host_options}
              ${host_warnings} $<$<CONFIG:Release>:-DNDEBUG>
              -I${CMAKE_CURRENT_SOURCE_DIR} -MD -MF ${object}.d -MT ${object}
              -c ${CMAKE_CURRENT_SOURCE_DIR}/${source} -o ${object}
      DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${source}
      DEPFILE ${object}.d COMMAND_EXPAND_LISTS VERBATIM
      COMMENT "Compiling ${source} with nvcc")
    target_sources(${target} PRIVATE ${object})
    set_source_files_properties(${object} PROPERTIES EXTERNAL_OBJECT ON GENERATED ON)
  endforeach()
  if(NOT TARGET CUDA::cudart_static)
    message(FATAL_ERROR "CMake finds no CUDA toolkit beside ${GSH_NVCC}; set CUDAToolkit_ROOT to its folder")
  endif()
  target_link_libraries(${target} PUBLIC CUDA::cudart_static)
endfunction()
