# cmake -D nm=… -D "objects=A;B" -P symbols.cmake
# Two objects, compiled for two instruction sets, must not define the same function where the set matters: work of a CPU
# backend, and whatever is made of vector registers. The linker would keep one of the two.
foreach(object IN LISTS objects)
  execute_process(COMMAND ${nm} --demangle --defined-only --format=posix ${object} OUTPUT_VARIABLE lines
                  COMMAND_ERROR_IS_FATAL ANY)
  string(REPLACE ";" "," lines "${lines}") # these three have a meaning in CMake's lists
  string(REPLACE "[" "(" lines "${lines}")
  string(REPLACE "]" ")" lines "${lines}")
  string(REPLACE "\n" ";" lines "${lines}")
  list(FILTER lines INCLUDE REGEX " [TWVu] [0-9a-f]") # those that the linker sees
  list(FILTER lines INCLUDE REGEX "gsh::(([a-z0-9_]+::)?cpu::|([a-z0-9_]+::)?Wide)")
  list(TRANSFORM lines REPLACE " [TWVu] [0-9a-f ]*$" "")
  list(REMOVE_DUPLICATES lines)
  list(LENGTH lines count)
  if(count LESS 20)
    message(FATAL_ERROR "${object} defines ${count} such functions, expected at least 20: is it the right object?")
  endif()
  if(NOT DEFINED first)
    set(first ${lines})
    continue()
  endif()
  set(both ${lines})
  list(REMOVE_ITEM lines ${first})
  list(REMOVE_ITEM both ${lines})
endforeach()
if(both)
  list(LENGTH both count)
  list(SUBLIST both 0 10 both)
  list(JOIN both "\n  " both)
  message(FATAL_ERROR "${count} functions have one name in both units; is a header missing `inline GSH_ISA`?\n  ${both}")
endif()
