# Settings of our own programs and tests; a user's build never sees them.
option(GSH_WERROR "Treat warnings in our own targets as errors" ON)
option(GSH_NATIVE "Build our own targets for this machine's instruction set" ON)
set(GSH_SANITIZE "" CACHE STRING "Sanitizers for our own targets, as for -fsanitize=")

set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)

add_library(gsh_project INTERFACE)
# Contraction off: Serial and Threads inline the same source differently, and a fused multiply-add in one of them
# alone would break their bit-for-bit equality. Kernels that want fma say so.
target_compile_options(gsh_project INTERFACE -Wall -Wextra -Wpedantic -Wshadow -ffp-contract=off)
if(GSH_WERROR)
  target_compile_options(gsh_project INTERFACE -Werror)
endif()
if(GSH_NATIVE)
  target_compile_options(gsh_project INTERFACE -march=native)
endif()
if(GSH_SANITIZE)
  target_compile_options(gsh_project INTERFACE -fsanitize=${GSH_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(gsh_project INTERFACE -fsanitize=${GSH_SANITIZE})
endif()
target_link_libraries(gsh_project INTERFACE gsh::gsh)
