// Fibers of LockstepThreads. They are entered through <ucontext.h>; after that the compiler's own setjmp and longjmp
// switch between them, because swapcontext makes two system calls.
#include "parity/lockstep_threads.hpp"

#include <ucontext.h>

#include <algorithm>
#include <numeric>

#include "core/error.hpp"

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/common_interface_defs.h>
#define GIGA_UNCHECKED __attribute__((noinline, no_sanitize("address")))
#else
#define GIGA_UNCHECKED __attribute__((noinline))
#endif

namespace giga::test {
namespace {

constexpr size_t kStackBytes = 128 << 10;
constexpr size_t kStackGuardBytes = 256;
constexpr char kGuard = 0x5A;

}  // namespace

/// Where the main thread or a fiber goes on.
struct LockstepThreads::Switch {
  void* point[5];  // of __builtin_setjmp
  const void* stack = nullptr;
  size_t stack_bytes = 0;

  GIGA_UNCHECKED static void jump(Switch& to) { __builtin_longjmp(to.point, 1); }
  /// Leaves here and returns when somebody jumps back. `first`: where `to` begins, if it has not yet.
  GIGA_UNCHECKED static void change(Switch& from, Switch& to, const ucontext_t* first) {
#if defined(__SANITIZE_ADDRESS__)
    void* fake = nullptr;
    __sanitizer_start_switch_fiber(&fake, to.stack, to.stack_bytes);
#endif
    if (__builtin_setjmp(from.point) == 0) {
      if (first) setcontext(first);
      jump(to);
    }
#if defined(__SANITIZE_ADDRESS__)
    __sanitizer_finish_switch_fiber(fake, nullptr, nullptr);
#endif
  }
};

struct LockstepThreads::Fiber {
  Switch at;
  ucontext_t first;
  bool entered = false;
  State state = State::done;
  bool flag = false;                                     // handed in
  bool answer = false;                                   // of the group
  std::unique_ptr<char[]> stack{new char[kStackBytes]};  // NOLINT: grows downwards to the guard
  bool overflowed() const {
    return std::count(stack.get(), stack.get() + kStackGuardBytes, kGuard) != kStackGuardBytes;
  }
};

LockstepThreads::LockstepThreads(int n_threads) : main_(std::make_unique<Switch>()) {
  for (int k = 0; k < n_threads; ++k) fibers_.push_back(make_fiber());
}

std::unique_ptr<LockstepThreads::Fiber> LockstepThreads::make_fiber() {
  auto fiber = std::make_unique<Fiber>();
  char* stack = fiber->stack.get();
  std::fill_n(stack, kStackGuardBytes, kGuard);
  getcontext(&fiber->first);
  fiber->first.uc_stack.ss_sp = stack;
  fiber->first.uc_stack.ss_size = kStackBytes;
  fiber->at.stack = stack;
  fiber->at.stack_bytes = kStackBytes;
  const auto self = static_cast<uint64_t>(reinterpret_cast<uintptr_t>(this));  // makecontext hands on ints
  makecontext(&fiber->first, reinterpret_cast<void (*)()>(&LockstepThreads::enter), 2,
              static_cast<unsigned>(self >> 32), static_cast<unsigned>(self));
  return fiber;
}

LockstepThreads::~LockstepThreads() = default;

GIGA_UNCHECKED void LockstepThreads::enter(unsigned high, unsigned low) {
  auto* self = reinterpret_cast<LockstepThreads*>(static_cast<uintptr_t>(static_cast<uint64_t>(high) << 32 | low));
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_finish_switch_fiber(nullptr, &self->main_->stack, &self->main_->stack_bytes);
#endif
  const int thread = self->current_;
  for (;;) {
    try {
      (*self->body_)(thread);
    } catch (...) {
      if (!self->error_) self->error_ = std::current_exception();
    }
    self->pause(State::done, false);
  }
}

void LockstepThreads::resume(int thread) {
  Fiber& fiber = *fibers_[static_cast<size_t>(thread)];
  current_ = thread;
  const ucontext_t* first = fiber.entered ? nullptr : &fiber.first;
  fiber.entered = true;
  fiber.state = State::runs;
  Switch::change(*main_, fiber.at, first);
}

bool LockstepThreads::pause(State state, bool flag) {
  Fiber& fiber = *fibers_[static_cast<size_t>(current_)];
  fiber.state = state;
  fiber.flag = flag;
  Switch::change(fiber.at, *main_, nullptr);
  return fiber.answer;
}

void LockstepThreads::wait() { pause(State::waits, false); }
bool LockstepThreads::any(bool flag) { return pause(State::asks, flag); }

void LockstepThreads::advance(int group, int group_size, ThreadOrder order) {
  std::vector<int> threads(static_cast<size_t>(group_size));
  std::iota(threads.begin(), threads.end(), group * group_size);
  if (order == ThreadOrder::backward) std::reverse(threads.begin(), threads.end());
  for (size_t k = threads.size(); order == ThreadOrder::shuffled && k > 1; --k) {
    dice_ = dice_ * 1664525u + 1013904223u;
    std::swap(threads[k - 1], threads[(dice_ >> 8) % k]);
  }
  for (const int thread : threads) resume(thread);
  if (error_) return;
  bool answer = false;
  const State state = fibers_[static_cast<size_t>(threads[0])]->state;
  for (const int thread : threads) {
    const Fiber& fiber = *fibers_[static_cast<size_t>(thread)];
    GIGA_CHECK(fiber.state == state, "threads ", threads[0], " and ", thread, " are at different barriers");
    GIGA_CHECK(!fiber.overflowed(), "thread ", thread, " has used more than its stack");
    answer = answer || fiber.flag;
  }
  for (const int thread : threads) fibers_[static_cast<size_t>(thread)]->answer = answer;
}

void LockstepThreads::run(int group_size, ThreadOrder order, const std::function<void(int)>& body) {
  const int n = static_cast<int>(fibers_.size()), groups = n / group_size;
  GIGA_CHECK(groups * group_size == n, n, " threads in groups of ", group_size);
  body_ = &body;
  for (auto& fiber : fibers_) fiber->state = State::runs;
  for (bool left = true; left;) {
    left = false;
    for (int group = 0; group < groups; ++group) {
      const auto done = [&] { return fibers_[static_cast<size_t>(group * group_size)]->state == State::done; };
      if (done()) continue;
      advance(group, group_size, order);
      if (error_) std::rethrow_exception(error_);
      left = left || !done();
    }
  }
}

}  // namespace giga::test
