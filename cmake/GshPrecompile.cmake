# gsh_precompile(target [headers...]): compiles gsh/gsh.hpp, or the named headers, once for all C++ sources of a target of
# the caller's own. Each source then begins with them, so name those that most sources include:
#   gsh_precompile(viewer)
#   gsh_precompile(viewer gsh/avatar/avatar.hpp gsh/cpu.hpp)
# The target is compiled with its own flags, and so is the precompiled header. Targets with the same flags share one by
# CMake's target_precompile_headers(other REUSE_FROM viewer).
function(gsh_precompile target)
  set(headers ${ARGN})
  if(NOT headers)
    set(headers gsh/gsh.hpp)
  endif()
  foreach(header IN LISTS headers)
    target_precompile_headers(${target} PRIVATE "$<$<COMPILE_LANGUAGE:CXX>:<${header}$<ANGLE-R>>")
  endforeach()
endfunction()
