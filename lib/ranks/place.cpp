#include "ranks/place.hpp"

#include <charconv>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr int kMostRanks = 4096, kFirstPort = 20000, kPorts = 10000;

/// A whole number in a range.
int number(const Variables& variable, const char* name, int least, int most) {
  const char* value = variable(name);
  if (!value) throw InputError(cat("the variable ", name, " is not set, but others of several ranks are"));
  const std::string text = value;
  int n = 0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), n);
  if (code != std::errc() || end != text.data() + text.size() || n < least || n > most)
    throw InputError(cat("the variable ", name, " is '", text, "'; allowed: whole numbers from ", least, " to ", most));
  return n;
}

int number_or(const Variables& variable, const char* name, int least, int most, int otherwise) {
  return variable(name) ? number(variable, name, least, most) : otherwise;
}

std::string text_or(const Variables& variable, const char* name, const std::string& otherwise) {
  const char* value = variable(name);
  return value && *value ? value : otherwise;
}

std::optional<RankPlace> place_of_torchrun(const Variables& variable) {
  RankPlace place;
  place.size = number(variable, "WORLD_SIZE", 1, kMostRanks);
  place.rank = number(variable, "RANK", 0, place.size - 1);
  if (place.size == 1) return std::nullopt;
  place.local_rank = number_or(variable, "LOCAL_RANK", 0, kMostRanks - 1, 0);
  place.host = text_or(variable, "MASTER_ADDR", place.host);
  place.port = number(variable, "MASTER_PORT", 1, 65535);
  place.served = text_or(variable, "TORCHELASTIC_USE_AGENT_STORE", "") == "True";
  place.attempt = text_or(variable, "TORCHELASTIC_RESTART_COUNT", "0");
  return place;
}

std::optional<RankPlace> place_of_slurm(const Variables& variable) {
  RankPlace place;
  place.size =
      number(variable, variable("SLURM_STEP_NUM_TASKS") ? "SLURM_STEP_NUM_TASKS" : "SLURM_NTASKS", 1, kMostRanks);
  if (place.size == 1) return std::nullopt;
  place.rank = number(variable, "SLURM_PROCID", 0, place.size - 1);
  place.local_rank = number_or(variable, "SLURM_LOCALID", 0, kMostRanks - 1, 0);
  place.sees_own_gpu = true;
  const std::string nodes = text_or(variable, "SLURM_STEP_NODELIST", text_or(variable, "SLURM_JOB_NODELIST", ""));
  place.host = text_or(variable, "MASTER_ADDR", first_node(nodes));
  if (place.host.empty())
    throw InputError("neither MASTER_ADDR nor SLURM_STEP_NODELIST nor SLURM_JOB_NODELIST tells where rank 0 is");
  // Jobs that share a machine must not meet.
  const int job = number_or(variable, "SLURM_JOB_ID", 0, 2'000'000'000, 0);
  const int step = number_or(variable, "SLURM_STEP_ID", 0, 2'000'000'000, 0);
  place.port = number_or(variable, "MASTER_PORT", 1, 65535, kFirstPort + (job % kPorts * 7 + step % kPorts) % kPorts);
  place.attempt = cat(job, ".", step, ".", text_or(variable, "SLURM_RESTART_COUNT", "0"));
  return place;
}

}  // namespace

std::string first_node(const std::string& list) {
  const size_t end = list.find_first_of(",[");
  std::string name = list.substr(0, end);
  if (end == std::string::npos || list[end] == ',') return name;
  return name + list.substr(end + 1, list.find_first_of(",-]", end) - end - 1);
}

std::optional<RankPlace> rank_place(const Variables& variable) {
  if (variable("RANK") || variable("WORLD_SIZE")) return place_of_torchrun(variable);
  // SLURM_STEP_ID: sbatch sets the others too for its script, which is one process.
  if (variable("SLURM_PROCID") && variable("SLURM_STEP_ID")) return place_of_slurm(variable);
  return std::nullopt;
}

}  // namespace giga
