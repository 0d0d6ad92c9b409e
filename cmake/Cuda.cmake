# The CUDA language, where the build has CUDA: architectures, flags, and giga::cudart, the one CUDA runtime library.

if(GIGASTEP_HAS_CUDA)
  # Architectures: those of the GPUs present; else 8.0 (serves Ampere and Ada), 9.0 (Hopper) and PTX of 9.0, which the
  # driver translates for anything newer. Each entry costs compile time; set CMAKE_CUDA_ARCHITECTURES for another list.
  if(NOT DEFINED CMAKE_CUDA_ARCHITECTURES AND NOT DEFINED ENV{CUDAARCHS})
    execute_process(COMMAND ${PROJECT_SOURCE_DIR}/scripts/locate gpu OUTPUT_VARIABLE capabilities ERROR_QUIET)
    string(REGEX MATCHALL "[0-9]+\\.[0-9]+" capabilities "${capabilities}")
    list(REMOVE_DUPLICATES capabilities)
    list(TRANSFORM capabilities REPLACE "([0-9]+)\\.([0-9]+)" "\\1\\2-real")
    if(NOT capabilities)
      set(capabilities 80-real 90-real 90-virtual)
    endif()
    set(CMAKE_CUDA_ARCHITECTURES "${capabilities}" CACHE STRING "CUDA architectures")
  endif()
  # LibTorch loads the shared CUDA runtime. CMake would add the static one to our programs: two runtimes in a process.
  # So CMake adds none, and giga::cudart below names the file.
  set(CMAKE_CUDA_RUNTIME_LIBRARY None)
  enable_language(CUDA)
  set(CMAKE_CUDA_FLAGS_RELEASE "-O3 -DNDEBUG")

  # -fmad=false is the twin of -ffp-contract=off in Options.cmake: CPU and GPU agree to the last bit. A target whose
  # results are compared within a tolerance alone may set the property GIGA_FAST_MATH.
  list(JOIN giga_host_flags "," host_flags)
  list(JOIN giga_host_warnings "," host_warnings)
  add_compile_options("$<$<COMPILE_LANGUAGE:CUDA>:$<IF:$<BOOL:$<TARGET_PROPERTY:GIGA_FAST_MATH>>,--use_fast_math,-fmad=false>>"
                      "$<$<COMPILE_LANGUAGE:CUDA>:--expt-relaxed-constexpr;--extended-lambda>"
                      "$<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=${host_flags};-Xcompiler=${host_warnings}>")
  if(CMAKE_COMPILE_WARNING_AS_ERROR)
    add_compile_options($<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-Werror>)  # -Werror=all-warnings comes from CMake
  endif()

  # The runtime library: the one that LibTorch's wheel brings, unless the compiler is of a newer minor release (the newer
  # runtime serves code of the older one, not the reverse). Both have the same soname, so exactly one is ever loaded.
  get_filename_component(toolkit ${CMAKE_CUDA_COMPILER} REALPATH)
  get_filename_component(toolkit ${toolkit}/../.. ABSOLUTE)
  set(wheel_cudart ${GIGASTEP_TORCH_DIR}/../nvidia/cu13/lib)
  set(toolkit_cudart ${toolkit}/lib64 ${toolkit}/lib ${toolkit}/targets/${CMAKE_SYSTEM_PROCESSOR}-linux/lib)
  if(CMAKE_CUDA_COMPILER_VERSION VERSION_LESS 13.1)
    set(cudart_dirs ${wheel_cudart} ${toolkit_cudart})
  else()
    set(cudart_dirs ${toolkit_cudart} ${wheel_cudart})
  endif()
  find_file(GIGASTEP_CUDART NAMES libcudart.so.13 libcudart.so PATHS ${cudart_dirs} NO_DEFAULT_PATH REQUIRED)
  mark_as_advanced(GIGASTEP_CUDART)
  get_filename_component(GIGASTEP_CUDART ${GIGASTEP_CUDART} ABSOLUTE)

  add_library(giga_cudart INTERFACE IMPORTED)
  add_library(giga::cudart ALIAS giga_cudart)
  target_include_directories(giga_cudart SYSTEM INTERFACE ${CMAKE_CUDA_TOOLKIT_INCLUDE_DIRECTORIES})
  target_link_libraries(giga_cudart INTERFACE ${GIGASTEP_CUDART})
  message(STATUS "CUDA: ${CMAKE_CUDA_COMPILER} ${CMAKE_CUDA_COMPILER_VERSION} for ${CMAKE_CUDA_ARCHITECTURES}, ${GIGASTEP_CUDART}")
else()
  message(STATUS "CUDA: off, ${GIGASTEP_WITHOUT_CUDA}")
endif()
