# What this machine has, as scripts/locate says, so that scripts and CMake always agree: GIGASTEP_TORCH_DIR, LibTorch's
# folder; GIGASTEP_HAS_CUDA (0 or 1), whether the kernels are built, and GIGASTEP_WITHOUT_CUDA, why not.

# LibTorch.
set(locate_env)
if(GIGASTEP_LIBTORCH)
  set(locate_env GIGASTEP_LIBTORCH=${GIGASTEP_LIBTORCH})
endif()
execute_process(COMMAND ${CMAKE_COMMAND} -E env ${locate_env} ${PROJECT_SOURCE_DIR}/scripts/locate torch
                OUTPUT_VARIABLE GIGASTEP_TORCH_DIR OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_VARIABLE locate_error)
if(NOT GIGASTEP_TORCH_DIR)
  message(FATAL_ERROR "LibTorch not found: run scripts/bootstrap, or set GIGASTEP_LIBTORCH. ${locate_error}")
endif()

# CUDA: where there is a GPU and a compiler (AUTO), or wherever it is asked for (ON).
set(GIGASTEP_HAS_CUDA 0)
set(GIGASTEP_WITHOUT_CUDA "GIGASTEP_CUDA=${GIGASTEP_CUDA}")
if(GIGASTEP_CUDA STREQUAL "AUTO")
  execute_process(COMMAND ${PROJECT_SOURCE_DIR}/scripts/locate gpu RESULT_VARIABLE no_gpu OUTPUT_QUIET ERROR_QUIET)
endif()
if(GIGASTEP_CUDA STREQUAL "AUTO" AND no_gpu)
  set(GIGASTEP_WITHOUT_CUDA "no GPU here (GIGASTEP_CUDA=ON builds the kernels all the same)")
elseif(GIGASTEP_CUDA)
  # Which compiler: PATH, /usr/local/cuda, the project's .venv; CUDA 13, as LibTorch.
  if(NOT CMAKE_CUDA_COMPILER AND NOT DEFINED ENV{CUDACXX})
    execute_process(COMMAND ${PROJECT_SOURCE_DIR}/scripts/locate nvcc
                    OUTPUT_VARIABLE nvcc OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    if(nvcc)
      set(CMAKE_CUDA_COMPILER ${nvcc} CACHE FILEPATH "CUDA compiler")
    endif()
  endif()
  if(CMAKE_CUDA_COMPILER OR DEFINED ENV{CUDACXX})
    set(GIGASTEP_HAS_CUDA 1)
  elseif(GIGASTEP_CUDA STREQUAL "AUTO")
    set(GIGASTEP_WITHOUT_CUDA "a GPU, but no CUDA 13 compiler")
  else()
    message(FATAL_ERROR "GIGASTEP_CUDA=${GIGASTEP_CUDA}, but no CUDA 13 compiler was found: run scripts/bootstrap")
  endif()
endif()
