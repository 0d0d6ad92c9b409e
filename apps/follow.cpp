#include "apps/follow.hpp"

#include <chrono>

#include "apps/joined_ranks.hpp"
#include "apps/stop_request.hpp"
#include "core/error.hpp"
#include "io/state_hash.hpp"

namespace giga {
namespace {

/// ", in ranks 1 and 3 of 4"
std::string in_ranks(const std::vector<int>& found, int size) {
  if (found.empty())
    return cat(", in what the ", size, " ranks share or in their sum, not in what one of them had alone");
  if (static_cast<int>(found.size()) == size) return cat(", in each of the ", size, " ranks");
  std::string text = found.size() == 1 ? ", in rank " : ", in ranks ";
  for (size_t k = 0; k < found.size(); ++k) text += cat(k == 0 ? "" : k + 1 == found.size() ? " and " : ", ", found[k]);
  return cat(text, " of ", size);
}

}  // namespace

std::string told(const Divergence& what, const Ranks* ranks) {
  return cat("training diverged: the ", what.tensor, " of team ", what.team, " held a NaN or an infinity at update ",
             what.update, what.minibatch > 0 ? cat(", minibatch ", what.minibatch) : "",
             ranks ? in_ranks(what.ranks, ranks->size()) : "");
}

void expect_same_state(Ranks* ranks, const NamedArrays& arrays) {
  if (!ranks) return;
  const std::vector<std::string> all = ranks->gather(state_sha256(arrays));
  for (size_t rank = 1; rank < all.size(); ++rank)
    if (all[rank] != all[0])
      throw Error(cat("rank ", rank, " has come to another state than rank 0 (SHA-256 ", all[rank].substr(0, 16),
                      "... instead of ", all[0].substr(0, 16),
                      "...): machines, builds or numbers of threads of the ranks differ; nothing was saved"));
}

int follow(TrainingSetup setup) {
  const StopRequest signals;
  Learner& learner = *setup.learner;
  Ranks* ranks = setup.ranks.get();
  const TrainConfig& train = setup.run.config.train;
  const auto begin = std::chrono::steady_clock::now();
  int64_t saved_update = setup.from ? learner.updates_done() : -1;
  const auto save = [&] {
    NamedArrays arrays;
    learner.save(arrays);
    expect_same_state(ranks, arrays);
    saved_update = learner.updates_done();
  };

  if (!setup.from || setup.settings_changed) save();
  while (learner.agent_steps_done() < train.total_agent_steps) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (const int code = agreed_stop(ranks, stop_code(train, learner.agent_steps_done(), seconds))) {
      if (saved_update != learner.updates_done()) save();
      return code;
    }
    learner.update();
    if (const auto what = learner.divergence()) {
      NamedArrays for_rank_0;  // which keeps it beside the batch
      learner.save(for_rank_0);
      learner.save_batch(for_rank_0);
      throw Error(cat(told(*what, ranks), "; rank 0 keeps the batch"), ErrorKind::diverged);
    }
    if (as_rank_0_says(ranks, false)) save();
  }
  return 0;
}

}  // namespace giga
