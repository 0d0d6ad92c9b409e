// Watcher: a thread that looks at what goes on while the main thread works.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace giga {

/// Calls `look` ten times a second while it lives.
class Watcher {
 public:
  explicit Watcher(std::function<void()> look) : look_(std::move(look)), thread_([this] { run(); }) {}
  ~Watcher() {
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }
  Watcher(const Watcher&) = delete;
  Watcher& operator=(const Watcher&) = delete;

 private:
  void run() {
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, std::chrono::milliseconds(100), [this] { return over_; })) look_();
  }

  const std::function<void()> look_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool over_ = false;
  std::thread thread_;  // the last, so that all else is there when it begins
};

}  // namespace giga
