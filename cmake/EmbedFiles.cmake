# Writes a source file that holds the files of a folder as strings. It is run as a script, with the variables folder,
# names (separated by commas) and output.
# The output defines web_files() of programs/view/view_page.hpp.
set(entries)
string(REPLACE "," ";" names "${names}")
foreach(name IN LISTS names)
  file(READ ${folder}/${name} content HEX)
  string(LENGTH "${content}" digits)
  math(EXPR bytes "${digits} / 2")
  file(READ ${folder}/${name} content) # a raw string: [ ] ; \ stay as they are, for the value is always quoted
  string(FIND "${content}" ")gsh-web\"" end)
  if(NOT end EQUAL -1)
    message(FATAL_ERROR "${name} contains the end of a raw string")
  endif()
  string(APPEND entries "        {\"${name}\", std::string_view(R\"gsh-web(${content})gsh-web\", ${bytes})},\n")
endforeach()
file(WRITE ${output} "// written by cmake/EmbedFiles.cmake
#include \"view/view_page.hpp\"

namespace gsh::programs {

const std::vector<std::pair<std::string_view, std::string_view>>& web_files() {
    static const std::vector<std::pair<std::string_view, std::string_view>> files{
${entries}    };
    return files;
}

} // namespace gsh::programs
")
