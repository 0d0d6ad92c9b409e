// What is done to inputs, and the loop.
#include "mutations.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <iostream>

#include "core/error.hpp"

namespace giga::test {
namespace {

/// Words that readers of YAML and of numbers stumble over.
std::vector<std::string> nasty_words() {
  std::vector<std::string> words = {"1e999",
                                    "-1e999",
                                    "1e-999",
                                    "nan",
                                    ".nan",
                                    ".inf",
                                    "-.inf",
                                    "-0",
                                    "-1",
                                    "0",
                                    "1e18",
                                    "99999999999999999999",
                                    "3e8",
                                    "1_0",
                                    "1__0",
                                    "0x10",
                                    "~",
                                    "null",
                                    "none",
                                    "true",
                                    "\"\"",
                                    "''",
                                    "[]",
                                    "{}",
                                    "[[]]",
                                    "{a: 1}",
                                    "&a x",
                                    "*a",
                                    "!!int 3",
                                    "!x",
                                    "<<: *a",
                                    "? a",
                                    "- ",
                                    ": ",
                                    "|",
                                    ">",
                                    "%TAG",
                                    "---",
                                    "...",
                                    "\n---\na: 1\n",
                                    "\xC3",
                                    "\xEF\xBB\xBF",
                                    "\xED\xA0\x80",
                                    "\xF0\x9F\x9A\x80",
                                    "\t",
                                    "\r",
                                    "#",
                                    "\"",
                                    "'",
                                    "all",
                                    "empty",
                                    "/",
                                    "../x.yaml",
                                    "identical_5_vs_5_fobs",
                                    "base: f"};
  words.emplace_back(1, '\0');
  words.emplace_back(5000, 'x');
  words.emplace_back(600, '[');
  words.emplace_back(20, '{');
  return words;
}

std::vector<std::string> split_lines(const std::string& text) {
  std::vector<std::string> lines;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('\n', at), text.size() - 1) + 1;
    lines.push_back(text.substr(at, end - at));
    at = end;
  }
  return lines;
}

double environment_number(const char* name) {
  const char* text = std::getenv(name);
  return text ? std::atof(text) : 0;
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Of this process: on a busy machine an input may wait for long without being slow.
double processor_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

}  // namespace

void Mutator::change_lines(std::string& text) {
  std::vector<std::string> lines = split_lines(text);
  if (lines.empty()) return;
  const size_t k = below(lines.size()), other = below(lines.size());
  switch (below(3)) {
    case 0:
      lines.insert(lines.begin() + static_cast<std::ptrdiff_t>(other), lines[k]);
      break;
    case 1:
      lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(k));
      break;
    default:
      std::swap(lines[k], lines[other]);
  }
  text.clear();
  for (const std::string& line : lines) text += line;
}

void Mutator::change_text(std::string& text, const std::vector<std::string>& others) {
  static const std::vector<std::string> words = nasty_words();
  constexpr const char* kBetween = " \n:,[]{}";
  const size_t at = below(text.size() + 1);
  switch (below(8)) {
    case 0:
      if (at < text.size()) text[at] = static_cast<char>(text[at] ^ (1 << below(8)));
      return;
    case 1:
      text.insert(at, 1, static_cast<char>(below(256)));
      return;
    case 2:
      text.erase(at, 1 + below(20));
      return;
    case 3:
      text.insert(at, one_of(words));
      return;
    case 4: {
      const std::string& other = one_of(others);
      text.insert(at, other.substr(below(other.size()), below(60)));
      return;
    }
    case 5:
      return change_lines(text);
    default: {  // a whole word
      const size_t begin = std::min(text.find_first_not_of(kBetween, at), text.size());
      const size_t end = std::min(text.find_first_of(kBetween, begin), text.size());
      text.replace(begin, end - begin, one_of(words));
    }
  }
}

std::string Mutator::text(std::string text, const std::vector<std::string>& others) {
  for (size_t changes = 1 + below(4); changes > 0; --changes) change_text(text, others);
  return text;
}

void Mutator::change_bytes(std::string& bytes, size_t keep) {
  static const std::vector<uint64_t> numbers = {0,
                                                1,
                                                2,
                                                3,
                                                4,
                                                7,
                                                8,
                                                16,
                                                0x7F,
                                                0x80,
                                                0xFF,
                                                0x7FFF,
                                                0xFFFF,
                                                0x10000,
                                                0x7FFFFFFF,
                                                0x80000000,
                                                0xFFFFFFFF,
                                                0xFFFFFFFE,
                                                uint64_t{1} << 32,
                                                uint64_t{1} << 48,
                                                ~uint64_t{0} >> 1,
                                                ~uint64_t{0},
                                                ~uint64_t{0} - 7};
  if (bytes.size() <= keep) return;
  const size_t at = keep + below(bytes.size() - keep), left = bytes.size() - at;
  switch (below(8)) {
    case 0:
    case 1:
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
      return;
    case 2:
      bytes[at] = static_cast<char>(below(256));
      return;
    case 3:
    case 4: {  // a number of 1, 2, 4 or 8 bytes, mostly where numbers stand
      const uint64_t number = below(4) == 0 ? below(bytes.size()) : one_of(numbers);
      const size_t width = size_t{1} << below(4), place = below(4) == 0 ? at : at / width * width;
      if (place >= keep) std::memcpy(bytes.data() + place, &number, std::min(width, bytes.size() - place));
      return;
    }
    case 5: {  // a part over another
      const size_t from = keep + below(bytes.size() - keep);
      const std::string part = bytes.substr(from, 1 + below(64));
      bytes.replace(at, std::min(part.size(), left), part.substr(0, left));
      return;
    }
    case 6:
      bytes.erase(at, below(4) == 0 ? left : std::min<size_t>(left, 1 + below(16)));
      return;
    default:
      bytes.insert(at, bytes.substr(at, 1 + below(64)));
  }
}

std::string Mutator::bytes(std::string bytes, size_t keep) {
  for (size_t changes = 1 + below(6); changes > 0; --changes) change_bytes(bytes, keep);
  return bytes;
}

FuzzCount fuzz(const std::string& name, int64_t n_inputs, const std::function<std::string(int64_t)>& make,
               const std::function<void(const std::string&)>& read) {
  constexpr double kSlow = 10;
  const double seconds = environment_number("GIGASTEP_FUZZ_SECONDS");
  const int64_t first = static_cast<int64_t>(environment_number("GIGASTEP_FUZZ_FIRST"));
  const std::string kept = testing::TempDir() + cat("gigastep_fuzz_", getpid());
  std::ofstream latest;
  if (seconds > 0) {
    latest.open(kept);
    std::cout << name << ": the number of the latest input is in " << kept << std::endl;
  }
  const auto start = std::chrono::steady_clock::now();
  FuzzCount count;
  for (int64_t k = first; seconds > 0 ? seconds_since(start) < seconds : k < first + n_inputs; ++k) {
    if (seconds > 0) latest << k << '\n' << std::flush, latest.seekp(0);
    const std::string input = make(k);
    const double begin = processor_seconds();
    try {
      read(input);
      ++count.accepted;
    } catch (const InputError& e) {
      EXPECT_STRNE(e.what(), "") << name << ", input " << k;
      ++count.refused;
    } catch (const std::exception& e) {
      ADD_FAILURE() << name << ", input " << k << ": " << e.what() << "\n" << input;
    }
    EXPECT_LT(processor_seconds() - begin, kSlow) << name << ", input " << k;
    if (testing::Test::HasFailure()) return count;
  }
  std::remove(kept.c_str());
  std::cout << name << ": " << count.accepted + count.refused << " inputs in " << seconds_since(start) << " s, "
            << count.accepted << " accepted, " << count.refused << " refused" << std::endl;
  return count;
}

}  // namespace giga::test
