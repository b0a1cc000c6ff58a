# Programs that choose the instruction set when they start. A program is then a library per level, of which the dynamic
# loader takes the newest that the processor has (glibc-hwcaps, glibc 2.33 or newer):
#   bin/gsh-render                                        an executable without code; its main is in the library
#   lib/gsh/glibc-hwcaps/x86-64-v4/libgsh-render.so       the program for AVX-512
#   lib/gsh/glibc-hwcaps/x86-64-v3/libgsh-render.so       the program for AVX2
#   lib/gsh/libgsh-render.so                              the program for x86-64; without that level, an error message
# No code for a newer processor is loaded on an older one. Functions that the linker could merge across instruction sets
# (docs/architecture.md, "Backends") never meet.
set(GSH_PROGRAMS_ISA_LEVELS "" CACHE STRING
    "Instruction sets among which programs choose at their start, some of: x86-64;x86-64-v2;x86-64-v3;x86-64-v4")

if(GSH_PROGRAMS_ISA_LEVELS)
  foreach(level IN LISTS GSH_PROGRAMS_ISA_LEVELS)
    if(NOT level MATCHES "^x86-64(-v[234])?$")
      message(FATAL_ERROR "GSH_PROGRAMS_ISA_LEVELS has \"${level}\", expected x86-64, x86-64-v2, x86-64-v3 or "
                          "x86-64-v4")
    endif()
  endforeach()
  if(NOT CMAKE_SYSTEM_NAME STREQUAL "Linux" OR NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$")
    message(FATAL_ERROR "GSH_PROGRAMS_ISA_LEVELS is for Linux on x86-64, not for ${CMAKE_SYSTEM_NAME} on "
                        "${CMAKE_SYSTEM_PROCESSOR}; leave it empty")
  endif()
  if(GSH_PROGRAMS_CUDA)
    message(FATAL_ERROR "GSH_PROGRAMS_ISA_LEVELS and GSH_PROGRAMS_CUDA cannot be combined; leave one of them out")
  endif()
  list(REMOVE_DUPLICATES GSH_PROGRAMS_ISA_LEVELS)
endif()

# gsh_set_isa_level(level targets...): compiles targets for a level, and so that a shared library may contain them.
function(gsh_set_isa_level level)
  set_target_properties(${ARGN} PROPERTIES GSH_INSTRUCTION_SET ${level} POSITION_INDEPENDENT_CODE ON)
  foreach(target IN LISTS ARGN) # functions are inlined as in an executable
    target_compile_options(${target} PRIVATE -fno-semantic-interposition)
  endforeach()
endfunction()

# gsh_add_program_with_levels(name source): adds the executable, and a library name_LEVEL for each level, which the
# caller links to what the program needs.
function(gsh_add_program_with_levels name source)
  set(levels ${GSH_PROGRAMS_ISA_LEVELS})
  foreach(level IN LISTS levels)
    add_library(${name}_${level} SHARED ${source})
  endforeach()
  if(NOT x86-64 IN_LIST levels)
    list(JOIN levels ", " names)
    list(APPEND levels x86-64)
    add_library(${name}_x86-64 SHARED ${CMAKE_CURRENT_SOURCE_DIR}/levels/no_level.cpp)
    target_link_libraries(${name}_x86-64 PRIVATE gsh_project gsh_hardened)
    target_compile_definitions(${name}_x86-64 PRIVATE GSH_PROGRAM_NAME="${name}" GSH_PROGRAM_LEVELS="${names}")
  endif()
  file(CONFIGURE OUTPUT no_code.cpp CONTENT "// main is in a shared library\n")
  add_executable(${name} no_code.cpp)
  target_link_libraries(${name} PRIVATE gsh_project gsh_hardened ${name}_x86-64)
  set_target_properties(${name} PROPERTIES GSH_INSTRUCTION_SET x86-64
                                           BUILD_WITH_INSTALL_RPATH ON INSTALL_RPATH "$ORIGIN/../lib/gsh")
  set(exports ${PROJECT_SOURCE_DIR}/cmake/main_only.map)
  foreach(level IN LISTS levels)
    set(library ${name}_${level})
    set(folder ${PROJECT_BINARY_DIR}/lib/gsh)
    if(NOT level STREQUAL "x86-64")
      string(APPEND folder /glibc-hwcaps/${level})
    endif()
    gsh_set_isa_level(${level} ${library})
    set_target_properties(${library} PROPERTIES OUTPUT_NAME ${name} LIBRARY_OUTPUT_DIRECTORY ${folder}
                                                LINK_DEPENDS ${exports})
    target_link_options(${library} PRIVATE LINKER:--version-script=${exports})
    add_dependencies(${name} ${library})
  endforeach()
endfunction()
