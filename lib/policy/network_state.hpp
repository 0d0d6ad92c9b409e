// NetworkState and Sequence: what networks with memory remember from one step to the next.
#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>

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

/// L steps in a row of R rows. Inputs and outputs of a network are [L R, ...], step by step.
struct Sequence {
  int64_t length = 1;            // L
  at::Tensor begins = {};        // [L, R] bool: which rows begin an episode at which step; undefined: none does
  at::Tensor start = {};         // [R, S] what is remembered before the first step; undefined: nothing
  at::Tensor* states = nullptr;  // if wanted: becomes [L, R, S], what is remembered after each step; no gradient
};

}  // namespace giga
