// The CUDA back end of a build without CUDA: no device.
#include "core/error.hpp"
#include "core/parallel_for.hpp"
#include "cuda/device_clock.hpp"
#include "cuda/elementwise.hpp"
#include "cuda/fused_policy.hpp"
#include "cuda/halving_layer.hpp"
#include "cuda/image_layer.hpp"
#include "cuda/population_policy.hpp"
#include "cuda/ppo_gradients.hpp"
#include "cuda/relu_gradient.hpp"
#include "cuda/runtime.hpp"
#include "cuda/sensors.hpp"
#include "cuda/side_stream.hpp"

namespace giga {
namespace {
[[noreturn]] void missing() { throw InputError("this build has no CUDA; use --device cpu"); }
}  // namespace

bool built_with_cuda() { return false; }
int cuda_device_count() { return 0; }
GpuInfo cuda_device_info(int) { missing(); }
double cuda_copy_rate(int) { missing(); }
Memory& cuda_memory(int) { missing(); }
void* work_stream(int) { missing(); }
// NOLINTNEXTLINE(performance-unnecessary-value-param): the signature of the real one
std::unique_ptr<Simulator> make_cuda_simulator(SimSpec, const SimOptions&, int, void*) { missing(); }
// NOLINTNEXTLINE(performance-unnecessary-value-param): likewise
std::unique_ptr<Simulator> make_cuda_grid_simulator(SimSpec, const SimOptions&, int, void*, int) { missing(); }
std::unique_ptr<DeviceClock> make_cuda_clock(int, void*) { missing(); }
bool population_policy_runs(int) { missing(); }
void pack_population(const PackedMlp&, const float*, int64_t, int64_t, uint16_t*, int, void*) { missing(); }
int64_t population_work(const PopulationPolicy&) { missing(); }
void list_population_work(const PopulationPolicy&, int, void*) { missing(); }
void launch_population_policy(const PopulationPolicy&, int, void*) { missing(); }
bool fused_gradients_run(int) { missing(); }
int fused_blocks(int) { missing(); }
int fused_step_blocks(int64_t, int64_t) { missing(); }
void launch_moments(const FusedRows&, MinibatchPieces, const float*, double*, int, void*) { missing(); }
void launch_actor_gradient(const FusedActor&, int, void*) { missing(); }
void launch_critic_gradient(const FusedCritic&, int, void*) { missing(); }
void launch_block_sums(const FusedStep&, float*, int, void*) { missing(); }
void launch_gradient_sums(const FusedStep&, int, void*) { missing(); }
void launch_adam(const FusedStep&, int, void*) { missing(); }
void launch_fused_policies(std::span<const FusedPolicy>, bool, int, void*) { missing(); }
void launch_image_layer(const ImageLayer&, BFloat16*, int, void*) { missing(); }
int image_layer_parts(int) { missing(); }
void launch_image_layer_gradient(const ImageLayer&, const BFloat16*, const BFloat16*, float*, int, void*) { missing(); }
bool image_layer_runs(int) { missing(); }
int relu_gradient_parts(int) { missing(); }
int halving_layer_parts(int) { missing(); }
void launch_halving_layer_gradient(const HalvingLayer&, int, void*) { missing(); }
void launch_relu_gradient(const ReluGradient&, int, void*) { missing(); }
StreamMark::StreamMark(int index) : index_(index) { missing(); }
StreamMark::~StreamMark() = default;
void StreamMark::set(void*) { missing(); }
void StreamMark::wait(void*) const { missing(); }
SideStream::SideStream(int index, void* main) : main_(main), mark_(index) { missing(); }
SideStream::~SideStream() = default;
void SideStream::fork() { missing(); }
void SideStream::join() { missing(); }
GpuSensors::GpuSensors(int index) : index_(index), thermometer_("") { missing(); }
GpuReading GpuSensors::read() const { missing(); }

template <class Op>
void launch_elementwise(const Op&, int64_t, int, void*) {
  missing();
}
#define GIGA_INSTANTIATE(Op) template void launch_elementwise(const Op&, int64_t, int, void*);
GIGA_ELEMENTWISE(GIGA_INSTANTIATE)
#undef GIGA_INSTANTIATE

}  // namespace giga
