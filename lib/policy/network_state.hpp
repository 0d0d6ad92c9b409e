// NetworkState: what a recurrent network remembers from one step to the next.
#pragma once

#include <ATen/core/Tensor.h>

namespace giga {

/// S numbers for each row of inputs. Undefined means that every row begins an episode; a network without memory leaves
/// it undefined.
struct NetworkState {
  at::Tensor rows;  // [R, S] fp32; of a population [M, R, S]

  /// Forgets the rows that begin an episode: begins [R] bool.
  void reset(const at::Tensor& begins) {
    if (rows.defined()) rows = rows.masked_fill(begins.unsqueeze(-1), 0);
  }
};

}  // namespace giga
