// The program of a scenario's step, and its way through cache and compiler.
#include "cuda/step_compiler.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <sstream>
#include <type_traits>
#include <utility>

#include "core/error.hpp"
#include "cuda/executor.hpp"
#include "cuda/kernel_sources.hpp"
#include "sim/fixed_params.hpp"

namespace giga {
namespace {

/// All of these are cuda/device_std.hpp.
constexpr const char* kStandardHeaders[] = {"bit",     "climits", "cmath",       "concepts",
                                            "cstddef", "cstdint", "type_traits", "utility"};

std::string source_of(const std::string& name) {
  const auto text = kernel_source(name);
  GIGA_CHECK(text, "no source of ", name, " in the program");
  return std::string(*text);
}

/// The first error in the compiler's log, in front of which there may be warnings.
std::string first_error(const std::string& log) {
  const size_t error = log.find("error"), end = error == std::string::npos ? std::string::npos : log.rfind('\n', error);
  const size_t begin = end == std::string::npos ? 0 : end + 1;
  return log.substr(begin, log.find('\n', begin) - begin);
}

/// Under which the code of a program is kept: all that it depends on. The headers by their digest.
std::string key_of(const NvrtcProgram& program, const std::string& scenario, const std::string& version) {
  std::string headers = program.source, options;
  for (const auto& [name, text] : program.headers) headers += cat(name, "\n", text, "\n");
  for (const std::string& option : program.options) options += option + "\n";
  return cat("NVRTC ", version, "\n", options, "headers ", text_digest(headers), "\n", scenario);
}

std::string seconds_since(std::chrono::steady_clock::time_point start) {
  char text[32];
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start;
  std::snprintf(text, sizeof text, "%.1f s", passed.count());
  return text;
}

}  // namespace

std::string why_no_fixed_step(const SimParams& p) {
  if (!p.team_after_team) return "the agents of a team are not one behind the other";
  if (p.n_agents > kMostFixedAgents)
    return cat("it has ", p.n_agents, " agents, and steps are compiled for up to ", kMostFixedAgents);
  if (const int team = std::max(p.n_team[0], p.n_team[1]); team > kMostFixedTeam)
    return cat("a team has ", team, " agents, and steps are compiled for up to ", kMostFixedTeam);
  // Beside images the original orders rows by pixels (orders_by_pixel), which these kernels do not.
  if (p.original() && p.resolution > 0) return "it has images by the original's rules";
  if (!fixed_shape(p, 1).tiles) return "its worlds do not fit into a block's shared memory";
  return {};
}

std::string this_scenario(const SimParams& p) {
  const FixedValues v = fixed_values(p);
  std::ostringstream out;
  out << std::boolalpha;
  out << "#pragma once\n#include \"sim/fixed_params.hpp\"\nnamespace giga {\n"
      << "constexpr unsigned long kLaunchBytes = " << sizeof(Launch) << ";\n"
      << "constexpr FixedValues kThisScenario{\n";
  for_each_value(v, [&](const char* name, auto value) {
    if constexpr (std::is_same_v<decltype(value), Rules>)
      out << "    ." << name << " = Rules{" << static_cast<int>(value) << "},\n";
    else if constexpr (std::is_same_v<decltype(value), ActionKind>)
      out << "    ." << name << " = ActionKind{" << static_cast<int>(value) << "},\n";
    else
      out << "    ." << name << " = " << value << ",\n";
  });
  out << "};\n}\n";
  return out.str();
}

NvrtcProgram step_program(const SimParams& p, int compute_capability) {
  NvrtcProgram program;
  program.source = source_of("cuda/fixed_step.cuh");
  std::istringstream names(source_of("names"));
  for (std::string name; std::getline(names, name);) program.headers.emplace_back(name, source_of(name));
  for (const char* name : kStandardHeaders) program.headers.emplace_back(name, "#include \"cuda/device_std.hpp\"\n");
  program.headers.emplace_back("cuda/this_scenario.hpp", this_scenario(p));
  // Those of cmake/Cuda.cmake. The last in place of --expt-relaxed-constexpr, which NVRTC does not know.
  program.options = {cat("--gpu-architecture=sm_", compute_capability), "--std=c++20", "--fmad=false",
                     "--device-as-default-execution-space"};
  return program;
}

CompiledStep compile_step(const SimParams& p, int compute_capability, const Nvrtc& nvrtc, const KernelCache& cache,
                          bool anew) {
  if (std::string why = why_no_fixed_step(p); !why.empty()) return {{}, std::move(why)};
  if (!nvrtc.missing().empty()) return {{}, nvrtc.missing()};
  const NvrtcProgram program = step_program(p, compute_capability);
  const std::string key = key_of(program, this_scenario(p), nvrtc.version());
  if (!anew)
    if (auto code = cache.read(key)) return {std::move(*code), cat("read from ", cache.file_of(key).string()), true};

  const auto start = std::chrono::steady_clock::now();
  Nvrtc::Result result = nvrtc.compile(program);
  if (result.code.empty()) return {{}, "NVRTC " + nvrtc.version() + ": " + first_error(result.log)};
  const std::string report = "compiled in " + seconds_since(start);
  const bool kept = cache.write(key, result.code);
  return {std::move(result.code), report + (kept ? ", kept in " : ", could not be kept in ") +
                                      (cache.folder().empty() ? "any folder" : cache.folder().string())};
}

}  // namespace giga
