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
  start,       ///< begins the first episode
  step,        ///< one step, where the world plays
  restart,     ///< where the step ended an episode: closes it and begins the next
  play_on,     ///< likewise, unless the world has played all its episodes: then it waits
  observe,     ///< writes the observations once more
  draw_final,  ///< where the step ended an episode: draws its last images
  draw,        ///< draws the images
};

/// How worlds go on after an episode.
struct Ending {
  OnDone on_done = OnDone::reset;
  int episodes = 1;  ///< OnDone::freeze: those that a world plays before it waits
};

/// Jobs of one call. Each world gets them in this order; worlds do not depend on each other.
struct Jobs {
  Job list[4] = {};
  int count = 0;
  void add(Job job) { list[count++] = job; }
  const Job* begin() const { return list; }
  const Job* end() const { return list + count; }
};

/// Whether images are wanted, and whether those before a reset are.
GIGA_HD bool wants_images(const StepIo& io) {
  return io.team[0].obs[Observation::image].rows || io.team[1].obs[Observation::image].rows ||
         io.world[Observation::global_image].rows || io.world[Observation::image_state].rows;
}
GIGA_HD bool wants_final_images(const StepIo& io) {
  return io.team[0].obs[Observation::image].final_rows || io.team[1].obs[Observation::image].final_rows ||
         io.world[Observation::global_image].final_rows || io.world[Observation::image_state].final_rows;
}

/// Whether Job::step also does what follows where it ended an episode: the world waits, or its next episode starts.
/// Last images are drawn before that, by a job of their own; so is the start of a next episode with OnDone::freeze.
GIGA_HD bool step_settles(Ending ending, const StepIo& io) {
  return !wants_final_images(io) &&
         (ending.on_done == OnDone::reset || (ending.on_done == OnDone::freeze && ending.episodes == 1));
}

/// The job, and that which draws the images if they are wanted.
inline Jobs with_images(Job job, const StepIo& io) {
  Jobs jobs;
  jobs.add(job);
  if (wants_images(io)) jobs.add(Job::draw);
  return jobs;
}
inline Jobs jobs_of_start(const StepIo& io) { return with_images(Job::start, io); }
inline Jobs jobs_of_observe(const StepIo& io) { return with_images(Job::observe, io); }
inline Jobs jobs_of_step(Ending ending, const StepIo& io) {
  Jobs jobs;
  jobs.add(Job::step);
  if (ending.on_done != OnDone::keep && wants_final_images(io)) jobs.add(Job::draw_final);
  if (ending.on_done == OnDone::reset && !step_settles(ending, io)) jobs.add(Job::restart);
  if (ending.on_done == OnDone::freeze && !step_settles(ending, io)) jobs.add(Job::play_on);
  if (wants_images(io)) jobs.add(Job::draw);
  return jobs;
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
    case Job::draw_final:
      return f(std::integral_constant<Job, Job::draw_final>{});
    case Job::draw:
      return f(std::integral_constant<Job, Job::draw>{});
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
