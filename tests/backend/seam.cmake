# What the compiler makes of a translation unit that a backend's headers are kept out of.
#   cmake -D way=other -D command="COMPILER;FLAGS" -D source=other_backend_test.cpp -P seam.cmake
#       includes no header of the CPU backends
#   cmake -D way=forgotten -D command="COMPILER;FLAGS" -D source=forgotten_header.cpp -P seam.cmake
#       is refused with one message per component, which names the header to include
if(way STREQUAL "other")
  execute_process(COMMAND ${command} -M ${source} OUTPUT_VARIABLE headers COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "[^ \n]*gsh/[^ \n]*\\.hpp" ours "${headers}")
  list(LENGTH ours count)
  if(count LESS 20)
    message(FATAL_ERROR "only ${count} headers of gsh found in:\n${headers}")
  endif()
  # Clang also lists tbb/tbb.h, because the standard library asks whether it exists.
  string(REGEX MATCHALL "[^ \n]*(gsh/[a-z]+/cpu/|gsh/cpu\\.hpp|gsh/backend/threads\\.hpp|gsh/math/wide\\.hpp|/oneapi/tbb/)[^ \n]*"
         of_cpu "${headers}")
  if(of_cpu)
    message(FATAL_ERROR "${source} is for another backend, and includes ${of_cpu}")
  endif()
  message("none of ${count} headers is of the CPU backends")
else()
  execute_process(COMMAND ${command} -fsyntax-only ${source} RESULT_VARIABLE refused ERROR_VARIABLE errors)
  if(NOT refused)
    message(FATAL_ERROR "${source} compiles without the headers of its backend's overloads")
  endif()
  foreach(header IN ITEMS avatar/cpu/occlusion_field avatar/cpu/skinned_splats backend/cpu/sum body/cpu/blend_shapes
                          field/cpu/hash_grid field/cpu/mlp gaussian/cpu/static_gaussian light/cpu/lit_splats
                          light/cpu/shadow_map loss/cpu/lpips loss/cpu/photometric optim/cpu/adam
                          render/cpu/rasterizer)
    string(FIND "${errors}" "<gsh/${header}.hpp> or <gsh/cpu.hpp>" place)
    if(place EQUAL -1)
      message(FATAL_ERROR "no message names <gsh/${header}.hpp>; the compiler said:\n${errors}")
    endif()
  endforeach()
  string(REGEX MATCHALL "error:[^\n]*" all "${errors}")
  list(FILTER all EXCLUDE REGEX "static assertion|static_assert")
  if(all)
    message(FATAL_ERROR "beside the messages that name a header there are others: ${all}")
  endif()
  message("each component names the header to include")
endif()
