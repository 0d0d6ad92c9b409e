// The gradients of MAPPO's losses, fused: one kernel for each network gathers a minibatch, takes it through the
// network, the loss and back by tensor cores; what lies between the layers stays on the chip. Two more add up the sums
// of all blocks and take the step. Networks that are too wide for that take several kernels (cuda/ppo_wide.hpp).
#pragma once

#include <cstdint>

#include "math/ppo_figures.hpp"
#include "math/ppo_loss.hpp"
#include "math/small_mlp.hpp"
#include "math/step_gate.hpp"
#include "sim/params.hpp"

namespace giga {

/// Where a critic of the true state finds its agents (sim/state_observation.hpp). Its first layer makes a code of each
/// agent's numbers, of which the first says whether it lives. The second reads an agent's own code, the mean codes of
/// the living of its team and of the other one, and the world: a weight [out, inputs(codes)].
struct FusedState {
  static constexpr int kMostAgents = 64, kMostWorld = 47;  ///< of a team; numbers of the world
  int first_own = 0, first_other = 0;                      ///< in the order of the agents
  int n_other = 0;                                         ///< agents of the other team
  int world = 0;                                           ///< numbers behind those of the agents; 0: no such critic

  GIGA_HD int inputs(int codes) const { return 3 * codes + world; }
  bool fits() const { return n_other <= kMostAgents && world <= kMostWorld; }
};

/// A network with two hidden layers, as its flat parameters hold it. A team weight [out, in] reads the mean of what the
/// living agents of the team feed into the layer (composed critics).
struct FusedMlp : SmallMlp {
  static constexpr int kLayers = 3;
  static constexpr int kHidden = 256;       ///< most numbers of a hidden layer
  static constexpr int kNarrowHidden = 64;  ///< up to which a warp takes rows through all layers in its registers
  static constexpr int kBlockHidden = 128;  ///< up to which a block takes them through all layers in shared memory
  static constexpr int kMaxInput = 192;     ///< most numbers of an input
  int team_weight[kLayers] = {-1, -1, -1};  ///< -1 = none; the first layer never has one
  FusedState state;                         ///< of a critic of the true state
  int64_t size = 0;                         ///< of the flat parameters

  FusedMlp() = default;
  FusedMlp(const SmallMlp& mlp, int64_t size_) : SmallMlp(mlp), size(size_) {}
  bool fits() const {
    const int most = reads_state() ? kBlockHidden : kHidden;
    return n_layers == kLayers && width[0] <= kMaxInput && width[1] <= most && width[2] <= most && state.fits();
  }
  GIGA_HD bool reads_state() const { return state.world > 0; }
  GIGA_HD bool is_narrow() const { return width[1] <= kNarrowHidden && width[2] <= kNarrowHidden; }
  GIGA_HD bool is_wide() const { return width[1] > kBlockHidden || width[2] > kBlockHidden; }
};

/// The rows of a minibatch: of each state those of n agents.
struct FusedRows {
  const int64_t* states = nullptr;  // [n_states] of the rollout; null: states 0, 1, ...
  int64_t n_states = 0;
  int n = 0;  // agents of the team
  // [rollout states, n, obs_stride], from the first number that the network reads; or the true states [rollout states,
  // obs_stride] for a critic of these
  const float* obs = nullptr;
  int64_t obs_stride = 0;
  const uint8_t* alive = nullptr;   // [rollout states, n]
  const float* obs_mean = nullptr;  // [input]; null: observations are not normalised
  const float* obs_std = nullptr;   // [input]
  float obs_limit = 0;              // normalised observations are clamped to +- this
};

/// Sums over the living rows of a minibatch, in parts: their number, their advantages, the squares of these.
constexpr int kMomentParts = 64, kMoments = 3;

/// The policy's loss: numbers of rollout rows [rollout states, n].
struct FusedPolicyLoss {
  const float* old_log_prob = nullptr;
  const float* advantage = nullptr;
  const int32_t* action = nullptr;         // discrete actions
  const float* pre_tanh_action = nullptr;  // [.., 3] continuous actions
  const float* advantage_mean = nullptr;   // scalars; null: the minibatch's own moments
  const float* advantage_inv_std = nullptr;
  const float* entropy_coef = nullptr;  // scalars
  const float* clip_coef = nullptr;
};
/// The value's loss.
struct FusedValueLoss {
  const float* old_value = nullptr;
  const float* returns = nullptr;
  const float* value_mean = nullptr;  // scalars of the normaliser
  const float* value_std = nullptr;
  float value_coef = 0;
  ValueError error{};
};

struct FusedActor {
  FusedMlp net{};
  const float* parameters = nullptr;  // [net.size]
  FusedRows rows{};
  FusedPolicyLoss loss{};
  const double* moments = nullptr;  // [kMomentParts, kMoments] of the minibatch
  int n_partial = 0;                // blocks that share the work
  // [partial_rows(net, n_partial), net.size + kFusedSums] out: sums of each block, or of all
  float* partial = nullptr;
  uint32_t* wide = nullptr;  // [WideLayers::words_for(..)] for wide networks (cuda/ppo_wide.hpp): work memory
};
struct FusedCritic {
  FusedMlp net{};
  const float* parameters = nullptr;
  FusedRows rows{};
  FusedValueLoss loss{};
  const double* moments = nullptr;
  int n_partial = 0;
  float* partial = nullptr;  // as above; or
  float* values = nullptr;   // [states, n] out: only the values are computed
  uint32_t* kept = nullptr;  // [kept_words(..)] for gradients where that is not 0: work memory
  uint32_t* wide = nullptr;  // as above; for values: room for `wide_tiles` tiles
  int64_t wide_tiles = 0;
};
/// What a block of a composed critic with a hidden layer of 65 to 128 numbers keeps of each state until its last tile:
/// the mean features of the first layer, and the sum of the gradients by the sums of the second. The gradient of the
/// team weight, which is made of them, takes the registers of the other gradients then.
struct KeptStates {
  static constexpr int kTileRows = 64, kMost = 32;                   // of a tile: rows, states
  static constexpr int kHalves = FusedMlp::kBlockHidden, kRows = 2;  // of a state: rows of so many numbers
  static constexpr int kWords = kHalves / 2;                         // of a row
  int per_tile;
  int64_t per_block;

  GIGA_HD KeptStates(int n, int64_t n_states, int n_partial) : per_tile((n == 1 ? kMost : kTileRows / n)) {
    const int64_t tiles = (n_states + per_tile - 1) / per_tile;
    per_block = (tiles + n_partial - 1) / n_partial * per_tile;
  }
  static int64_t words(const FusedMlp& net, int n, int64_t n_states, int n_partial) {
    if (net.is_narrow() || net.is_wide() || net.team_weight[1] < 0) return 0;
    return KeptStates(n, n_states, n_partial).per_block * n_partial * kRows * kWords;
  }
};
/// What a block of a critic of the true state keeps of each state until its last tile, in rows of half-precision
/// numbers: the mean codes of both teams, the world, and the sum of the gradients by the sums of the second layer.
/// Three products of the last with the others are the gradient of what the rows of a state read alike.
struct KeptTrueStates {
  static constexpr int kTileRows = 64, kMost = 16;  // of a tile: rows of a team, states
  enum Row : int { kOwnMean, kOtherMean, kWorld, kTotal, kRows };
  int per_tile;
  int64_t per_block;
  int words;  // of a row

  GIGA_HD KeptTrueStates(const FusedMlp& net, int n, int64_t n_states, int n_partial)
      : words((net.is_narrow() ? FusedMlp::kNarrowHidden : FusedMlp::kBlockHidden) / 2) {
    per_tile = states_of_tile(n, net.state.n_other);
    const int64_t tiles = (n_states + per_tile - 1) / per_tile;
    per_block = (tiles + n_partial - 1) / n_partial * per_tile;
  }
  GIGA_HD static int states_of_tile(int n, int n_other) {
    const int most = kTileRows / (n > n_other ? n : n_other);
    return most < kMost ? most : kMost;
  }
  GIGA_HD int64_t words_per_block() const { return per_block * kRows * words; }
};
/// Words that FusedCritic::kept needs.
inline int64_t kept_words(const FusedMlp& net, int n, int64_t n_states, int n_partial) {
  if (net.reads_state()) return KeptTrueStates(net, n, n_states, n_partial).words_per_block() * n_partial;
  return KeptStates::words(net, n, n_states, n_partial);
}
/// Rows of `partial`: those of wide networks are added up before.
inline int partial_rows(const FusedMlp& net, int n_partial) { return net.is_wide() ? 1 : n_partial; }
/// Behind the gradient: the actor's sums of diagnostics (PolicyDiagnostic), the critic's sum of losses.
constexpr int kFusedSums = 8;
static_assert(kNPolicyDiagnostics <= kFusedSums);

/// Minibatches of an epoch: an order of states cut into pieces, as equal as possible.
struct MinibatchPieces {
  int64_t n_states;
  int n_pieces;
  /// The first state of piece k; of piece n_pieces: the end.
  GIGA_HD int64_t begin(int k) const {
    const int64_t more = n_states % n_pieces;
    return n_states / n_pieces * k + (k < more ? k : more);
  }
};

/// A step of actor and critic from the sums of their blocks.
struct FusedStep {
  struct Network {
    int n_partial = 0;
    const float* partial = nullptr;  // [n_partial, size + kFusedSums]
    int64_t size = 0;
    StepGate gate{};  // its norm is the one below
    AdamStep adam{};
    float* norm = nullptr;  // [1] out: of the gradient
    float* sums = nullptr;  // [kFusedSums] out
  };
  Network actor, critic;
  PolicyNote note{};             // of the actor's sums, before the gates
  float* value_loss = nullptr;   // [1] the critic's sum of losses is added
  double* squares = nullptr;     // [fused_step_blocks(..)] of the gradients' parts
  uint32_t* finished = nullptr;  // [1] 0, and 0 again afterwards: blocks that have finished
};

/// Whether the GPU can run them: tensor cores for half precision, and 227 KB of shared memory for a multiprocessor
/// (compute capability 9.0).
bool fused_gradients_run(int index);
/// Blocks that share a minibatch, and rows of `partial`.
int fused_blocks(int index);
int fused_step_blocks(int64_t actor_size, int64_t critic_size);

/// All are queued. The number of multiprocessors decides the order of sums; on one GPU results repeat bit for bit.
/// Factors of products are rounded to half precision (10 bits of mantissa, as TF32 has), gradients at a scale that
/// keeps them in its range; sums are fp32, tanh is within 2^-21 (of wide networks 2^-20), derivatives of activations
/// are rounded to half precision (of tanh in the first layer of wide networks they follow from rounded features); exp
/// and log are those of the hardware.
///
/// The moments of each minibatch of an epoch: moments [pieces, kMomentParts, kMoments]. rows.states: of the epoch.
void launch_moments(const FusedRows& rows, MinibatchPieces pieces, const float* advantage, double* moments, int index,
                    void* stream);
void launch_actor_gradient(const FusedActor& actor, int index, void* stream);
void launch_critic_gradient(const FusedCritic& critic, int index, void* stream);
/// The sums over all blocks of `step`'s networks: `to` [actor.size + kFusedSums + critic.size + kFusedSums]. As a
/// partial of one row for each network, launch_gradient_sums() takes them in once they are those of all ranks.
void launch_block_sums(const FusedStep& step, float* to, int index, void* stream);
/// The sums over all blocks become the gradients; their norms, the notes and the gates follow.
void launch_gradient_sums(const FusedStep& step, int index, void* stream);
/// Both networks step; the gradients are cleared.
void launch_adam(const FusedStep& step, int index, void* stream);

}  // namespace giga
