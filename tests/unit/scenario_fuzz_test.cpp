// Mutated scenario files: the loader answers with a scenario that prints and reads back, or with an InputError.
#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <iterator>
#include <random>

#include "core/error.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

TEST(ScenarioFuzz, MutatedFilesNeverCrash) {
  const DataDirs dirs = {GIGASTEP_SOURCE_DIR};
  std::vector<std::string> seeds = {print_scenario(load_scenario("special_5_vs_1", dirs))};
  for (const ScenarioInfo& info : list_scenarios(dirs)) {
    std::ifstream in(info.file);
    seeds.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  const std::array<const char*, 24> pieces = {
      "[", "]",       "{",  "}", ": ",    "- ",  "\n", "  ", "&a ",  "*a",     "!x ",    "|",
      ">", "\n---\n", "\"", "'", "1e999", "nan", "-",  "\t", "\xC3", "base: ", "maps: ", "99999999999999999999"};
  std::mt19937 random(1);
  const auto below = [&](size_t n) { return n == 0 ? 0 : random() % n; };
  int n_good = 0, n_bad = 0;
  for (int round = 0; round < 3000; ++round) {
    std::string text = seeds[below(seeds.size())];
    for (size_t changes = 1 + below(3); changes > 0; --changes) {
      const size_t at = below(text.size() + 1);
      const std::string& other = seeds[below(seeds.size())];
      switch (below(4)) {
        case 0:
          text.insert(at, pieces[below(pieces.size())]);
          break;
        case 1:
          text.erase(at, below(20));
          break;
        case 2:
          text.insert(at, 1, static_cast<char>(below(256)));
          break;
        default:
          text.insert(at, other.substr(below(other.size()), below(60)));
      }
    }
    try {
      const Scenario scenario = parse_scenario(text, "fuzz", dirs);
      const std::string printed = print_scenario(scenario);
      ASSERT_EQ(print_scenario(parse_scenario(printed, "fuzz", {})), printed) << text;
      ++n_good;
      compile(scenario);
    } catch (const InputError& e) {
      ASSERT_STRNE(e.what(), "") << text;
      ++n_bad;
    }
  }
  EXPECT_GT(n_good, 100);
  EXPECT_GT(n_bad, 100);
}

}  // namespace
}  // namespace giga
