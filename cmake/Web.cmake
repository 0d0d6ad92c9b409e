# giga_web_module(): a WebAssembly module for pages. GIGASTEP_HAS_WEB (0 or 1): whether there is a compiler for it, which
# scripts/bootstrap --web installs.
set(GIGASTEP_HAS_WEB 0)
execute_process(COMMAND ${PROJECT_SOURCE_DIR}/scripts/locate web
                OUTPUT_VARIABLE GIGASTEP_WEB_COMPILER OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(GIGASTEP_WEB_COMPILER)
  set(GIGASTEP_HAS_WEB 1)
  message(STATUS "Web: ${GIGASTEP_WEB_COMPILER}")
else()
  message(STATUS "Web: no compiler for WebAssembly; `gigastep play` is left out (scripts/bootstrap --web installs one)")
endif()

# giga_web_module(<output> <sources>...): sources by their paths from the project's folder. Each is compiled by itself, and
# again when a header that it includes has changed.
function(giga_web_module output)
  if(NOT GIGASTEP_HAS_WEB)
    return()
  endif()
  # Numbers as everywhere else (Options.cmake); exceptions end the module (module.cpp).
  set(flags --target=wasm32-wasi -std=c++20 -O2 -DNDEBUG -ffp-contract=off -fexceptions -Wall -Wextra
            -I${PROJECT_SOURCE_DIR}/lib -I${PROJECT_SOURCE_DIR})
  set(launcher "")
  if(GIGASTEP_CCACHE_PROGRAM)
    set(launcher ${CMAKE_CXX_COMPILER_LAUNCHER})
  endif()
  get_filename_component(module ${output} NAME_WE)
  set(folder ${CMAKE_CURRENT_BINARY_DIR}/web/${module})
  set(objects "")
  foreach(source IN LISTS ARGN)
    string(MAKE_C_IDENTIFIER "${source}" name)
    set(object ${folder}/${name}.o)
    add_custom_command(
      OUTPUT ${object}
      COMMAND ${launcher} ${GIGASTEP_WEB_COMPILER} ${flags} -MD -MF ${object}.d -c ${PROJECT_SOURCE_DIR}/${source} -o ${object}
      DEPENDS ${PROJECT_SOURCE_DIR}/${source}
      DEPFILE ${object}.d
      COMMENT "Compiling ${source} for the web"
      VERBATIM)
    list(APPEND objects ${object})
  endforeach()
  file(MAKE_DIRECTORY ${folder})
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${GIGASTEP_WEB_COMPILER} --target=wasm32-wasi -mexec-model=reactor -Wl,--strip-all,--gc-sections ${objects}
            -o ${output}
    DEPENDS ${objects}
    COMMENT "Linking ${output}"
    VERBATIM)
endfunction()
