// LockstepThreads: the threads of a block of the GPU, run one after the other on a CPU thread. Each runs until its next
// barrier, and goes on when its whole group is there.
#pragma once

#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <vector>

namespace giga::test {

/// The order in which the threads of a group go from barrier to barrier. Where a barrier is missing, one of them lets a
/// thread see what another has not written yet, or has written already.
enum class ThreadOrder { forward, backward, shuffled };

class LockstepThreads {
 public:
  explicit LockstepThreads(int n_threads);
  ~LockstepThreads();

  /// Runs body(0) ... body(n_threads - 1). Each `group_size` of them share their barriers, as a warp or a block does.
  /// Throws Error where threads of a group do not come to the same barriers.
  void run(int group_size, ThreadOrder order, const std::function<void(int thread)>& body);

  /// A body's barrier. `any` also tells whether any thread of the group handed in true.
  void wait();
  bool any(bool flag);

 private:
  enum class State : uint8_t { runs, waits, asks, done };
  struct Fiber;
  struct Switch;

  std::unique_ptr<Fiber> make_fiber();
  static void enter(unsigned high, unsigned low);
  void resume(int thread);
  bool pause(State state, bool flag);
  void advance(int group, int group_size, ThreadOrder order);

  std::vector<std::unique_ptr<Fiber>> fibers_;
  std::unique_ptr<Switch> main_;
  const std::function<void(int)>* body_ = nullptr;
  int current_ = 0;
  uint32_t dice_ = 1;  // of ThreadOrder::shuffled
  std::exception_ptr error_;
};

}  // namespace giga::test
