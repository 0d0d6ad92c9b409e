// What runs when: the jobs that a start, a step and an observe consist of, and the worlds that they run on. Decided
// here and in run_job (step.hpp), once for every back end: a back end only runs a job over worlds.
#pragma once

#include <cstdint>
#include <type_traits>

#include "core/host_device.hpp"
#include "sim/world.hpp"

namespace giga {

/// What is done to a world in one go.
enum class Job : uint8_t {
  start,    ///< begins the first episode
  step,     ///< one step, where the world plays
  restart,  ///< where the step ended an episode: closes it and begins the next
  play_on,  ///< likewise, unless the world has played all its episodes: then it waits
  observe,  ///< writes the observations once more
};

/// How worlds go on after an episode.
struct Ending {
  OnDone on_done = OnDone::reset;
  int episodes = 1;  ///< OnDone::freeze: those that a world plays before it waits
};

/// Jobs of one call. Each world gets them in this order; worlds do not depend on each other.
struct Jobs {
  Job list[2];
  int count;
  const Job* begin() const { return list; }
  const Job* end() const { return list + count; }
};

/// Whether a world that has played its only episode begins to wait within Job::step. What begins an episode is a job of
/// its own instead: it is rare, and on the GPU it takes registers that a step needs.
GIGA_HD bool step_freezes(Ending ending) { return ending.on_done == OnDone::freeze && ending.episodes == 1; }

inline Jobs jobs_of_start() { return {{Job::start}, 1}; }
inline Jobs jobs_of_observe() { return {{Job::observe}, 1}; }
inline Jobs jobs_of_step(Ending ending) {
  if (ending.on_done == OnDone::reset) return {{Job::step, Job::restart}, 2};
  if (ending.on_done == OnDone::freeze && !step_freezes(ending)) return {{Job::step, Job::play_on}, 2};
  return {{Job::step}, 1};
}

/// Calls f with the job as a constant: f(std::integral_constant<Job, job>).
template <class F>
void with_job(Job job, F&& f) {
  switch (job) {
    case Job::start:
      return f(std::integral_constant<Job, Job::start>{});
    case Job::step:
      return f(std::integral_constant<Job, Job::step>{});
    case Job::restart:
      return f(std::integral_constant<Job, Job::restart>{});
    case Job::play_on:
      return f(std::integral_constant<Job, Job::play_on>{});
    case Job::observe:
      return f(std::integral_constant<Job, Job::observe>{});
  }
}

/// On which worlds jobs run.
enum class Worlds : uint8_t {
  all,
  listed,  ///< those that played when Simulator::list_playing was last called
};

/// Worlds that wait have nothing to write in a step but reward and done; if neither is requested, they are skipped.
inline Worlds worlds_of_step(Ending ending, const StepIo& io) {
  const bool wanted = io.done || io.team[0].reward || io.team[1].reward;
  return ending.on_done == OnDone::freeze && !wanted ? Worlds::listed : Worlds::all;
}
/// OnDone::freeze: steps after which the list of the worlds that still play is made anew, whatever a step writes.
constexpr int kListPeriod = 8;

}  // namespace giga
