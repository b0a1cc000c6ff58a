# Settings of our own programs and tests; a user's build never sees them.
option(GSH_WERROR "Treat warnings in our own targets as errors" ON)
option(GSH_NATIVE "Build our own targets for this machine's instruction set" ON)
option(GSH_JOIN_TESTS "One test program per folder: all of them build faster, a single one slower" OFF)
set(GSH_SANITIZE "" CACHE STRING "Sanitizers for our own targets, as for -fsanitize=")

set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)

set(gsh_warnings -Wall -Wextra -Wpedantic -Wshadow)
if(GSH_WERROR)
  list(APPEND gsh_warnings -Werror)
endif()
set(gsh_joined_warnings) # of translation units that are many files joined
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU") # judged after inlining, which in a large unit stops before throwing checks
  set(gsh_joined_warnings -Wno-error=array-bounds -Wno-error=restrict -Wno-error=stringop-overflow)
else() # Clang sees a local name shadow what another of the joined files has in its unnamed namespace
  set(gsh_joined_warnings -Wno-error=shadow)
endif()

add_library(gsh_project INTERFACE)
# Only for C++: nvcc hands host flags on in a way of its own.
# Contraction off: Serial and Threads inline the same source differently, and a fused multiply-add in one of them
# alone would break their bit-for-bit equality. Kernels that want fma say so.
# Nobody reads errno after a square root, and without it loops with one vectorise (Adam: four times as fast).
target_compile_options(gsh_project INTERFACE $<$<COMPILE_LANGUAGE:CXX>:${gsh_warnings};-ffp-contract=off;-fno-math-errno>)
if(GSH_NATIVE)
  # A target may ask for another one by its property GSH_INSTRUCTION_SET.
  set(gsh_set $<TARGET_PROPERTY:GSH_INSTRUCTION_SET>)
  target_compile_options(gsh_project INTERFACE
                         $<$<COMPILE_LANGUAGE:CXX>:-march=$<IF:$<BOOL:${gsh_set}>,${gsh_set},native>>)
endif()
if(GSH_SANITIZE)
  target_compile_options(gsh_project INTERFACE -fsanitize=${GSH_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(gsh_project INTERFACE -fsanitize=${GSH_SANITIZE})
  if(GSH_SANITIZE MATCHES "undefined") # AddressSanitizer stops at null pointers, too; these take a quarter of the build
    target_compile_options(gsh_project INTERFACE -fno-sanitize=null,vptr,object-size)
  endif()
endif()
target_link_options(gsh_project INTERFACE $<$<PLATFORM_ID:Linux>:LINKER:--as-needed>) # load only libraries in use
target_link_libraries(gsh_project INTERFACE gsh::gsh)

# What tests and stories find in their environment.
set(gsh_test_environment UBSAN_OPTIONS=print_stacktrace=1)
if(GSH_SANITIZE MATCHES "thread")
  list(APPEND gsh_test_environment "TSAN_OPTIONS=suppressions=${CMAKE_CURRENT_LIST_DIR}/tsan.supp atexit_sleep_ms=100")
endif()

# Headers compiled alone (preset dev) stand under the same warnings.
if(CMAKE_VERIFY_INTERFACE_HEADER_SETS)
  add_compile_options(${gsh_warnings})
endif()
