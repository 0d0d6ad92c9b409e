# Settings that hold for every target: build type, language level, warnings, floating-point rules, compiler cache.

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Release, Debug or RelWithDebInfo" FORCE)
endif()

set(GIGASTEP_CUDA AUTO CACHE STRING "CUDA back end: AUTO (where there is a GPU), ON or OFF")
set_property(CACHE GIGASTEP_CUDA PROPERTY STRINGS AUTO ON OFF)
set(GIGASTEP_LIBTORCH "" CACHE PATH "folder of LibTorch or of Python's torch package; empty: see scripts/locate")
option(GIGASTEP_PCH "precompile the LibTorch headers" ON)
option(GIGASTEP_CCACHE "use ccache where it is found" ON)
set(GIGASTEP_SANITIZE "" CACHE STRING "sanitizers, as in -fsanitize=, for example address,undefined")

# The instruction set. x86-64-v3 (AVX2, FMA: Haswell 2013, Zen 2017) rather than "native", so that a binary or a compiler
# cache made on one machine serves another. Empty: the compiler's own choice.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
  set(default_march x86-64-v3)
else()
  set(default_march "")
endif()
set(GIGASTEP_MARCH "${default_march}" CACHE STRING "value of -march, empty: the compiler's default")

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_CUDA_STANDARD 20)
set(CMAKE_CUDA_STANDARD_REQUIRED ON)
set(CMAKE_CUDA_EXTENSIONS OFF)
set(CMAKE_CXX_FLAGS_RELEASE "-O3 -DNDEBUG")
set(CMAKE_CXX_SCAN_FOR_MODULES OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
set(CMAKE_INSTALL_RPATH_USE_LINK_PATH ON)

# Warnings are errors with GCC up to 12, which CI has; -DCMAKE_COMPILE_WARNING_AS_ERROR=ON or OFF decides otherwise. Other
# compilers may warn of what is fine, and no user's build is to fail for that: GCC 13 saw a vector free what it had not
# got.
if(NOT DEFINED CMAKE_COMPILE_WARNING_AS_ERROR AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND
   CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  set(CMAKE_COMPILE_WARNING_AS_ERROR ON)
endif()

# Flags of all C++ code. -ffp-contract=off: the CPU and the CUDA back end must agree to the last bit, so no compiler may
# join a multiplication and an addition into one rounding (nvcc's twin, -fmad=false, is in Cuda.cmake).
set(giga_host_flags -ffp-contract=off)
if(GIGASTEP_MARCH)
  list(APPEND giga_host_flags -march=${GIGASTEP_MARCH})
endif()
set(giga_host_warnings -Wall -Wextra)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  if(CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 12 AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 14)
    # False alarms, on std::string + (GCC bug 105651) and on std::vector<bool>::reserve inside LibTorch's headers.
    list(APPEND giga_host_warnings -Wno-restrict -Wno-array-bounds -Wno-stringop-overflow)
  endif()
  if(CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 13)
    list(APPEND giga_host_warnings -Wno-dangling-reference)  # false alarms on functions that return a view
  endif()
endif()

# Sanitizers (preset asan): an error ends the program, with a readable stack.
if(GIGASTEP_SANITIZE)
  set(sanitize -fsanitize=${GIGASTEP_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  list(APPEND giga_host_flags ${sanitize})
  list(APPEND giga_host_warnings -Wno-maybe-uninitialized)  # false alarms in instrumented code
  add_link_options(${sanitize})
endif()

add_compile_options("$<$<COMPILE_LANGUAGE:CXX>:${giga_host_flags}>" "$<$<COMPILE_LANGUAGE:CXX>:${giga_host_warnings}>"
                    "$<$<COMPILE_LANGUAGE:CXX>:-Wpedantic;-Wshadow;-Wnon-virtual-dtor>")

# The compiler cache. The sloppiness is what ccache asks for to cache files that use a precompiled header; paths count from
# the checkout, so that another checkout finds what this one compiled. Not where the path has a blank: there ccache leaves
# the paths of dependencies whole, and other checkouts would wait for files of this one.
if(GIGASTEP_CCACHE AND NOT PROJECT_SOURCE_DIR MATCHES " ")
  find_program(GIGASTEP_CCACHE_PROGRAM ccache)
  mark_as_advanced(GIGASTEP_CCACHE_PROGRAM)
  if(GIGASTEP_CCACHE_PROGRAM)
    set(launcher ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros CCACHE_BASEDIR=${PROJECT_SOURCE_DIR}
                 CCACHE_NOHASHDIR=1 ${GIGASTEP_CCACHE_PROGRAM})
    set(CMAKE_C_COMPILER_LAUNCHER ${launcher})
    set(CMAKE_CXX_COMPILER_LAUNCHER ${launcher})
    set(CMAKE_CUDA_COMPILER_LAUNCHER ${launcher})
  endif()
endif()
