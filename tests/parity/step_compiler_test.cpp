// The step as it is compiled at run time, without a GPU: the sources inside the program, the compiler, the cache.
#include "cuda/step_compiler.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <string>

#include "io/temporary_folder.hpp"
#include "parity/odd_scenarios.hpp"
#include "support/sim_specs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

std::string bytes_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
void write_bytes(const fs::path& path, const std::string& bytes) { std::ofstream(path, std::ios::binary) << bytes; }

TEST(StepCompiler, WritesTheConstantsOfAScenario) {
  const OddScenario odd{"", changed(plain_values(3, 4), [](FixedValues& v) {
                          v.rules = Rules::original;
                          v.actions = ActionKind::continuous;
                          v.waypoints = true;
                        })};
  const std::string text = this_scenario(odd_spec(odd, 0).params);
  for (const char* line :
       {".rules = Rules{1},", ".actions = ActionKind{1},", ".team_0 = 3,", ".team_1 = 4,", ".n_neighbors = 7,",
        ".waypoints = true,", ".stochastic_detection = true,", ".sight_3d = false,"})
    EXPECT_NE(text.find(line), std::string::npos) << line << " is not in\n" << text;
}

TEST(StepCompiler, SaysWhichScenariosItDoesNotServe) {
  EXPECT_EQ(why_no_fixed_step(odd_spec(kOddScenarios[0], 0).params), "");
  SimSpec spec = plain_spec(21, 20);
  spec.finish();
  EXPECT_EQ(why_no_fixed_step(spec.params), "it has 41 agents, and steps are compiled for up to 40");
  spec = plain_spec(33, 5);
  spec.finish();
  EXPECT_EQ(why_no_fixed_step(spec.params), "a team has 33 agents, and steps are compiled for up to 32");
  spec = plain_spec(2, 2);
  std::swap(spec.agents[1], spec.agents[2]);
  spec.finish();
  EXPECT_EQ(why_no_fixed_step(spec.params), "the agents of a team are not one behind the other");
  spec = plain_spec(2, 2);
  spec.params.rules = Rules::original;
  spec.params.resolution = 84;
  spec.finish();
  EXPECT_EQ(why_no_fixed_step(spec.params), "it has images by the original's rules");
}

TEST(StepCompiler, HasAllThatItsSourcesInclude) {
  const NvrtcProgram program = step_program(odd_spec(kOddScenarios[0], 0).params, 90);
  std::set<std::string> names;
  for (const auto& [name, text] : program.headers) names.insert(name);
  const auto look = [&](const std::string& of, const std::string& text) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (!line.starts_with("#include ")) continue;
      const size_t begin = line.find_first_of("\"<") + 1;
      const std::string name = line.substr(begin, line.find_first_of("\">", begin) - begin);
      EXPECT_TRUE(names.contains(name)) << of << " includes " << name;
    }
  };
  look("the program", program.source);
  for (const auto& [name, text] : program.headers) look(name, text);
}

TEST(StepCompiler, GoesOnWithoutTheLibrary) {
  const Nvrtc nvrtc("libnvrtc_that_is_not_there.so");
  const CompiledStep step = compile_step(odd_spec(kOddScenarios[0], 0).params, 90, nvrtc, KernelCache(""));
  EXPECT_EQ(step.code, "");
  EXPECT_EQ(step.report, "no libnvrtc_that_is_not_there.so here");
}

class StepCompilerWithNvrtc : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!nvrtc_.missing().empty()) GTEST_SKIP() << "skipped: " << nvrtc_.missing();
  }
  const Nvrtc nvrtc_;
};

TEST_F(StepCompilerWithNvrtc, CompilesOddScenarios) {
  const auto stride = static_cast<size_t>(thinned(4));
  for (size_t k = 0; k < std::size(kOddScenarios); k += stride) {
    const OddScenario& odd = kOddScenarios[k];
    const CompiledStep step = compile_step(odd_spec(odd, 0).params, 90, nvrtc_, KernelCache(""));
    ASSERT_NE(step.code, "") << odd.name << ": " << step.report;
    EXPECT_EQ(step.code.substr(0, 4),
              "\x7f"
              "ELF")
        << odd.name;
    EXPECT_NE(step.code.find(kFixedStepName), std::string::npos) << odd.name;
  }
}

TEST_F(StepCompilerWithNvrtc, AReportTellsWhatFailed) {
  const CompiledStep step = compile_step(odd_spec(kOddScenarios[0], 0).params, 12345, nvrtc_, KernelCache(""));
  EXPECT_EQ(step.code, "");
  EXPECT_NE(step.report.find("NVRTC "), std::string::npos) << step.report;
  EXPECT_NE(step.report.find("gpu-architecture"), std::string::npos) << step.report;
}

// Whatever is wrong with a file, it is compiled anew, and the file is whole again.
TEST_F(StepCompilerWithNvrtc, KeepsWhatItCompiles) {
  const TemporaryFolder folder;
  const KernelCache cache(folder.path() / "made" / "here");
  const SimParams params = odd_spec(kOddScenarios[0], 0).params;
  const CompiledStep first = compile_step(params, 90, nvrtc_, cache);
  ASSERT_NE(first.code, "") << first.report;
  EXPECT_EQ(first.report.substr(0, 12), "compiled in ");
  ASSERT_EQ(std::distance(fs::directory_iterator(cache.folder()), fs::directory_iterator()), 1);
  const fs::path file = fs::directory_iterator(cache.folder())->path();

  const CompiledStep second = compile_step(params, 90, nvrtc_, cache);
  EXPECT_EQ(second.report, "read from " + file.string());
  EXPECT_EQ(second.code, first.code);
  EXPECT_TRUE(second.cached && !first.cached);
  EXPECT_FALSE(compile_step(params, 90, nvrtc_, cache, true).cached) << "anew";

  const std::string whole = bytes_of(file);
  std::string damaged = whole;
  damaged[damaged.size() / 2] = static_cast<char>(damaged[damaged.size() / 2] ^ 1);
  write_bytes(file, damaged);
  EXPECT_EQ(compile_step(params, 90, nvrtc_, cache).report.substr(0, 12), "compiled in ");
  EXPECT_EQ(bytes_of(file), whole) << "kept anew";
}

TEST(KernelCacheFiles, AreThereWholeOrNotAtAll) {
  const TemporaryFolder folder;
  const KernelCache cache(folder.path());
  EXPECT_EQ(cache.read("key"), std::nullopt);
  ASSERT_TRUE(cache.write("key", "code"));
  EXPECT_EQ(cache.read("key"), "code");
  EXPECT_EQ(cache.read("other"), std::nullopt);
  // The key of another program in a file of this name.
  fs::copy_file(cache.file_of("key"), cache.file_of("other"));
  EXPECT_EQ(cache.read("other"), std::nullopt);

  const std::string whole = bytes_of(cache.file_of("key"));
  for (size_t size = 0; size < whole.size(); ++size) {
    write_bytes(cache.file_of("key"), whole.substr(0, size));
    EXPECT_EQ(cache.read("key"), std::nullopt) << "cut off after " << size << " bytes";
  }
  for (size_t at = 0; at < whole.size(); ++at) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 4);
    write_bytes(cache.file_of("key"), damaged);
    EXPECT_EQ(cache.read("key"), std::nullopt) << "byte " << at;
  }
  write_bytes(cache.file_of("key"), whole + "more");
  EXPECT_EQ(cache.read("key"), std::nullopt);
  ASSERT_TRUE(cache.write("key", "code"));
  EXPECT_EQ(cache.read("key"), "code");
}

TEST(KernelCacheFiles, AreNotKeptWhereNobodyMayWrite) {
  const TemporaryFolder folder;
  write_bytes(folder.path() / "file", "");
  for (const fs::path& path : {folder.path() / "file" / "below", fs::path("/proc/gigastep"), fs::path()}) {
    const KernelCache cache(path);
    EXPECT_FALSE(cache.write("key", "code")) << path;
    EXPECT_EQ(cache.read("key"), std::nullopt) << path;
  }
  const KernelCache cache(folder.path());
  fs::create_directory(cache.file_of("key"));
  EXPECT_EQ(cache.read("key"), std::nullopt) << "a folder in its place";
}

TEST(KernelCacheFiles, AreWhereTheEnvironmentSays) {
  using Variables = std::map<std::string, const char*>;
  const auto folder_with = [](const Variables& set) {
    return KernelCache::default_folder([&](const char* name) {
      const auto found = set.find(name);
      return found == set.end() ? nullptr : found->second;
    });
  };
  EXPECT_EQ(folder_with({{"GIGASTEP_CACHE_DIR", "/a"}, {"XDG_CACHE_HOME", "/b"}}), "/a/");
  EXPECT_EQ(folder_with({{"GIGASTEP_CACHE_DIR", ""}, {"XDG_CACHE_HOME", "/b"}, {"HOME", "/h"}}), "/b/gigastep");
  EXPECT_EQ(folder_with({{"HOME", "/home/somebody"}}), "/home/somebody/.cache/gigastep");
  EXPECT_EQ(folder_with({}), "");
}

}  // namespace
}  // namespace giga::test
