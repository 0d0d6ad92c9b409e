#include "learn/players/mixed_controller.hpp"

#include <algorithm>

#include "core/error.hpp"

namespace giga {
namespace {

class MixedController final : public TeamController {
 public:
  explicit MixedController(std::vector<std::shared_ptr<TeamController>> members) : members_(std::move(members)) {
    for (const auto& member : members_) {
      const int64_t size = member->memory_size();
      if (size > 0 && memory_size_ > 0 && size != memory_size_)
        throw InputError(cat("its policies remember ", memory_size_, " and ", size,
                             " numbers; all that remember must remember as many"));
      memory_size_ = std::max(memory_size_, size);
    }
  }

  ObservationSet reads() const override {
    ObservationSet all = members_.front()->reads();
    for (const auto& member : members_) all |= member->reads();
    return all;
  }
  int64_t memory_size() const override { return memory_size_; }
  int64_t n_sharing() const override { return static_cast<int64_t>(members_.size()); }
  bool repeats() const override {
    return std::all_of(members_.begin(), members_.end(), [](const auto& member) { return member->repeats(); });
  }
  void act(std::span<const TeamStep> parts) override {
    const int64_t n = n_sharing();
    std::vector<TeamStep> own;
    for (int64_t k = 0; k < n; ++k) {
      own.clear();
      for (const TeamStep& part : parts) {
        const WorldRange worlds = part_of(part.worlds, k, n);
        if (worlds.count == 0) continue;
        own.push_back(part.part(worlds).without_log_prob());
        own.back().behind_step = false;  // other members' work may lie between
      }
      if (!own.empty()) members_[static_cast<size_t>(k)]->act(own);
    }
  }

 private:
  const std::vector<std::shared_ptr<TeamController>> members_;
  int64_t memory_size_ = 0;
};

}  // namespace

std::unique_ptr<TeamController> mixed_controller(std::vector<std::shared_ptr<TeamController>> members) {
  return std::make_unique<MixedController>(std::move(members));
}

}  // namespace giga
