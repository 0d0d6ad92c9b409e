// Changed replays in the readers of other languages, that of the page and the example in Python: each is read, or is
// refused in words.
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "changed_replays.hpp"
#include "core/error.hpp"
#include "io/browser.hpp"
#include "io/sample_replay.hpp"
#include "support/source.hpp"
#include "watch/page.hpp"

namespace giga::test {
namespace {

/// Games and crowds by turns, changed inside or anywhere.
std::vector<std::string> changed_replays() {
  const ChangedInsides insides[] = {ChangedInsides(sample_replay()), ChangedInsides(sample_crowd())};
  const std::string whole[] = {encode_replay(sample_replay()), encode_replay(sample_crowd())};
  std::vector<std::string> all;
  for (int64_t k = 0; k < 120; ++k)
    for (const size_t crowd : {0, 1}) {
      all.push_back(insides[crowd](k));
      all.push_back(Mutator(static_cast<uint64_t>(k)).bytes(whole[crowd]));
    }
  return all;
}

bool is_sound(const std::string& bytes) {
  try {
    decode_replay(bytes, "fuzz.replay");
  } catch (const InputError&) {
    return false;
  }
  return true;
}

/// What is sound here is read there too. Of the rest a reader may read what it does not look at.
void expect_verdicts(const std::vector<std::string>& replays, const Texts& verdicts, const Texts& refusals) {
  ASSERT_EQ(verdicts.size(), replays.size());
  int sound = 0, refused = 0;
  for (size_t k = 0; k < replays.size(); ++k) {
    const std::string& verdict = verdicts[k];
    const bool read = verdict == "read", reads_here = is_sound(replays[k]);
    EXPECT_TRUE(read || std::any_of(refusals.begin(), refusals.end(),
                                    [&](const std::string& words) { return verdict.rfind(words, 0) == 0; }))
        << k << ": " << verdict;
    EXPECT_TRUE(read || !reads_here) << k << ": " << verdict;
    sound += reads_here;
    refused += !read;
  }
  EXPECT_GT(sound, 10);
  EXPECT_GT(refused, 200);
}

class PageReaderFuzz : public InBrowser {};

TEST_F(PageReaderFuzz, IsThatOfThePage) {
  const std::vector<std::string> replays = changed_replays();
  std::string list;
  for (const std::string& replay : replays) list += '"' + base64(replay) + "\",\n";
  const std::string page = "<!doctype html><meta charset=utf-8><body><script>" +
                           read_file(source_path("lib/watch/data.js")) + "</script></body>";
  const Document seen = use(page, "fuzz", "const REPLAYS = [" + list + "];\n", "");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  expect_verdicts(replays, texts(seen, "verdicts"), {"a replay is damaged: ", "a replay has format "});
}

TEST(PythonReaderFuzz, IsTheExample) {
  const std::string python = python_with("zlib");
  if (python.empty()) GTEST_SKIP() << "no Python";
  const std::vector<std::string> replays = changed_replays();
  const TemporaryFolder folder;
  for (size_t k = 0; k < replays.size(); ++k)
    std::ofstream(folder / (std::to_string(k) + ".replay"), std::ios::binary) << replays[k];
  std::ofstream(folder / "all.py") << "import sys\n"
                                      "sys.path.insert(0, sys.argv[1])\n"
                                      "from read_replay import read_replay\n"
                                      "for k in range(int(sys.argv[2])):\n"
                                      "    try:\n"
                                      "        read_replay(f'{k}.replay')\n"
                                      "        print('read')\n"
                                      "    except ValueError as error:\n"
                                      "        print(str(error).removeprefix(f'{k}.replay '))\n";
  const std::string command = "cd " + shell_word(folder.path().string()) + " && timeout 200 " + shell_word(python) +
                              " all.py " + shell_word(source_path("examples")) + " " + std::to_string(replays.size()) +
                              " >verdicts 2>errors";
  EXPECT_EQ(shell(command), 0) << read_file(folder / "errors");
  Texts verdicts;
  std::istringstream lines(read_file(folder / "verdicts"));
  for (std::string line; std::getline(lines, line);) verdicts.push_back(line);
  expect_verdicts(replays, verdicts, {"is damaged: ", "is no replay of the formats (3, 4)"});
}

}  // namespace
}  // namespace giga::test
