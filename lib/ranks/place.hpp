// RankPlace: which of several processes this one is, as torchrun and Slurm tell it by variables.
#pragma once

#include <functional>
#include <optional>
#include <string>

namespace giga {

struct RankPlace {
  int rank = 0, size = 1;
  int local_rank = 0;              ///< among those of this machine
  std::string host = "127.0.0.1";  ///< where the store is
  int port = 0;
  bool served = false;        ///< the store is there already; else rank 0 serves it
  std::string attempt;        ///< of the launcher's attempts, whose words the store keeps apart
  bool sees_own_gpu = false;  ///< the launcher may show each process its own GPU alone (srun --gpus-per-task)

  /// The number of its GPU among the `found` ones that it sees.
  int gpu(int found) const { return sees_own_gpu && found == 1 ? 0 : local_rank; }
};

/// The value of a variable of the environment; null where it is not set.
using Variables = std::function<const char*(const char*)>;

/// None where the process is alone. torchrun: RANK, WORLD_SIZE, LOCAL_RANK, MASTER_ADDR, MASTER_PORT. srun:
/// SLURM_PROCID, SLURM_STEP_NUM_TASKS (else SLURM_NTASKS), SLURM_LOCALID, SLURM_LAUNCH_NODE_IPADDR is not the first
/// node's, so the address is MASTER_ADDR or the first of SLURM_STEP_NODELIST (else SLURM_JOB_NODELIST). Throws
/// InputError where they make no sense.
std::optional<RankPlace> rank_place(const Variables& variable);

/// "gpu03" of "gpu[03-05,09],big1".
std::string first_node(const std::string& list);

}  // namespace giga
