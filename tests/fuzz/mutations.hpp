// Mutations: inputs that are nearly right, made from right ones; and the loop that feeds them to a reader.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <vector>

namespace giga::test {

/// A source of mutations. The same seed gives the same mutations on every machine.
class Mutator {
 public:
  explicit Mutator(uint64_t seed) : random_(seed) {}

  size_t below(size_t n) { return n == 0 ? 0 : static_cast<size_t>(random_() % n); }
  template <class T>
  const T& one_of(const std::vector<T>& values) {
    return values.at(below(values.size()));
  }

  /// A text with a few changes: bits flipped, bytes inserted and removed, lines doubled, removed and exchanged, words
  /// replaced by what is hard to read, parts of another text put in.
  std::string text(std::string text, const std::vector<std::string>& others);

  /// Bytes with a few changes behind the first `keep`: bits flipped, ranges overwritten with numbers that are limits
  /// of something, removed, doubled, the end cut off.
  std::string bytes(std::string bytes, size_t keep = 0);

 private:
  void change_text(std::string& text, const std::vector<std::string>& others);
  void change_lines(std::string& text);
  void change_bytes(std::string& bytes, size_t keep);

  std::mt19937_64 random_;
};

/// What a reader made of the inputs.
struct FuzzCount {
  int64_t accepted = 0, refused = 0;
};

/// Feeds inputs to a reader: `n_inputs` of them, or with the environment variable GIGASTEP_FUZZ_SECONDS as many as it
/// takes to pass that time. Fails the test where the reader throws anything but InputError, or takes 10 s for an input.
/// `make` gives the input of a number: always the same. A crash in the long form leaves that number in a file whose
/// name is printed; GIGASTEP_FUZZ_FIRST is the number to begin with (0).
FuzzCount fuzz(const std::string& name, int64_t n_inputs, const std::function<std::string(int64_t)>& make,
               const std::function<void(const std::string&)>& read);

}  // namespace giga::test
