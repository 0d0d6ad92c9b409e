# giga::torch, LibTorch as an imported target, and giga_use_torch_pch(), its precompiled header.
#
# find_package(Torch) is not used: it searches CUDA again, appends eleven architectures to CMAKE_CUDA_FLAGS and ignores
# CMAKE_CUDA_ARCHITECTURES. The loader finds the CUDA libraries through the wheel's own RPATHs.

# Wheels before 2.6 used the old string ABI; linking them would fail with pages of undefined symbols.
set(torch_config ${GIGASTEP_TORCH_DIR}/share/cmake/Torch/TorchConfig.cmake)
if(EXISTS ${torch_config})
  file(STRINGS ${torch_config} old_abi REGEX "_GLIBCXX_USE_CXX11_ABI=0")
  if(old_abi)
    message(FATAL_ERROR "${GIGASTEP_TORCH_DIR} was built with _GLIBCXX_USE_CXX11_ABI=0; a build with 1 is needed")
  endif()
endif()

# Without CUDA the CPU's part alone: the rest needs 1.4 GB of CUDA libraries to start, which are then not installed.
set(torch_names torch_cpu c10)
if(GIGASTEP_HAS_CUDA)
  set(torch_names torch torch_cpu torch_cuda c10 c10_cuda)
endif()
set(torch_libraries)
foreach(name ${torch_names})
  if(EXISTS ${GIGASTEP_TORCH_DIR}/lib/lib${name}.so)
    list(APPEND torch_libraries ${GIGASTEP_TORCH_DIR}/lib/lib${name}.so)
  endif()
endforeach()

add_library(giga_torch INTERFACE IMPORTED)
add_library(giga::torch ALIAS giga_torch)
target_include_directories(giga_torch SYSTEM INTERFACE ${GIGASTEP_TORCH_DIR}/include
                                                       ${GIGASTEP_TORCH_DIR}/include/torch/csrc/api/include)
# The standard library goes first: libtorch.so exports a part of its own copy of it, and there remove_all() crashes.
target_link_libraries(giga_torch INTERFACE stdc++ ${torch_libraries})
# Nothing names a symbol of libtorch_cuda: without this the linker drops it and LibTorch sees no GPU.
target_link_options(giga_torch INTERFACE LINKER:--no-as-needed)
message(STATUS "LibTorch: ${GIGASTEP_TORCH_DIR}")

# giga_use_torch_pch(<target>): the target's files start from one precompiled header, torch_pch.hpp; the first target to ask
# for it compiles it.
function(giga_use_torch_pch target)
  if(NOT GIGASTEP_PCH)
    return()
  endif()
  target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-fpch-preprocess>)  # ccache needs it
  get_property(first GLOBAL PROPERTY giga_torch_pch)
  if(first)
    target_precompile_headers(${target} REUSE_FROM ${first})
  else()
    target_precompile_headers(${target} PRIVATE ${PROJECT_SOURCE_DIR}/cmake/torch_pch.hpp)
    set_property(GLOBAL PROPERTY giga_torch_pch ${target})
  endif()
endfunction()
