# giga_embed(): files as bytes inside a program, so that it needs no folder beside it. Run as a script (cmake -P), this file
# writes the source that holds them.

# giga_embed(<target> <header> <function> [<name>=<file>...])
#
# Adds a source to <target> that defines the function which <header> declares in namespace giga:
#   std::optional<std::string_view> <function>(std::string_view name)   bytes of the file of that name; nothing without one
# The source is written again when a file has changed.
function(giga_embed target header function)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/${function}.cpp)
  set(files "")
  foreach(entry IN LISTS ARGN)
    string(REGEX REPLACE "^[^=]*=" "" file "${entry}")
    list(APPEND files "${file}")
  endforeach()
  set(script ${PROJECT_SOURCE_DIR}/cmake/Embed.cmake)
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -D "EMBED_OUTPUT=${output}" -D "EMBED_HEADER=${header}" -D "EMBED_FUNCTION=${function}"
            -D "EMBED_ENTRIES=${ARGN}" -P ${script}
    DEPENDS ${files} ${script}
    COMMENT "Embedding files of ${target}"
    VERBATIM)
  target_sources(${target} PRIVATE ${output})
  set_source_files_properties(${output} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
endfunction()

if(NOT CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)
  return()
endif()

set(arrays "")
set(cases "")
set(count 0)
foreach(entry IN LISTS EMBED_ENTRIES)
  string(REGEX MATCH "^([^=]*)=(.*)$" matched "${entry}")
  set(name "${CMAKE_MATCH_1}")
  file(READ "${CMAKE_MATCH_2}" bytes HEX)
  string(REGEX REPLACE "(................................)" "\\1\n" bytes "${bytes}")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(APPEND arrays "constexpr unsigned char kFile${count}[] = {\n${bytes}\n};\n")
  string(APPEND cases "  if (name == \"${name}\") return text_of(kFile${count}, sizeof kFile${count});\n")
  math(EXPR count "${count} + 1")
endforeach()
file(WRITE "${EMBED_OUTPUT}" "// Written by cmake/Embed.cmake.
#include \"${EMBED_HEADER}\"

#include <cstddef>

namespace giga {
namespace {

std::string_view text_of(const unsigned char* bytes, size_t size) {
  return {reinterpret_cast<const char*>(bytes), size};
}

${arrays}
}  // namespace

std::optional<std::string_view> ${EMBED_FUNCTION}(std::string_view name) {
${cases}  return std::nullopt;
}

}  // namespace giga
")
