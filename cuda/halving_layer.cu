// A block takes images one after the other, and reads the next one while it works on this one: the input into shared
// memory, the output and its gradient into registers, from where the gradient of the sums goes to shared memory. Both
// products read rows of pixels there by ldmatrix, which takes them from anywhere; in the place of a pixel outside lies
// a row of zeros.
#include "cuda/halving_layer.hpp"

#include "cuda/async_copy.cuh"
#include "cuda/bfloat16_tiles.cuh"
#include "cuda/check.cuh"
#include "cuda/half_tiles.cuh"

namespace giga {
namespace {

using Layer = HalvingLayer;
constexpr int kWarps = Layer::kTaps, kThreads = kWarps * 32;         // a warp has a tap of the weight
constexpr int kBlocks = 2;                                           // on a multiprocessor
constexpr int kChunk = 16, kChunks = Layer::kChannels * 2 / kChunk;  // bytes; of a pixel
constexpr int kPixel = 80;  // bytes from a pixel to the next one: 64, and 16 that keep neighbours on different banks
constexpr int kTiles = Layer::kChannels / 8;
constexpr int kMaxAcross = (Layer::kMaxSide + 1) / 2;
constexpr int kOwn = (kMaxAcross * kMaxAcross * kChunks + kThreads - 1) / kThreads;  // chunks of an output, of a thread

/// Bytes of shared memory: zeros, weights [tap][output], two inputs, the gradient of the sums.
struct Room {
  int weights, input, d_sums, all;
  __host__ __device__ explicit Room(int side)
      : weights(kPixel),
        input(weights + Layer::kTaps * Layer::kChannels * kPixel),
        d_sums(input + 2 * side * side * kPixel),
        all(d_sums + max_of((side + 1) / 2 * ((side + 1) / 2) * kPixel, kThreads * 8 * 4)) {}
  __host__ __device__ static int max_of(int a, int b) { return a > b ? a : b; }
};

__device__ __forceinline__ uint32_t address_of(const void* shared) {
  return static_cast<uint32_t>(__cvta_generic_to_shared(shared));
}

/// a / b for 0 <= a < 2^10 and 0 < b <= 2^5.
struct Divisor {
  uint32_t inverse;
  __device__ explicit Divisor(int b) : inverse(65536 / static_cast<uint32_t>(b) + 1) {}
  __device__ int operator()(int a) const { return static_cast<int>(static_cast<uint32_t>(a) * inverse >> 16); }
};

class Block {
 public:
  __device__ Block(const Layer& layer, char* shared)
      : layer_(layer),
        side_(layer.side),
        across_(layer.across()),
        pixels_(side_ * side_),
        outputs_(across_ * across_),
        by_across_(across_),
        shared_(shared),
        room_(side_),
        zeros_(address_of(shared)) {}

  /// Zeros, and the weights with their inputs in the order of channel_of.
  __device__ void fill() {
    for (int k = thread(); k < kPixel / 4; k += kThreads) reinterpret_cast<uint32_t*>(shared_)[k] = 0;
    for (int k = thread(); k < Layer::kTaps * Layer::kChannels * Layer::kChannels; k += kThreads) {
      const int at = k % Layer::kChannels, row = k / Layer::kChannels;  // row: tap, output
      const int tap = row / Layer::kChannels, output = row % Layer::kChannels;
      reinterpret_cast<BFloat16*>(shared_ + room_.weights + row * kPixel)[at] =
          layer_.weight[(output * Layer::kTaps + tap) * Layer::kChannels + channel_of(at / 8, at % 8)];
    }
  }

  __device__ void ask_for(int64_t image) {
    if (image < layer_.n) {
      const char* from = reinterpret_cast<const char*>(layer_.input) + image * pixels_ * kChunks * kChunk;
      char* to = shared_ + room_.input + next_ * pixels_ * kPixel;
      for (int k = thread(); k < pixels_ * kChunks; k += kThreads)
        copy_16_bytes(to + k / kChunks * kPixel + k % kChunks * kChunk, from + k * kChunk);
#pragma unroll
      for (int j = 0; j < kOwn; ++j) {
        const int k = thread() + j * kThreads;
        if (k >= outputs_ * kChunks) continue;
        const int64_t at = image * outputs_ * kChunks + k;
        output_[j] = __ldg(reinterpret_cast<const uint4*>(layer_.output) + at);
        d_output_[j] = __ldg(reinterpret_cast<const uint4*>(layer_.d_output) + at);
      }
    }
    next_ ^= 1;
  }

  /// The image that was asked for; asks for the one after it.
  __device__ void take(int64_t after, float (&bias)[8]) {
    wait_for_copies();
    __syncthreads();  // its input is there, and nobody works on the one before
    pixels_at_ = address_of(shared_ + room_.input + (next_ ^ 1) * pixels_ * kPixel);
#pragma unroll
    for (int j = 0; j < kOwn; ++j) {
      const int k = thread() + j * kThreads;
      if (k >= outputs_ * kChunks) continue;
      uint32_t pairs[4];
#pragma unroll
      for (int i = 0; i < 4; ++i) {
        pairs[i] = through_relu(word_of(output_[j], i), word_of(d_output_[j], i));
        bias[2 * i] += low(pairs[i]);
        bias[2 * i + 1] += high(pairs[i]);
      }
      *reinterpret_cast<uint4*>(shared_ + room_.d_sums + k / kChunks * kPixel + k % kChunks * kChunk) = {
          pairs[0], pairs[1], pairs[2], pairs[3]};
    }
    ask_for(after);
    __syncthreads();
  }

  /// The gradient of tap `tap` of the weight [32 inputs][32 outputs]: += input^T d_sums.
  __device__ void add_weights(int tap, float (&sums)[2][kTiles][4]) const {
    const int x = tap / Layer::kSize - 1, y = tap % Layer::kSize - 1;
    const int input_row = lane() % 8 + lane() / 16 * 8, input_chunk = lane() / 8 % 2 * kChunk;
    const int sum_row = lane() % 16, sum_chunk = lane() / 16 * kChunk;
    for (int first = 0; first < outputs_; first += 16) {
      const uint32_t from = input_at(first + input_row, x, y) + static_cast<uint32_t>(input_chunk);
      const uint32_t by = sum_at(first + sum_row) + static_cast<uint32_t>(sum_chunk);
      uint32_t a[2][4], b[2][4];
      load_transposed(a[0], from);
      load_transposed(a[1], from + 2 * kChunk);
      load_transposed(b[0], by);
      load_transposed(b[1], by + 2 * kChunk);
#pragma unroll
      for (int m = 0; m < 2; ++m)
#pragma unroll
        for (int j = 0; j < kTiles; ++j)
          multiply_add_bfloat16(sums[m][j], a[m], b[j / 2][j % 2 * 2], b[j / 2][j % 2 * 2 + 1]);
    }
  }

  /// The gradient of the input. Its pixels are of four kinds, by which of their coordinates are odd: an even one has
  /// one tap with which outputs read it, an odd one two.
  __device__ void write_input(int64_t image) const {
    int tile = warp();  // those of all kinds in a row, the dearest first
    for (int kind = 3; kind >= 0; --kind) {
      const int odd_x = kind / 2, odd_y = kind % 2;
      const int high = (side_ + 1 - odd_x) / 2, wide = (side_ + 1 - odd_y) / 2, count = high * wide;
      const int tiles = (count + 15) / 16;
      const Divisor by_wide(wide);
      for (; tile < tiles; tile += kWarps) {
        const int own = 16 * tile + lane() % 16, own_x = by_wide(own), own_y = own - own_x * wide;
        float sums[kTiles][4] = {};
        for (int u = 0; u <= odd_x; ++u)
          for (int v = 0; v <= odd_y; ++v) {
            // Output (i, j) reads pixel (2 i + tap - 1, ...): an odd one at 2 a + 1 as i = a + 1 by tap 0, as a by
            // tap 2.
            const int i = own_x + (odd_x && u == 0 ? 1 : 0), j = own_y + (odd_y && v == 0 ? 1 : 0);
            const int tap = (odd_x ? 2 * u : 1) * Layer::kSize + (odd_y ? 2 * v : 1);
            const bool there = own < count && i < across_ && j < across_;
            const uint32_t from =
                (there ? sum_at(i * across_ + j) : zeros_) + static_cast<uint32_t>(lane() / 16 * kChunk);
            const uint32_t by = address_of(shared_ + room_.weights + (tap * Layer::kChannels + lane() % 16) * kPixel +
                                           lane() / 16 * kChunk);
#pragma unroll
            for (int k = 0; k < 2; ++k) {
              uint32_t a[4], b[2][4];
              load(a, from + static_cast<uint32_t>(2 * k * kChunk));
              load_transposed(b[0], by + static_cast<uint32_t>(16 * k * kPixel));
              load_transposed(b[1], by + static_cast<uint32_t>(16 * k * kPixel + 2 * kChunk));
#pragma unroll
              for (int t = 0; t < kTiles; ++t)
                multiply_add_bfloat16(sums[t], a, b[t / 2][t % 2 * 2], b[t / 2][t % 2 * 2 + 1]);
            }
          }
#pragma unroll
        for (int r = 0; r < 2; ++r) {
          const int q = 16 * tile + 8 * r + lane() / 4, x = by_wide(q), y = q - x * wide;
          if (q >= count) continue;
          const int64_t pixel = image * pixels_ + (2 * x + odd_x) * side_ + 2 * y + odd_y;
          *reinterpret_cast<uint4*>(layer_.d_input + pixel * Layer::kChannels + lane() % 4 * 8) = {
              bfloat16_pair(sums[0][2 * r], sums[0][2 * r + 1]), bfloat16_pair(sums[1][2 * r], sums[1][2 * r + 1]),
              bfloat16_pair(sums[2][2 * r], sums[2][2 * r + 1]), bfloat16_pair(sums[3][2 * r], sums[3][2 * r + 1])};
        }
      }
      tile -= tiles;
    }
  }

 private:
  __device__ static int thread() { return static_cast<int>(threadIdx.x); }
  __device__ static int lane() { return thread() % 32; }
  __device__ static int warp() { return thread() / 32; }
  __device__ uint32_t sum_at(int output) const {
    return output < outputs_ ? address_of(shared_ + room_.d_sums) + static_cast<uint32_t>(output * kPixel) : zeros_;
  }
  /// The pixel that an output reads at (x, y) from its middle.
  __device__ uint32_t input_at(int output, int x, int y) const {
    const int i = by_across_(output), row = 2 * i + x, column = 2 * (output - i * across_) + y;
    const bool there = output < outputs_ && row >= 0 && row < side_ && column >= 0 && column < side_;
    return there ? pixels_at_ + static_cast<uint32_t>((row * side_ + column) * kPixel) : zeros_;
  }

  const Layer& layer_;
  const int side_, across_, pixels_, outputs_;
  const Divisor by_across_;
  char* const shared_;
  const Room room_;
  const uint32_t zeros_;
  uint32_t pixels_at_ = 0;
  int next_ = 0;  // which of the two inputs is free
  uint4 output_[kOwn], d_output_[kOwn];
};

__global__ void __launch_bounds__(kThreads, kBlocks) halving_layer_kernel(const __grid_constant__ HalvingLayer layer) {
  extern __shared__ uint4 shared[];
  const int thread = static_cast<int>(threadIdx.x), tap = thread / 32;
  Block block(layer, reinterpret_cast<char*>(shared));
  block.ask_for(blockIdx.x);
  block.fill();
  float sums[2][kTiles][4] = {}, bias[8] = {};
  for (int64_t image = blockIdx.x; image < layer.n; image += gridDim.x) {
    block.take(image + gridDim.x, bias);
    block.add_weights(tap, sums);
    block.write_input(image);
  }

  float* parts = layer.parts + int64_t{blockIdx.x} * Layer::kGradients;
  const TileLane lane;
#pragma unroll
  for (int m = 0; m < 2; ++m)
#pragma unroll
    for (int j = 0; j < kTiles; ++j)
#pragma unroll
      for (int k = 0; k < 4; ++k) {
        const int input = 16 * m + lane.group + k / 2 * 8, output = 8 * j + lane.pair + k % 2;
        parts[(output * Layer::kTaps + tap) * Layer::kChannels + input] = sums[m][j][k];
      }
  // Of the bias a thread has eight outputs, as every fourth thread has.
  float* of_threads = reinterpret_cast<float*>(reinterpret_cast<char*>(shared) + Room(layer.side).d_sums);
  wait_for_copies();
  __syncthreads();
#pragma unroll
  for (int j = 0; j < 8; ++j) of_threads[thread * 8 + j] = bias[j];
  __syncthreads();
  if (thread < Layer::kChannels) {
    float sum = 0;
    for (int k = thread / 8; k < kThreads; k += kChunks) sum += of_threads[k * 8 + thread % 8];
    parts[Layer::kGradients - Layer::kChannels + thread] = sum;
  }
}

}  // namespace

int halving_layer_parts(int index) { return kBlocks * multiprocessors(index); }

void launch_halving_layer_gradient(const HalvingLayer& layer, int index, void* stream) {
  GIGA_CHECK(layer.side <= Layer::kMaxSide, layer.side, " pixels");
  GIGA_CUDA(cudaSetDevice(index));
  const int shared = Room(layer.side).all;
  GIGA_CUDA(cudaFuncSetAttribute(halving_layer_kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, shared));
  halving_layer_kernel<<<static_cast<unsigned>(halving_layer_parts(index)), kThreads, static_cast<size_t>(shared),
                         static_cast<cudaStream_t>(stream)>>>(layer);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace giga
