# giga::torch, LibTorch as an imported target, and giga_use_torch_pch(), its precompiled header.
#
# find_package(Torch) is not used: it searches CUDA again, appends eleven architectures to CMAKE_CUDA_FLAGS and ignores
# CMAKE_CUDA_ARCHITECTURES. The loader finds the CUDA libraries through the wheel's own RPATHs.

# Where LibTorch is: decided by scripts/locate alone, so that scripts and CMake always agree.
set(locate_env)
if(GIGASTEP_LIBTORCH)
  set(locate_env GIGASTEP_LIBTORCH=${GIGASTEP_LIBTORCH})
endif()
execute_process(COMMAND ${CMAKE_COMMAND} -E env ${locate_env} ${PROJECT_SOURCE_DIR}/scripts/locate torch
                OUTPUT_VARIABLE GIGASTEP_TORCH_DIR OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_VARIABLE locate_error)
if(NOT GIGASTEP_TORCH_DIR)
  message(FATAL_ERROR "LibTorch not found: run scripts/bootstrap, or set GIGASTEP_LIBTORCH. ${locate_error}")
endif()

# Wheels before 2.6 used the old string ABI; linking them would fail with pages of undefined symbols.
set(torch_config ${GIGASTEP_TORCH_DIR}/share/cmake/Torch/TorchConfig.cmake)
if(EXISTS ${torch_config})
  file(STRINGS ${torch_config} old_abi REGEX "_GLIBCXX_USE_CXX11_ABI=0")
  if(old_abi)
    message(FATAL_ERROR "${GIGASTEP_TORCH_DIR} was built with _GLIBCXX_USE_CXX11_ABI=0; a build with 1 is needed")
  endif()
endif()

set(torch_libraries)
foreach(name torch torch_cpu torch_cuda c10 c10_cuda)
  if(EXISTS ${GIGASTEP_TORCH_DIR}/lib/lib${name}.so)
    list(APPEND torch_libraries ${GIGASTEP_TORCH_DIR}/lib/lib${name}.so)
  endif()
endforeach()
if(EXISTS ${GIGASTEP_TORCH_DIR}/lib/libtorch_cuda.so)
  set(GIGASTEP_TORCH_CUDA 1)
else()
  set(GIGASTEP_TORCH_CUDA 0)
endif()

add_library(giga_torch INTERFACE IMPORTED)
add_library(giga::torch ALIAS giga_torch)
target_include_directories(giga_torch SYSTEM INTERFACE ${GIGASTEP_TORCH_DIR}/include
                                                       ${GIGASTEP_TORCH_DIR}/include/torch/csrc/api/include)
target_compile_definitions(giga_torch INTERFACE GIGASTEP_TORCH_CUDA=${GIGASTEP_TORCH_CUDA})
# The standard library goes first: libtorch.so exports a part of its own copy of it, and there remove_all() crashes.
target_link_libraries(giga_torch INTERFACE stdc++ ${torch_libraries})
# Nothing names a symbol of libtorch_cuda: without this the linker drops it and LibTorch sees no GPU.
target_link_options(giga_torch INTERFACE LINKER:--no-as-needed)
message(STATUS "LibTorch: ${GIGASTEP_TORCH_DIR} (CUDA: ${GIGASTEP_TORCH_CUDA})")

# giga_use_torch_pch(<target>): the target's files start from one shared precompiled header, torch_pch.hpp.
function(giga_use_torch_pch target)
  if(NOT GIGASTEP_PCH)
    return()
  endif()
  set(gcc_flag $<$<CXX_COMPILER_ID:GNU>:-fpch-preprocess>)  # ccache needs it
  if(NOT TARGET giga_torch_pch)
    set(carrier ${PROJECT_BINARY_DIR}/torch_pch.cpp)
    file(CONFIGURE OUTPUT ${carrier} CONTENT "// Carries the precompiled LibTorch header.\n")
    add_library(giga_torch_pch OBJECT ${carrier})
    target_link_libraries(giga_torch_pch PRIVATE giga::torch Threads::Threads)
    target_precompile_headers(giga_torch_pch PRIVATE ${PROJECT_SOURCE_DIR}/cmake/torch_pch.hpp)
    target_compile_options(giga_torch_pch PRIVATE ${gcc_flag})
  endif()
  target_precompile_headers(${target} REUSE_FROM giga_torch_pch)
  target_compile_options(${target} PRIVATE ${gcc_flag})
endfunction()
