# cmake -D way=find_package|add_subdirectory|cuda -D source_dir=… -D build_dir=… -D generator=… -D compiler=…
#       [-D nvcc=…] -P check.cmake
# Builds and runs the project beside this file (for cuda, the one in cuda/), and checks that none of our own build
# settings reached it.
set(work ${build_dir}/package/${way})
file(REMOVE_RECURSE ${work})
file(MAKE_DIRECTORY ${work})

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    list(JOIN ARGN " " command)
    message(FATAL_ERROR "${command}\n${output}")
  endif()
endfunction()

set(project ${CMAKE_CURRENT_LIST_DIR})
if(way STREQUAL "cuda")
  set(project ${CMAKE_CURRENT_LIST_DIR}/cuda)
endif()
if(NOT way STREQUAL "add_subdirectory")
  run(${CMAKE_COMMAND} --install ${build_dir} --prefix ${work}/prefix)
  set(how -D CMAKE_PREFIX_PATH=${work}/prefix)
else()
  set(how -D GSH_SUBDIRECTORY=${source_dir})
endif()

if(way STREQUAL "cuda")
  list(APPEND how -D CMAKE_CUDA_COMPILER=${nvcc} -D CMAKE_CUDA_HOST_COMPILER=${compiler}
       -D CMAKE_CUDA_ARCHITECTURES=90) # CMake's default is one that nvcc 13 has no more
endif()
run(${CMAKE_COMMAND} -S ${project} -B ${work}/build -G ${generator} -D CMAKE_CXX_COMPILER=${compiler} ${how})

file(READ ${work}/build/compile_commands.json commands)
foreach(flag IN ITEMS -Wall -Wextra -Wpedantic -Wshadow -Werror -march -ffp-contract -fsanitize -O)
  string(FIND "${commands}" " ${flag}" position)
  if(NOT position EQUAL -1)
    message(FATAL_ERROR "our flag ${flag} reached a user's build:\n${commands}")
  endif()
endforeach()

if(NOT way STREQUAL "cuda")
  file(READ ${work}/build/CMakeFiles/consumer_of_all_precompiled.dir/cmake_pch.hxx precompiled)
  if(NOT precompiled MATCHES "#include <gsh/gsh.hpp>")
    message(FATAL_ERROR "gsh_precompile without headers does not precompile gsh/gsh.hpp:\n${precompiled}")
  endif()
endif()

run(${CMAKE_COMMAND} --build ${work}/build --parallel)
run(${work}/build/consumer)
