// ParallelSearch: how many runs at once make the most agent-steps per second, found by trying one more each time.
#pragma once

#include <string>

namespace giga {

/// Begins with one run and takes one more while all together make at least a share kGain more agent-steps per second;
/// where they do not, it goes back by one and stays. It knows nothing of processes and clocks.
class ParallelSearch {
 public:
  /// A run more must raise the rate of all by so much. Less is within what rates of different settings differ by.
  static constexpr double kGain = 0.05;

  /// Never more than `most` >= 1 runs.
  explicit ParallelSearch(int most);

  /// Runs that there should be at once now.
  int runs() const { return runs_; }
  /// Whether it stays there. Else the rate of so many runs is wanted.
  bool is_settled() const { return settled_; }

  /// The rate of all `runs()` together, agent-steps per second > 0; not once it is settled. What follows, as a line for
  /// people without its end.
  std::string measured(double rate);
  /// More than one run was tried and one of them failed, as where memory is short: back by one, to stay there. Not once
  /// it is settled. The line for people.
  std::string failed();

 private:
  std::string stay(int runs);

  int most_, runs_ = 1;
  double before_ = 0;  // rate of one run less
  bool settled_ = false;
};

}  // namespace giga
