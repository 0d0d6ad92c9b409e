// Recurrent cells: one step of each and its gradient, as elementwise operations. What the products with the weights
// give comes in; LibTorch computes those.
//   GRU   Cho et al. 2014, arXiv 1406.1078, with the reset gate behind the product (as cuDNN and PyTorch have it)
//   LSTM  Hochreiter and Schmidhuber 1997, with the forget gate of Gers et al. 2000
#pragma once

#include <cmath>
#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

GIGA_HD float sigmoid(float x) { return 1.0f / (1.0f + std::exp(-x)); }
/// tanh within 2^-23, in a third of the time.
GIGA_HD float cell_tanh(float x) { return 2.0f * sigmoid(2.0f * x) - 1.0f; }

/// Whether row r begins an episode at the step after: what it remembers is zero there. begins [R]; null: none does.
GIGA_HD bool forgets(const bool* begins, int64_t r) { return begins && begins[r]; }

/// Number j of row r, of `size` numbers each. An operation takes it by its index r * size + j, or as such, which saves
/// a division where rows are gone through in order.
struct CellElement {
  int64_t r, j, size;
  GIGA_HD CellElement(int64_t row, int64_t number, int64_t numbers) : r(row), j(number), size(numbers) {}
  GIGA_HD CellElement(int64_t element, int64_t numbers)
      : r(element / numbers), j(element - r * numbers), size(numbers) {}
  GIGA_HD int64_t index() const { return r * size + j; }
  /// The same number of gate k among `gates` of a row.
  GIGA_HD int64_t gate(int64_t gates, int64_t k) const { return (r * gates + k) * size + j; }
};

/// reset, update = sigmoid(input + hidden); candidate = tanh(input + reset * hidden);
/// h' = (1 - update) * candidate + update * h.
struct GruStep {
  int64_t size;         // H
  const float* input;   // [R, 3 H] of reset, update, candidate: W x + b
  const float* hidden;  // [R, 3 H] likewise: U h + c
  const float* before;  // [R, H] h
  const bool* begins;   // [R] at the next step
  float* gates;         // [R, 4 H] reset, update, candidate, and the candidate's part of `hidden`: for the gradient
  float* features;      // [R, H] h'
  float* after;         // [R, H] h', or 0 where the next step begins an episode

  GIGA_HD void operator()(int64_t element) const { (*this)(CellElement(element, size)); }
  GIGA_HD void operator()(const CellElement& at) const {
    const int64_t element = at.index();
    const auto in = [&](int64_t k) { return at.gate(3, k); };
    const auto out = [&](int64_t k) { return at.gate(4, k); };
    const float reset = sigmoid(input[in(0)] + hidden[in(0)]), update = sigmoid(input[in(1)] + hidden[in(1)]);
    const float candidate = cell_tanh(input[in(2)] + reset * hidden[in(2)]);
    const float h = (1.0f - update) * candidate + update * before[element];
    gates[out(0)] = reset;
    gates[out(1)] = update;
    gates[out(2)] = candidate;
    gates[out(3)] = hidden[in(2)];
    features[element] = h;
    after[element] = forgets(begins, at.r) ? 0.0f : h;
  }
};

/// From the gradient at h' to those at both products, and what of it goes back to h beside the product.
struct GruStepGradient {
  int64_t size;
  const float* gates;       // [R, 4 H]
  const float* before;      // [R, H]
  const bool* begins;       // [R] at the next step
  const float* d_features;  // [R, H]
  float* carried;           // [R, H] in: the gradient at the next step's h; out: at this one's, without the product
  float* d_input;           // [R, 3 H]
  float* d_hidden;          // [R, 3 H]

  GIGA_HD void operator()(int64_t element) const { (*this)(CellElement(element, size)); }
  GIGA_HD void operator()(const CellElement& at) const {
    const int64_t element = at.index();
    const auto gate = [&](int64_t k) { return gates[at.gate(4, k)]; };
    const float reset = gate(0), update = gate(1), candidate = gate(2);
    const float d_h = d_features[element] + (forgets(begins, at.r) ? 0.0f : carried[element]);
    const float d_candidate = d_h * (1.0f - update) * (1.0f - candidate * candidate);
    const float d_update = d_h * (before[element] - candidate) * update * (1.0f - update);
    const float d_reset = d_candidate * gate(3) * reset * (1.0f - reset);
    const auto put = [&](float* to, int64_t k, float value) { to[at.gate(3, k)] = value; };
    put(d_input, 0, d_reset);
    put(d_input, 1, d_update);
    put(d_input, 2, d_candidate);
    put(d_hidden, 0, d_reset);
    put(d_hidden, 1, d_update);
    put(d_hidden, 2, d_candidate * reset);
    carried[element] = d_h * update;
  }
};

/// in, forget, out = sigmoid(input + hidden); candidate = tanh(input + hidden); c' = forget * c + in * candidate;
/// h' = out * tanh(c').
struct LstmStep {
  int64_t size;         // H
  const float* input;   // [R, 4 H] of in, forget, candidate, out: W x + b
  const float* hidden;  // [R, 4 H] likewise: U h + c
  const float* before;  // [R, H] c
  const bool* begins;   // [R] at the next step
  float* gates;         // [R, 4 H] in, forget, candidate, out: for the gradient
  float* cell;          // [R, H] c'
  float* features;      // [R, H] h'
  float* after;         // [R, H] h', or 0 where the next step begins an episode
  float* after_cell;    // [R, H] c', likewise

  GIGA_HD void operator()(int64_t element) const { (*this)(CellElement(element, size)); }
  GIGA_HD void operator()(const CellElement& at) const {
    const int64_t element = at.index();
    float sums[4];
    for (int64_t k = 0; k < 4; ++k) sums[k] = input[at.gate(4, k)] + hidden[at.gate(4, k)];
    const float in = sigmoid(sums[0]), forget = sigmoid(sums[1]), out = sigmoid(sums[3]);
    const float candidate = cell_tanh(sums[2]);
    const float c = forget * before[element] + in * candidate, h = out * cell_tanh(c);
    const float values[4] = {in, forget, candidate, out};
    for (int64_t k = 0; k < 4; ++k) gates[at.gate(4, k)] = values[k];
    cell[element] = c;
    features[element] = h;
    after[element] = forgets(begins, at.r) ? 0.0f : h;
    after_cell[element] = forgets(begins, at.r) ? 0.0f : c;
  }
};

/// From the gradients at h' and c' to that at both products, whose sum the gates take, and to that at c.
struct LstmStepGradient {
  int64_t size;
  const float* gates;       // [R, 4 H]
  const float* before;      // [R, H] c
  const float* cell;        // [R, H] c'
  const bool* begins;       // [R] at the next step
  const float* d_features;  // [R, H]
  const float* carried;     // [R, H] the gradient at the next step's h
  float* carried_cell;      // [R, H] in: at the next step's c; out: at this one's
  float* d_sums;            // [R, 4 H]

  GIGA_HD void operator()(int64_t element) const { (*this)(CellElement(element, size)); }
  GIGA_HD void operator()(const CellElement& at) const {
    const int64_t element = at.index();
    const auto gate = [&](int64_t k) { return gates[at.gate(4, k)]; };
    const float in = gate(0), forget = gate(1), candidate = gate(2), out = gate(3), squashed = cell_tanh(cell[element]);
    const bool cut = forgets(begins, at.r);
    const float d_h = d_features[element] + (cut ? 0.0f : carried[element]);
    const float d_c = (cut ? 0.0f : carried_cell[element]) + d_h * out * (1.0f - squashed * squashed);
    const float d[4] = {d_c * candidate * in * (1.0f - in), d_c * before[element] * forget * (1.0f - forget),
                        d_c * in * (1.0f - candidate * candidate), d_h * squashed * out * (1.0f - out)};
    for (int64_t k = 0; k < 4; ++k) d_sums[at.gate(4, k)] = d[k];
    carried_cell[element] = d_c * forget;
  }
};

}  // namespace giga
