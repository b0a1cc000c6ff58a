# Settings of gsh's own programs and tests. They do not affect a user's build.
option(GSH_WERROR "Treat warnings in our own targets as errors" ON)
option(GSH_NATIVE "Build our own targets for this machine's instruction set" ON)
option(GSH_JOIN_SOURCES "Compile neighbouring files of tests and programs together: all build faster, a single one slower" OFF)
set(GSH_SANITIZE "" CACHE STRING "Sanitizers for our own targets, as for -fsanitize=")

set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)

set(gsh_warnings -Wall -Wextra -Wpedantic -Wshadow)
if(GSH_WERROR)
  list(APPEND gsh_warnings -Werror)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 19)
    list(APPEND gsh_warnings -Wno-error=invalid-feature-combination) # of its own -march=native on AVX10 processors
  endif()
endif()
# GCC's AVX-512 header initialises variables with themselves on purpose; before version 13 it warns of them where Eigen's
# products are inlined, which depends on the processor that -march=native selects. Clang warns of ours.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  list(APPEND gsh_warnings -Wno-uninitialized)
endif()
# Warnings of GCC that depend on what it inlines, and are wrong: with -O3, or where throwing checks of a large unit are
# not inlined.
set(gsh_inlining_warnings)
set(gsh_joined_options) # for translation units of several joined files
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  set(gsh_inlining_warnings -Wno-error=array-bounds -Wno-error=restrict -Wno-error=stringop-overflow
      -Wno-error=maybe-uninitialized)
  list(APPEND gsh_joined_options ${gsh_inlining_warnings})
  # GCC then collects garbage from 1.5 GB on, not from 128 MB on. That saves a tenth of the time of a large unit.
  set(gsh_collector_options --param=ggc-min-heapsize=1500000 --param=ggc-min-expand=300)
  list(APPEND gsh_joined_options ${gsh_collector_options})
else() # Clang: a local name may shadow one in the unnamed namespace of another joined file
  set(gsh_joined_options -Wno-error=shadow)
endif()
# Tests: GCC takes a quarter less time for -O2 than for -O3, the default of Release. Training steps then take 1.7 times
# as long.
set(gsh_joined_test_options ${gsh_joined_options} $<$<CONFIG:Release>:-O2>)
# For code of such a build that runs no kernel for long: -Og saves more time in the compiler than it costs at run time.
# Never for a part of a program that users run: where two of its objects instantiate the same template, the linker keeps
# the first one for both. The page's renderer at -Og made training steps 1.7 times as long.
set(gsh_brief_options $<$<CONFIG:Release>:-Og>)

add_library(gsh_project INTERFACE)
# The flags are for C++ only, because nvcc passes host flags in another way.
# -ffp-contract=off: the compiler may inline the same source differently in Serial and in Threads. A fused multiply-add
# in only one of them would break their bit-for-bit equality. Kernels that need fma call it explicitly.
# -fno-math-errno: no code reads errno after a square root. Without errno, loops with square roots are vectorised (Adam
# is four times as fast).
target_compile_options(gsh_project INTERFACE $<$<COMPILE_LANGUAGE:CXX>:${gsh_warnings};-ffp-contract=off;-fno-math-errno>)
# __FILE__, by which doctest names and filters files, does not depend on where the checkout is. A compiler cache
# therefore also serves another checkout of the same sources.
target_compile_options(gsh_project INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-fmacro-prefix-map=${PROJECT_SOURCE_DIR}/=/gsh/>)
# The property GSH_INSTRUCTION_SET of a target selects an instruction set.
set(gsh_set $<TARGET_PROPERTY:GSH_INSTRUCTION_SET>)
set(gsh_set $<IF:$<BOOL:${gsh_set}>,${gsh_set},$<$<BOOL:${GSH_NATIVE}>:native>>)
target_compile_options(gsh_project INTERFACE $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<BOOL:${gsh_set}>>:-march=${gsh_set}>)
if(GSH_SANITIZE)
  target_compile_options(gsh_project INTERFACE -fsanitize=${GSH_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(gsh_project INTERFACE -fsanitize=${GSH_SANITIZE})
  # These checks take a quarter of the build time, and AddressSanitizer finds null pointers, too.
  if(GSH_SANITIZE MATCHES "undefined")
    target_compile_options(gsh_project INTERFACE -fno-sanitize=null,vptr,object-size)
  endif()
endif()
target_link_options(gsh_project INTERFACE $<$<PLATFORM_ID:Linux>:LINKER:--as-needed>) # link only the libraries in use
target_link_libraries(gsh_project INTERFACE gsh::gsh)

# Environment variables of tests and stories.
set(gsh_test_environment UBSAN_OPTIONS=print_stacktrace=1)
if(GSH_SANITIZE MATCHES "thread")
  list(APPEND gsh_test_environment "TSAN_OPTIONS=suppressions=${CMAKE_CURRENT_LIST_DIR}/tsan.supp atexit_sleep_ms=100 history_size=7")
endif()

# The headers that preset dev compiles alone use the same warnings.
if(CMAKE_VERIFY_INTERFACE_HEADER_SETS)
  add_compile_options(${gsh_warnings})
endif()

# For the programs, and the libraries of the Python package: what makes a fault of memory hard to use. SECURITY.md states
# it, and tests/programs/hardening_test.cpp asks the programs. Sanitizers have their own checks, and need the functions of
# libc as they are.
add_library(gsh_hardened INTERFACE)
if(NOT GSH_SANITIZE AND CMAKE_SYSTEM_NAME STREQUAL "Linux")
  set(cxx $<COMPILE_LANGUAGE:CXX>)
  set(optimised $<NOT:$<CONFIG:Debug>>) # without optimisation, _FORTIFY_SOURCE warns and does nothing
  set(executable $<NOT:$<BOOL:$<TARGET_PROPERTY:POSITION_INDEPENDENT_CODE>>>) # not for a shared library
  target_compile_options(gsh_hardened INTERFACE
    $<${cxx}:-fstack-protector-strong>
    $<$<AND:${cxx},${executable}>:-fPIE>
    "$<$<AND:${cxx},${optimised}>:-U_FORTIFY_SOURCE;-D_FORTIFY_SOURCE=3>")
  target_compile_definitions(gsh_hardened INTERFACE GSH_HARDENED $<${optimised}:GSH_FORTIFIED>)
  target_link_options(gsh_hardened INTERFACE
    $<$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>:-pie> LINKER:-z,relro,-z,now)
endif()
