# giga_library(): the library of the current folder.

# giga_library(<name> [TORCH] [FILES <files>...] [EXCEPT <files>...] [PUBLIC <targets>...] [PRIVATE <targets>...])
#
# Defines giga::<name> from the .cpp files (and .cu files, where CUDA is on) of the current folder. A folder of headers
# only becomes an INTERFACE target. FILES, EXCEPT: these alone, all but these, where a folder makes two libraries. TORCH:
# the files start from the precompiled LibTorch header.
function(giga_library name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "TORCH" "" "FILES;EXCEPT;PUBLIC;PRIVATE")
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  if(arg_FILES)
    set(sources ${arg_FILES})
  endif()
  foreach(file ${arg_EXCEPT})
    list(REMOVE_ITEM sources ${CMAKE_CURRENT_SOURCE_DIR}/${file})
  endforeach()
  file(GLOB_RECURSE kernels CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cu)
  if(GIGASTEP_HAS_CUDA)
    list(APPEND sources ${kernels})
  endif()

  set(target giga_${name})
  if(sources)
    add_library(${target} STATIC ${sources})
    target_include_directories(${target} PUBLIC ${PROJECT_SOURCE_DIR}/lib)
    target_link_libraries(${target} PUBLIC ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
    if(arg_TORCH)
      giga_use_torch_pch(${target})
    endif()
  else()
    add_library(${target} INTERFACE)
    target_include_directories(${target} INTERFACE ${PROJECT_SOURCE_DIR}/lib)
    target_link_libraries(${target} INTERFACE ${arg_PUBLIC})
  endif()
  add_library(giga::${name} ALIAS ${target})
endfunction()
