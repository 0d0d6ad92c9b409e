#include "sweep/sobol.hpp"

#include <torch/types.h>

namespace giga {

std::vector<double> sobol_points(int d, int n) {
  constexpr int64_t kBits = 30;  // of LibTorch's engine
  const auto whole = at::TensorOptions().dtype(at::kLong);
  at::Tensor state = at::zeros({d, kBits}, whole), quasi = at::zeros({d}, whole);
  at::_sobol_engine_initialize_state_(state, d);
  std::vector<double> points(static_cast<size_t>(d), 0.0);  // the first is the origin
  if (n > 1) {
    const at::Tensor drawn = std::get<0>(at::_sobol_engine_draw(quasi, n - 1, state, d, 0, at::kDouble)).contiguous();
    points.insert(points.end(), drawn.const_data_ptr<double>(), drawn.const_data_ptr<double>() + drawn.numel());
  }
  return points;
}

}  // namespace giga
