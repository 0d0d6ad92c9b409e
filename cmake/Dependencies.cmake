# The distribution's libraries, each as one target; scripts/bootstrap installs them.

set(THREADS_PREFER_PTHREAD_FLAG ON)
find_package(Threads REQUIRED)
find_package(OpenMP REQUIRED COMPONENTS CXX)
find_package(yaml-cpp REQUIRED)
find_package(spdlog REQUIRED)
find_package(CLI11 REQUIRED)
find_package(HDF5 REQUIRED COMPONENTS C)
find_package(Eigen3 3.3 REQUIRED NO_MODULE)
find_package(OpenSSL REQUIRED COMPONENTS Crypto)
find_package(nlohmann_json REQUIRED)
find_package(ZLIB REQUIRED)

# yaml-cpp 0.8 renamed its target and leaves the old name as one that warns.
add_library(giga_yaml INTERFACE IMPORTED)
add_library(giga::yaml ALIAS giga_yaml)
if(TARGET yaml-cpp::yaml-cpp)
  target_link_libraries(giga_yaml INTERFACE yaml-cpp::yaml-cpp)
else()
  target_link_libraries(giga_yaml INTERFACE yaml-cpp)
endif()
