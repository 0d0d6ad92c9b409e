// A block takes images one after the other, and reads the next one while it works on this one. A row of a product is a
// window of an image, and a warp takes 16 of them at a time; its numbers are made of bytes in registers, on their way
// from shared memory to the tensor cores.
//
// Within 16 columns of the products a lane holds four neighbours (one word of an image), not twice two as the tensor
// core's own order has it: column c of 16 is number own_column(c) of them. Outputs are in another order likewise, so
// that a lane holds eight neighbours, which it reads and writes at once: channel_of(tile, column).
#include "cuda/image_layer.hpp"

#include <cuda_bf16.h>

#include <algorithm>
#include <type_traits>

#include "cuda/async_copy.cuh"
#include "cuda/bfloat16_tiles.cuh"
#include "cuda/check.cuh"
#include "cuda/half_tiles.cuh"

namespace giga {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / 32;
constexpr int kBlocks = 3, kGradientBlocks = 2;  // on a multiprocessor: as many as registers allow
constexpr int kTiles = ImageLayer::kOutputs / 8;
constexpr float kByteScale = 1.0f / 255;
constexpr int kSteps = 3, kPart = 16 * kSteps;  // columns that the offsets of a lane repeat after: 48 bytes of a window

/// The shape of windows of kSize x kSize pixels.
template <int kSize>
struct Window {
  static constexpr int kColumns = kSize * kSize * kChannels, kParts = kColumns / kPart;
  static constexpr int kRowBytes = kSize * kChannels;
  static constexpr int kRowsOfPart = kPart / kRowBytes;
  static_assert(kRowsOfPart * kRowBytes == kPart && kWarps % kParts == 0);
};

/// Lane 4 i + j holds the numbers 2 j, 2 j + 1 of row i of 8 x 8; then those of column i.
__device__ __forceinline__ uint32_t transposed(uint32_t pair) {
  uint32_t out;
  asm("movmatrix.sync.aligned.m8n8.trans.b16 %0, %1;" : "=r"(out) : "r"(pair));
  return out;
}

/// Bytes 2 k and 2 k + 1 of a word as numbers of half precision: 0x6400 with a byte below is 1024 and that byte.
__device__ __forceinline__ uint32_t halves_of(uint32_t word, int k) {
  const uint32_t more = __byte_perm(word, 0x64646464u, k == 0 ? 0x4140 : 0x4342);
  const __half2 numbers = __hsub2(reinterpret_cast<const __half2&>(more), __half2half2(__ushort_as_half(0x6400)));
  return reinterpret_cast<const uint32_t&>(numbers);
}
/// The same as bfloat16, whose 0x4300 with seven bits below is 128 and these bits; the eighth says whether 128 stays.
__device__ __forceinline__ uint32_t bfloats_of(uint32_t word, int k) {
  const uint32_t bytes = __byte_perm(word, 0, k == 0 ? 0x4140 : 0x4342);
  const uint32_t more = (bytes & 0x007F007Fu) | 0x43004300u;
  const uint32_t less = 0x43004300u - (bytes & 0x00800080u) * 0x86u;  // 0x80 * 0x86 == 0x4300
  const __nv_bfloat162 numbers =
      __hsub2(reinterpret_cast<const __nv_bfloat162&>(more), reinterpret_cast<const __nv_bfloat162&>(less));
  return reinterpret_cast<const uint32_t&>(numbers);
}

/// The images of a block in shared memory: this one, the next one, and one that has been moved.
class Images {
 public:
  __device__ Images(const ImageLayer& layer, uint8_t* shared)
      : layer_(layer), bytes_(layer.side * layer.side * kChannels), shared_(shared) {}

  __device__ void ask_for(int64_t image) {
    if (image < layer_.n) {
      const uint8_t* from = layer_.images + image * bytes_;
      uint8_t* to = shared_ + next_ * bytes_;
      for (int k = static_cast<int>(threadIdx.x) * 16; k < bytes_; k += kThreads * 16) copy_16_bytes(to + k, from + k);
    }
    next_ ^= 1;
  }
  /// The image that was asked for; asks for the one after it. All threads of the block call it.
  __device__ const uint8_t* take(int64_t after) {
    wait_for_copies();
    __syncthreads();  // it is there, and nobody works on the one before
    const uint8_t* image = shared_ + (next_ ^ 1) * bytes_;
    ask_for(after);
    return layer_.centred ? centred(image) : image;
  }

 private:
  /// The image with its agent in the middle.
  __device__ const uint8_t* centred(const uint8_t* image) {
    __shared__ int found[kWarps];
    const auto* words = reinterpret_cast<const uint32_t*>(image);
    const int n_words = bytes_ / 4, row_words = layer_.side * kChannels / 4, side = layer_.side;
    int place = 0;
    for (int k = static_cast<int>(threadIdx.x); k < n_words / 3; k += kThreads) {  // four pixels
      const uint32_t a = words[3 * k], b = words[3 * k + 1], c = words[3 * k + 2];
      const uint32_t greens = __byte_perm(__byte_perm(a, b, 0x0741), c, 0x6210);
      if (((~greens - 0x01010101u) & greens & 0x80808080u) == 0) continue;  // none is 255, as the agent's is
      const auto look = [&](uint32_t pixel, int number) {
        if (is_own_pixel(pixel & 255u, pixel >> 8 & 255u, pixel >> 16 & 255u)) place = 4 * k + number + 1;
      };
      look(a, 0);
      look(__funnelshift_r(a, b, 24), 1);
      look(__funnelshift_r(b, c, 16), 2);
      look(c >> 8, 3);
    }
    place = __reduce_max_sync(0xFFFFFFFFu, place);
    if (threadIdx.x % 32 == 0) found[threadIdx.x / 32] = place;
    __syncthreads();
#pragma unroll
    for (int warp = 0; warp < kWarps; ++warp) place = max(place, found[warp]);
    if (place == 0) return image;

    const ImageShift shift(place, side);
    auto* moved = reinterpret_cast<uint32_t*>(shared_ + 2 * bytes_);
    const int bytes = kChannels * shift.y, first = bytes >> 2,
              bits = 8 * (bytes & 3);  // a row begins with a whole word
    const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
    for (int x = warp; x < side; x += kWarps) {
      const int from_x = x + shift.x;
      const bool there = from_x >= 0 && from_x < side;
      const auto at = [&](int w) { return there && w >= 0 && w < row_words ? words[from_x * row_words + w] : 0u; };
      for (int w = lane; w < row_words; w += 32)
        moved[x * row_words + w] = __funnelshift_r(at(w + first), at(w + first + 1), bits);
    }
    __syncthreads();
    return reinterpret_cast<const uint8_t*>(moved);
  }

  const ImageLayer& layer_;
  const int bytes_;
  uint8_t* const shared_;  // [3, bytes_]
  int next_ = 0;           // which of the first two is free
};

/// Where the words of windows lie in an image.
template <int kSize>
struct Words {
  int row_bytes, across, windows;
  uint32_t inverse;    // 2^16 / across, rounded up: exact up to 32 x 32 windows
  int offset[kSteps];  // of this lane's word in each 16 columns of a part

  __device__ explicit Words(const ImageLayer& layer)
      : row_bytes(layer.side * kChannels),
        across((layer.side - kSize) / kPatch + 1),
        windows(across * across),
        inverse(65536 / static_cast<uint32_t>(across) + 1) {
#pragma unroll
    for (int s = 0; s < kSteps; ++s) {
      const int byte = 16 * s + 4 * (static_cast<int>(threadIdx.x) % 4), row = byte / Window<kSize>::kRowBytes;
      offset[s] = row * row_bytes + byte - row * Window<kSize>::kRowBytes;
    }
  }
  /// The first byte of a window; of the last one where there are not so many.
  __device__ int begin(int window) const {
    window = min(window, windows - 1);
    const int i = static_cast<int>(static_cast<uint32_t>(window) * inverse >> 16);  // window / across
    return i * kPatch * row_bytes + (window - i * across) * kPatch * kChannels;
  }
  __device__ int part(int h) const { return h * Window<kSize>::kRowsOfPart * row_bytes; }
};

__device__ __forceinline__ uint32_t word_at(const uint8_t* image, int byte) {
  return *reinterpret_cast<const uint32_t*>(image + byte);
}

// ---- Output ---------------------------------------------------------------------------------------------------------

/// The weights as lanes want them: [step][half of the tiles][lane] of four words, two tiles' right factors.
template <int kSize>
__device__ void load_weights(const ImageLayer& layer, uint4* to) {
  using W = Window<kSize>;
  for (int k = static_cast<int>(threadIdx.x); k < W::kColumns / 16 * 2 * 32; k += kThreads) {
    const int lane = k % 32, half = k / 32 % 2, step = k / 64;
    uint32_t words[4];
#pragma unroll
    for (int j = 0; j < 4; ++j) {
      const float* row = layer.weight + channel_of(2 * half + j / 2, lane / 4) * W::kColumns;
      const int column = 16 * step + 4 * (lane % 4) + j % 2 * 2;
      const __half2 pair = __floats2half2_rn(row[column], row[column + 1]);
      words[j] = reinterpret_cast<const uint32_t&>(pair);
    }
    to[k] = {words[0], words[1], words[2], words[3]};
  }
}

template <int kSize>
__global__ void __launch_bounds__(kThreads, kBlocks)
    image_layer_kernel(const __grid_constant__ ImageLayer layer, BFloat16* output) {
  using W = Window<kSize>;
  extern __shared__ uint4 shared[];
  uint4* weights = shared;
  Images images(layer, reinterpret_cast<uint8_t*>(weights + W::kColumns / 16 * 2 * 32));
  images.ask_for(blockIdx.x);
  load_weights<kSize>(layer, weights);  // the first image's barrier comes before they are read

  const TileLane lane;
  const int own = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  const int first_output = 4 * lane.pair;  // of eight
  float bias[8];
#pragma unroll
  for (int j = 0; j < 8; ++j) bias[j] = layer.bias[first_output + j];
  const Words<kSize> words(layer);

  for (int64_t k = blockIdx.x; k < layer.n; k += gridDim.x) {
    const uint8_t* image = images.take(k + gridDim.x);
    for (int first = warp * 32; first < words.windows; first += kWarps * 32) {
      int begin[4];
#pragma unroll
      for (int r = 0; r < 4; ++r) begin[r] = words.begin(first + 8 * r + lane.group);
      float sums[2][kTiles][4] = {};
#pragma unroll 1
      for (int h = 0; h < W::kParts; ++h)
#pragma unroll
        for (int s = 0; s < kSteps; ++s) {
          const uint4 first_two = weights[((h * kSteps + s) * 2) * 32 + own];
          const uint4 last_two = weights[((h * kSteps + s) * 2 + 1) * 32 + own];
#pragma unroll
          for (int m = 0; m < 2; ++m) {
            const int at = words.offset[s] + words.part(h);
            const uint32_t upper = word_at(image, begin[2 * m] + at), lower = word_at(image, begin[2 * m + 1] + at);
            const uint32_t a[4] = {halves_of(upper, 0), halves_of(lower, 0), halves_of(upper, 1), halves_of(lower, 1)};
            multiply_add(sums[m][0], a, first_two.x, first_two.y);
            multiply_add(sums[m][1], a, first_two.z, first_two.w);
            multiply_add(sums[m][2], a, last_two.x, last_two.y);
            multiply_add(sums[m][3], a, last_two.z, last_two.w);
          }
        }
#pragma unroll
      for (int r = 0; r < 4; ++r) {
        const int window = first + 8 * r + lane.group;
        if (window >= words.windows) continue;
        uint32_t pairs[kTiles];
#pragma unroll
        for (int j = 0; j < kTiles; ++j) {
          const float* sum = sums[r / 2][j] + r % 2 * 2;
          pairs[j] = relu_pair(fmaf(sum[0], kByteScale, bias[2 * j]), fmaf(sum[1], kByteScale, bias[2 * j + 1]));
        }
        BFloat16* to = output + (k * words.windows + window) * ImageLayer::kOutputs + first_output;
        *reinterpret_cast<uint4*>(to) = {pairs[0], pairs[1], pairs[2], pairs[3]};
      }
    }
  }
}

// ---- Gradient -------------------------------------------------------------------------------------------------------

/// Eight numbers of an output and of its gradient.
struct Eight {
  uint4 output = {0, 0, 0, 0}, gradient = {0, 0, 0, 0};

  /// Pair j of the gradient by the sums: 0 where the output is 0.
  __device__ uint32_t pair(int j) const { return through_relu(word_of(output, j), word_of(gradient, j)); }
};

/// A warp has kPart columns of the gradient, and every so many of the tiles of 16 windows.
template <int kSize>
__global__ void __launch_bounds__(kThreads, kGradientBlocks)
    image_layer_gradient_kernel(const __grid_constant__ ImageLayer layer, const BFloat16* output,
                                const BFloat16* d_output, float* parts) {
  using W = Window<kSize>;
  constexpr int kGroups = kWarps / W::kParts;
  extern __shared__ uint4 shared[];
  Images images(layer, reinterpret_cast<uint8_t*>(shared));
  images.ask_for(blockIdx.x);

  const TileLane lane;
  const int warp = static_cast<int>(threadIdx.x) / 32, h = warp % W::kParts, group = warp / W::kParts;
  const int first_output = 4 * lane.pair;  // of eight
  const Words<kSize> words(layer);
  const int tiles = (words.windows + 15) / 16;
  float sums[kSteps][kTiles][4] = {}, bias[8] = {};

  for (int64_t k = blockIdx.x; k < layer.n; k += gridDim.x) {
    const auto eight = [&](int window) {
      Eight e;
      if (window >= words.windows) return e;
      const int64_t at = (k * words.windows + window) * ImageLayer::kOutputs + first_output;
      e.output = __ldg(reinterpret_cast<const uint4*>(output + at));
      e.gradient = __ldg(reinterpret_cast<const uint4*>(d_output + at));
      return e;
    };
    // What the next tile needs of memory is asked for before this one is worked on.
    Eight next[2] = {eight(16 * group + lane.group), eight(16 * group + 8 + lane.group)};
    const uint8_t* image = images.take(k + gridDim.x) + words.part(h);
    for (int tile = group; tile < tiles; tile += kGroups) {
      uint32_t b[2][kTiles];
#pragma unroll
      for (int r = 0; r < 2; ++r)
#pragma unroll
        for (int j = 0; j < kTiles; ++j) {
          const uint32_t pair = next[r].pair(j);
          b[r][j] = transposed(pair);
          if (h != 0) continue;
          bias[2 * j] += low(pair);
          bias[2 * j + 1] += high(pair);
        }
      const int window = 16 * (tile + kGroups) + lane.group;
      next[0] = eight(window);
      next[1] = eight(window + 8);
      const int upper = words.begin(16 * tile + lane.group), lower = words.begin(16 * tile + 8 + lane.group);
#pragma unroll
      for (int s = 0; s < kSteps; ++s) {
        const uint32_t above = word_at(image, upper + words.offset[s]), below = word_at(image, lower + words.offset[s]);
        const uint32_t a[4] = {transposed(bfloats_of(above, 0)), transposed(bfloats_of(above, 1)),
                               transposed(bfloats_of(below, 0)), transposed(bfloats_of(below, 1))};
#pragma unroll
        for (int j = 0; j < kTiles; ++j) multiply_add_bfloat16(sums[s][j], a, b[0][j], b[1][j]);
      }
    }
  }

  // The sums of the block: those of one group of warps after the other, in a fixed order.
  auto* total = reinterpret_cast<float*>(shared);  // [outputs, columns], then [outputs]
  constexpr int kTotal = ImageLayer::kOutputs * (W::kColumns + 1);
  wait_for_copies();
  __syncthreads();
  for (int j = static_cast<int>(threadIdx.x); j < kTotal; j += kThreads) total[j] = 0;
#pragma unroll
  for (int j = 0; j < 8; ++j)
#pragma unroll
    for (int rows = 4; rows < 32; rows *= 2) bias[j] += __shfl_xor_sync(0xFFFFFFFFu, bias[j], rows);
  for (int turn = 0; turn < kGroups; ++turn) {
    __syncthreads();
    if (group != turn) continue;
#pragma unroll
    for (int s = 0; s < kSteps; ++s)
#pragma unroll
      for (int j = 0; j < kTiles; ++j)
#pragma unroll
        for (int k = 0; k < 4; ++k) {
          // Row lane.group of 16 is column 2 i, 2 i + 1 of a lane's first two; the rows behind 8 are its last two.
          const int column = kPart * h + 16 * s + lane.group / 2 * 4 + k / 2 * 2 + lane.group % 2;
          total[channel_of(j, lane.pair + k % 2) * W::kColumns + column] += sums[s][j][k];
        }
    if (h == 0 && lane.group == 0)
#pragma unroll
      for (int j = 0; j < 8; ++j) total[ImageLayer::kOutputs * W::kColumns + first_output + j] += bias[j];
  }
  __syncthreads();
  for (int j = static_cast<int>(threadIdx.x); j < kTotal; j += kThreads)
    parts[static_cast<int64_t>(blockIdx.x) * kTotal + j] =
        j < ImageLayer::kOutputs * W::kColumns ? total[j] * kByteScale : total[j];
}

// ---- Launches -------------------------------------------------------------------------------------------------------

/// f(kernel for windows of this size, numbers of a window).
template <class F>
void with_size(const ImageLayer& layer, F&& f) {
  GIGA_CHECK(ImageLayer::serves(layer.side, layer.size, ImageLayer::kOutputs), "windows of ", layer.size, " pixels on ",
             layer.side);
  layer.size == kPatch ? f(std::integral_constant<int, kPatch>()) : f(std::integral_constant<int, 2 * kPatch>());
}

size_t image_bytes_of(const ImageLayer& layer) {
  return static_cast<size_t>(layer.side) * static_cast<size_t>(layer.side) * kChannels * (layer.centred ? 3 : 2);
}

template <class Kernel, class... Args>
void launch(Kernel* kernel, int blocks, size_t shared, void* stream, const Args&... args) {
  GIGA_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(shared)));
  kernel<<<static_cast<unsigned>(blocks), kThreads, shared, static_cast<cudaStream_t>(stream)>>>(args...);
  GIGA_CUDA(cudaGetLastError());
}

}  // namespace

void launch_image_layer(const ImageLayer& layer, BFloat16* output, int index, void* stream) {
  if (layer.n == 0) return;
  GIGA_CUDA(cudaSetDevice(index));
  const int blocks = static_cast<int>(std::min<int64_t>(layer.n, kBlocks * multiprocessors(index)));
  with_size(layer, [&](auto size) {
    const size_t weights = sizeof(uint4) * Window<size.value>::kColumns / 16 * 2 * 32;
    launch(image_layer_kernel<size.value>, blocks, weights + image_bytes_of(layer), stream, layer, output);
  });
}

int image_layer_parts(int index) { return kGradientBlocks * multiprocessors(index); }

void launch_image_layer_gradient(const ImageLayer& layer, const BFloat16* output, const BFloat16* d_output,
                                 float* parts, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  with_size(layer, [&](auto size) {
    const size_t shared = std::max(image_bytes_of(layer), sizeof(float) * static_cast<size_t>(layer.gradients()));
    launch(image_layer_gradient_kernel<size.value>, image_layer_parts(index), shared, stream, layer, output, d_output,
           parts);
  });
}

bool image_layer_runs(int index) {
  int major = 0, shared = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, index));
  GIGA_CUDA(cudaDeviceGetAttribute(&shared, cudaDevAttrMaxSharedMemoryPerBlockOptin, index));
  return major >= 8 && shared >= 160 << 10;
}

}  // namespace giga
