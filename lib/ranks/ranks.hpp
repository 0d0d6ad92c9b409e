// Ranks: the processes that train one run together, and what they tell each other.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "ranks/place.hpp"

namespace at {
class Tensor;
}

namespace giga {

/// All ranks call the same functions in the same order. Each waits for all others, and throws Error where one is
/// missing; the message names it and says what is known of it.
class Ranks {
 public:
  virtual ~Ranks() = default;

  int rank() const { return rank_; }
  int size() const { return size_; }
  /// Rank 0 writes what is kept of a run.
  bool leads() const { return rank_ == 0; }

  /// What every rank says, in the order of the ranks.
  virtual std::vector<std::string> gather(const std::string& mine) = 0;

  /// Adds up a tensor of the same shape over all ranks, in place and in the order of the ranks: all get the same bits.
  void all_reduce_sum(const at::Tensor& tensor);
  /// The rows of all ranks, those of rank 0 first; every rank has as many.
  at::Tensor gather_rows(const at::Tensor& mine);
  /// Makes the tensor of all ranks that of `from`.
  void broadcast(const at::Tensor& tensor, int from = 0);
  std::string broadcast(const std::string& text, int from = 0);
  void barrier() { gather(""); }

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
  std::chrono::milliseconds answer = std::chrono::minutes(10);   ///< in a call, of a rank that lives
  std::chrono::milliseconds silence = std::chrono::seconds(20);  ///< no sign of life: the rank is taken for dead
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
