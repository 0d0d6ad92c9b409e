// The CUDA back end of a build without CUDA: no device.
#if !GIGASTEP_HAS_CUDA

#include "core/error.hpp"
#include "cuda/device_clock.hpp"
#include "cuda/population_policy.hpp"
#include "cuda/runtime.hpp"

namespace giga {
namespace {
[[noreturn]] void missing() { throw InputError("this build has no CUDA; use --device cpu"); }
}  // namespace

int cuda_device_count() { return 0; }
GpuInfo cuda_device_info(int) { missing(); }
Memory& cuda_memory(int) { missing(); }
// NOLINTNEXTLINE(performance-unnecessary-value-param): the signature of the real one
std::unique_ptr<Simulator> make_cuda_simulator(SimSpec, const SimOptions&, int, void*) { missing(); }
std::unique_ptr<DeviceClock> make_cuda_clock(int, void*) { missing(); }
bool population_policy_runs(int) { missing(); }
void pack_population(const PackedMlp&, const float*, int64_t, int64_t, uint16_t*, int, void*) { missing(); }
int population_work(const PopulationPolicy&) { missing(); }
void list_population_work(const PopulationPolicy&, int32_t*, int, void*) { missing(); }
void launch_population_policy(const PopulationPolicy&, int, void*) { missing(); }

}  // namespace giga

#endif
