# giga_stamp_commit(): the commit inside a program, in one small source, so that a new commit compiles that file alone.
# Run as a script (cmake -P), this file writes the source.

# giga_stamp_commit(<target>)
#
# Adds a source to <target> that defines giga::program_commit(). Every build looks at the commit; the source changes only
# with it.
function(giga_stamp_commit target)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/program_commit.cpp)
  add_custom_target(${target}_commit
    COMMAND ${CMAKE_COMMAND} -D "COMMIT_OUTPUT=${output}" -D "COMMIT_SCRIPT=${PROJECT_SOURCE_DIR}/scripts/commit"
            -P ${PROJECT_SOURCE_DIR}/cmake/Commit.cmake
    BYPRODUCTS ${output}
    COMMENT "Looking at the commit"
    VERBATIM)
  target_sources(${target} PRIVATE ${output})
  set_source_files_properties(${output} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON SKIP_PRECOMPILE_HEADERS ON)
  add_dependencies(${target} ${target}_commit)
endfunction()

if(NOT CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)
  return()
endif()

cmake_policy(VERSION 3.28)
execute_process(COMMAND ${COMMIT_SCRIPT} OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE
                COMMAND_ERROR_IS_FATAL ANY)
file(CONFIGURE OUTPUT "${COMMIT_OUTPUT}" @ONLY CONTENT "// Written by cmake/Commit.cmake.
#include \"apps/program_info.hpp\"

namespace giga {

const char* program_commit() { return \"@commit@\"; }

}  // namespace giga
")
