# Run by ctest before the tests: asks a test program what tests it has, and adds an entry for each suite; for those of
# EACH (a regular expression), which must not share a process, one for each test. Those of LONG begin before all others.
# Suites whose name contains "Gpu" carry the label gpu. Variables from tests/CMakeLists.txt: PROGRAM, FOLDER, TIMEOUT,
# EACH, LONG.
if(NOT EXISTS "${PROGRAM}")
  add_test(test_${FOLDER}_NOT_BUILT test_${FOLDER}_NOT_BUILT)
  return()
endif()

macro(add_entry name filter)
  add_test("${name}" "${PROGRAM}" "--gtest_filter=${filter}" --gtest_brief=1)
  set(label ${FOLDER})
  set(lock "")
  if("${name}" MATCHES "Gpu")
    set(label gpu)
    set(lock RESOURCE_LOCK gpu)
  endif()
  set(cost "")
  if(LONG AND "${name}" MATCHES "${LONG}")
    set(cost COST 100)
  endif()
  # Skipped is what skips all its tests (main.cpp). A filter that finds nothing must not pass.
  set_tests_properties("${name}" PROPERTIES LABELS ${label} TIMEOUT ${TIMEOUT} ${lock} ${cost} SKIP_RETURN_CODE 77
                       FAIL_REGULAR_EXPRESSION "\\] 0 tests from 0 test suites")
endmacro()

execute_process(COMMAND "${PROGRAM}" --gtest_list_tests OUTPUT_VARIABLE listed RESULT_VARIABLE failed)
if(failed)
  message(FATAL_ERROR "${PROGRAM} --gtest_list_tests: ${failed}")
endif()
string(REGEX REPLACE " *#[^\n]*" "" listed "${listed}")  # values of parameters
string(REPLACE ";" "\\;" listed "${listed}")
string(REPLACE "\n" ";" lines "${listed}")
foreach(line IN LISTS lines)
  if(line MATCHES "^([^ ].*)\\.$")
    set(suite "${CMAKE_MATCH_1}")
    if(NOT EACH OR NOT suite MATCHES "${EACH}")
      add_entry("${suite}" "${suite}.*")
    endif()
  elseif(line MATCHES "^  (.+)$")
    set(test "${suite}.${CMAKE_MATCH_1}")
    if(EACH AND suite MATCHES "${EACH}")
      add_entry("${test}" "${test}")
    endif()
  endif()
endforeach()
