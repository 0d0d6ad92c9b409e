// Ranks: the processes that train one run together, and what they tell each other.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "ranks/place.hpp"

namespace at {
class Tensor;
}

namespace giga {

/// A wait for the other ranks that is none of the calls below, as sums of GPUs are, which a rank that is gone would
/// make endless.
struct OutsideWait {
  /// How many parts of it this rank has begun, so that the others can tell who is behind. Throws Error where the wait
  /// itself has failed.
  std::function<int64_t()> begun;
  /// Ends the wait: a rank is missing. Called at most once, and by another thread.
  std::function<void()> give_up;
};

/// All ranks call the same functions in the same order. Each waits for all others, and throws Error where one is
/// missing; the message names it and says what is known of it. Where the store itself does not answer, a call does not
/// come back: the process is ended after `RankPatience::silence` + `giving_up`, with a message and exit code 1.
class Ranks {
 public:
  virtual ~Ranks() = default;

  int rank() const { return rank_; }
  int size() const { return size_; }
  /// Rank 0 writes what is kept of a run.
  bool leads() const { return rank_ == 0; }

  /// What every rank says, in the order of the ranks.
  virtual std::vector<std::string> gather(const std::string& mine) = 0;
  /// The tensors of every rank, on the host; each has as many of the same shapes and types.
  std::vector<std::vector<at::Tensor>> gather_tensors(const std::vector<at::Tensor>& mine);

  /// Adds up a tensor of the same shape over all ranks, in place and in the order of the ranks: all get the same bits.
  void all_reduce_sum(const at::Tensor& tensor);
  /// Makes the tensor of all ranks that of `from`.
  void broadcast(const at::Tensor& tensor, int from = 0);
  std::string broadcast(const std::string& text, int from = 0);
  void barrier() { gather(""); }

  /// From here until end_outside() this rank waits for the others elsewhere: each second another thread looks after
  /// them, and gives up where one has failed, is silent, or lets it wait for longer than `RankPatience::answer`. If the
  /// process is then still here after `RankPatience::giving_up`, it is ended, with the message and exit code 1.
  virtual void begin_outside(OutsideWait wait) = 0;
  /// Throws Error where it gave up.
  virtual void end_outside() = 0;

  /// Tells the others that this rank is about to end, and why; they end too, with this message. Never throws.
  virtual void report_failure(const std::string& message) noexcept = 0;
  /// The work is done: waits until the others need nothing more of this process.
  virtual void leave() = 0;

 protected:
  Ranks(int rank, int size) : rank_(rank), size_(size) {}

 private:
  const int rank_, size_;
};

/// How long ranks are waited for.
struct RankPatience {
  std::chrono::milliseconds answer = std::chrono::minutes(10);     ///< in a call, of a rank that lives
  std::chrono::milliseconds silence = std::chrono::seconds(20);    ///< no sign of life: the rank is taken for dead
  std::chrono::milliseconds giving_up = std::chrono::seconds(10);  ///< for a wait elsewhere, or the store
};

/// Meets the other ranks at c10d's TCPStore, and speaks with them through it. Throws Error where one does not come.
std::unique_ptr<Ranks> join_ranks(const RankPlace& place, const RankPatience& patience);

/// The store of ranks that were started here: it serves them from a process that is none of them.
class RankServer {
 public:
  RankServer();
  ~RankServer();
  RankServer(const RankServer&) = delete;
  RankServer& operator=(const RankServer&) = delete;

  int port() const;
  /// Ends all ranks with this message, unless another one came first.
  void report_failure(const std::string& message) noexcept;

 private:
  struct Store;
  std::unique_ptr<Store> store_;
};

}  // namespace giga
