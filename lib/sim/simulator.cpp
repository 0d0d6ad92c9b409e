#include "sim/simulator.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "core/error.hpp"
#include "sim/map_tables.hpp"
#include "sim/rewards.hpp"
#include "sim/saved_pairs.hpp"

namespace giga {
namespace {

constexpr size_t kFieldAlignment = 256;

size_t padded(size_t bytes) { return (bytes + kFieldAlignment - 1) / kFieldAlignment * kFieldAlignment; }

/// Flags and small enumerations are kept as what they are made of.
template <class T>
constexpr ArrayType file_type() {
  if constexpr (std::is_same_v<T, float>) return ArrayType::f32;
  static_assert(std::is_same_v<T, float> || sizeof(T) == 4 || sizeof(T) == 1);
  return sizeof(T) == 4 ? ArrayType::i32 : ArrayType::u8;
}

/// Whether an array of the state is about pairs: in tables or in lists.
bool of_pairs(const std::string& name) {
  return name == "tracked" || name == "seen" || name == "detected" || name == "fire" || name == "neighbors";
}

std::vector<float> make_box_features(const SimParams& p, const std::vector<Box>& boxes) {
  std::vector<float> features;
  for (const Box& box : boxes) {
    features.insert(features.end(),
                    {box.x1 * p.inv_limit_x, box.y1 * p.inv_limit_y, box.x2 * p.inv_limit_x, box.y2 * p.inv_limit_y});
    if (p.obstacle_heights)
      features.insert(features.end(), {box.z1 * (1.0f / kAltitudeLimit), box.z2 * (1.0f / kAltitudeLimit)});
  }
  return features;
}

}  // namespace

SimTables::SimTables(const SimSpec& spec, Memory& memory) : params_(spec.params) {
  const size_t n = spec.agents.size();
  std::vector<int32_t> sprites(n);
  std::vector<float> floats(5 * n);
  for (size_t i = 0; i < n; ++i) {
    const AgentSpec& agent = spec.agents[i];
    sprites[i] = agent.sprite;
    const float values[5] = {agent.thrust, agent.max_health, agent.range, agent.damage_range, agent.idle_reward};
    for (size_t k = 0; k < 5; ++k) floats[k * n + i] = values[k];
  }
  const size_t n_boxes = static_cast<size_t>(params_.n_boxes);
  std::vector<Box> boxes(spec.maps.size() * n_boxes, Box{});
  std::vector<StartArea> start;
  std::vector<uint16_t> paths;
  for (size_t m = 0; m < spec.maps.size(); ++m) {
    for (size_t b = 0; b < spec.maps[m].boxes.size(); ++b) boxes[m * n_boxes + b] = spec.maps[m].boxes[b];
    for (const StartArea& area : spec.maps[m].start) start.push_back(area);
    paths.insert(paths.end(), spec.maps[m].paths.begin(), spec.maps[m].paths.end());
  }
  sprites_ = Buffer<int32_t>(memory, sprites);
  floats_ = Buffer<float>(memory, floats);
  boxes_ = Buffer<Box>(memory, boxes);
  box_features_ = Buffer<float>(memory, make_box_features(params_, boxes));
  start_ = Buffer<StartArea>(memory, start);
  pictures_ = Buffer<uint8_t>(memory, make_map_pictures(params_, spec.maps));
  paths_ = Buffer<uint16_t>(memory, paths);
  if (params_.has_term_factors) term_factors_ = Buffer<float>(memory, std::vector<float>(kNRewardTerms, 1.0f));
  params_.term_factors = term_factors_.data();
  const float* f = floats_.data();
  list_active_terms(params_);
  params_.agents = {sprites_.data(), f, f + n, f + 2 * n, f + 3 * n, f + 4 * n};
  params_.maps = {boxes_.data(), box_features_.data(), start_.data(), pictures_.data(), paths_.data()};
}

bool finds_by_place(const SimSpec& spec, const SimOptions& options) {
  const int n = spec.params.n_agents;
  if (n > kMaxAgents || options.pairs != Pairs::automatic) return n > kMaxAgents || options.pairs == Pairs::by_place;
  if (spec.params.resolution > 0) return false;
  return n >= kByPlaceAlways ||
         (n >= kByPlaceFrom && std::max(spec.params.n_team[0], spec.params.n_team[1]) <= options.most_shooters);
}

StateShape::StateShape(const SimSpec& spec, const SimOptions& options) : n_agents(spec.params.n_agents) {
  if (!finds_by_place(spec, options)) return;
  shooters = std::min(options.most_shooters, std::max(spec.params.n_team[0], spec.params.n_team[1]));
  rows = spec.params.n_neighbors;
}

size_t state_bytes(const StateShape& shape, int64_t n_worlds) {
  size_t total = 0;
  StateView view{};
  PairLists lists;
  for_each_array(shape, view, lists, [&](const char*, auto*& array, int64_t per_world) {
    total += padded(static_cast<size_t>(per_world * n_worlds) * sizeof(*array));
  });
  return total;
}

void lay_out_state(const StateShape& shape, int64_t n_worlds, uint8_t* bytes, StateView& view, PairLists& lists) {
  for_each_array(shape, view, lists, [&](const char*, auto*& array, int64_t per_world) {
    array = reinterpret_cast<std::remove_reference_t<decltype(array)>>(bytes);
    bytes += padded(static_cast<size_t>(per_world * n_worlds) * sizeof(*array));
  });
}

SimState::SimState(const StateShape& shape, int n_worlds, Memory& memory)
    : shape_(shape), n_worlds_(n_worlds), bytes_(memory, state_bytes(shape, static_cast<int64_t>(n_worlds))) {
  lay_out_state(shape_, n_worlds, bytes_.data(), view_, lists_);
}

void SimState::load(const std::vector<uint8_t>& bytes) {
  GIGA_CHECK(bytes.size() == bytes_.size(), "state of ", bytes.size(), " bytes, ", bytes_.size(), " expected");
  bytes_.from_host(bytes);
  ++n_loads_;
}

void SimState::save(const std::string& prefix, NamedArrays& out) const {
  const std::vector<uint8_t> bytes = bytes_.to_host();
  for_each_array(shape_, view_, lists_, [&](const char* name, const auto* from, int64_t per_world) {
    using T = std::remove_cvref_t<decltype(*from)>;
    NamedArray array{prefix + name, file_type<T>(), {n_worlds_, per_world}, {}};
    const auto offset = reinterpret_cast<const uint8_t*>(from) - bytes_.data();
    const auto size = per_world * n_worlds_ * static_cast<int64_t>(sizeof(T));
    array.bytes.assign(bytes.begin() + offset, bytes.begin() + offset + size);
    out.push_back(std::move(array));
  });
}

void SimState::load(const std::string& prefix, const NamedArrays& in) {
  std::vector<uint8_t> bytes(bytes_.size());
  const bool other_pairs = saved_with_lists(prefix, in) != shape_.lists();
  for_each_array(shape_, view_, lists_, [&](const char* name, const auto* to, int64_t per_world) {
    using T = std::remove_cvref_t<decltype(*to)>;
    if (other_pairs && of_pairs(name)) return;
    const NamedArray& array = find_array(in, prefix + name);
    const size_t size = static_cast<size_t>(per_world * n_worlds_) * sizeof(T);
    if (array.type != file_type<T>() || array.bytes.size() != size)
      throw InputError(cat("array '", array.name, "' of the checkpoint has ", array.bytes.size(), " bytes, expected ",
                           size, ": it was written with other settings"));
    std::copy(array.bytes.begin(), array.bytes.end(),
              bytes.begin() + (reinterpret_cast<const uint8_t*>(to) - bytes_.data()));
  });
  if (other_pairs) {
    StateView state{};
    PairLists lists;
    lay_out_state(shape_, n_worlds_, bytes.data(), state, lists);
    convert_pairs(shape_, n_worlds_, prefix, in, state, lists);
  }
  load(bytes);
}

Simulator::Simulator(SimSpec spec, const SimOptions& options, Memory& memory)
    : spec_(std::move(spec)), options_(options), memory_(&memory) {
  GIGA_CHECK(options.n_worlds > 0, "n_worlds is ", options.n_worlds);
  GIGA_CHECK(options.episodes == 1 ||
                 (options.episodes > 1 && options.on_done == OnDone::freeze && spec_.params.max_episode_length > 0),
             options.episodes, " episodes");
  tables_ = SimTables(spec_, memory);
  state_ = SimState(StateShape(spec_, options_), options.n_worlds, memory);
}

void Simulator::start(const StepIo& io) {
  run(jobs_of_start(io), io, Worlds::all);
  n_lists_ = 0;
}

void Simulator::step(const StepIo& io) {
  begin_steps(1);
  queue_step(io);
}

void Simulator::begin_steps(int count) {
  // Also where no step goes by the list: it tells over() how many worlds play.
  if (options_.on_done != OnDone::freeze) return;
  if (steps_to_list() == 0) {
    list_playing();
    n_lists_ = n_lists() + 1;
    listed_loads_ = state_.n_loads();
    steps_to_list_ = kListPeriod;
  }
  GIGA_CHECK(count <= steps_to_list_, count, " steps, ", steps_to_list_, " until the next list");
  steps_to_list_ -= count;
}

void Simulator::queue_step(const StepIo& io) { run(jobs_of_step(ending(), io), io, worlds_of_step(ending(), io)); }

void Simulator::observe(const StepIo& io) { run(jobs_of_observe(io), io, Worlds::all); }

EpisodeStats take_host_stats(const StateView& state, int64_t n_worlds) {
  EpisodeStats sums;
  for (int64_t world = 0; world < n_worlds; ++world) {
    float* row = state.stats + world * kNStatRows;
    for (int k = 0; k < kNStatRows; ++k) {
      sums.rows[static_cast<size_t>(k)] += static_cast<double>(row[k]);
      row[k] = 0;
    }
  }
  return sums;
}

}  // namespace giga
