#include "learn/memory/network.hpp"

namespace giga {

MlpMemory::MlpMemory(MemoryLedger& ledger, MemoryUse kept, const MlpConfig& config, const Shape& shape)
    : ledger_(ledger), kept_(kept), config_(config), shape_(shape) {
  const auto add = [&](int64_t from, int64_t to, bool hidden) {
    layers_.push_back({from, to, hidden, shape.states > 0 && !layers_.empty()});
  };
  int64_t from = shape.input;
  for (const int size : config.hidden) {
    add(from, size, true);
    from = size;
  }
  if (shape.output > 0) add(from, shape.output, false);
}

/// Rounded copies of what a layer takes in, of weights and bias.
int64_t MlpMemory::rounded_bytes(const Layer& layer) const {
  return shape_.rounds ? 4 * (shape_.rows * layer.in + layer.in * layer.out + layer.out) : 0;
}

// y = x W^T + b; with a team's mean, a second y is the sum. Numbers pass through half precision on the way to their
// rounded copies.
void MlpMemory::linear(const Layer& layer) {
  if (const int64_t copies = rounded_bytes(layer); copies > 0) {
    ledger_.touch(copies + copies / 2);
    ledger_.touch(copies + rows_of(layer.out));
  }
  ledger_.take(kept_, weight_copy_bytes(layer) + rows_of(layer.out));
  if (!layer.team) return;
  ledger_.take(kept_, states_of(layer.in));
  ledger_.take(MemoryUse::temporary, states_of(layer.out));
  ledger_.touch(rows_of(layer.out));
  ledger_.give(MemoryUse::temporary, states_of(layer.out));
}

void MlpMemory::infer() {
  int64_t input = 0;  // of the layer at hand, where it is not the caller's
  for (const Layer& layer : layers_) {
    const int64_t y = rows_of(layer.out);
    linear(layer);
    ledger_.give(kept_, weight_copy_bytes(layer) + (layer.team ? states_of(layer.in) : 0));
    if (layer.hidden) {
      int64_t before = y;  // what the activation does not make superfluous before it is done
      if (config_.layer_norm) {
        ledger_.take(kept_, y + statistics_bytes());
        const bool holds_y = shape_.states > 0;  // TeamMlp has a name for it
        ledger_.give(kept_, statistics_bytes() + (holds_y ? 0 : y));
        before = holds_y ? 2 * y : y;
      }
      ledger_.take(kept_, y);
      ledger_.give(kept_, before);
    }
    ledger_.give(kept_, input);
    input = y;
  }
}

// Parameters are views of the members; in bf16, copies.
void MlpMemory::infer_members(int64_t members) {
  int64_t input = 0;
  for (const Layer& layer : layers_) {
    const int64_t y = rows_of(layer.out);
    const int64_t vector_copy = shape_.element_bytes == 2 ? 2 * members * layer.out : 0;
    const int64_t copies = members * weight_copy_bytes(layer) + vector_copy;
    ledger_.take(kept_, copies + y);
    ledger_.give(kept_, copies + input);
    input = y;
    if (!layer.hidden) continue;
    if (config_.layer_norm) {
      ledger_.take(kept_, y);  // without scale and shift, which are a product and a sum
      ledger_.touch(statistics_bytes());
      ledger_.take(kept_, 2 * (vector_copy + y));
      ledger_.give(kept_, 2 * (vector_copy + y) + y);
    }
    ledger_.take(kept_, y);
    ledger_.give(kept_, y);
  }
}

// Kept for the way back: each layer's input, which is the activation before it; what went into silu and gelu, while
// tanh and relu need no more than their result; input and statistics of layer norms; the means of the team.
void MlpMemory::forward() {
  for (const Layer& layer : layers_) {
    const int64_t y = rows_of(layer.out);
    linear(layer);
    if (!layer.hidden) continue;
    if (config_.layer_norm) ledger_.take(kept_, y + statistics_bytes());
    ledger_.take(kept_, y);
    if (!keeps_input_of_activation()) ledger_.give(kept_, y);
  }
}

int64_t MlpMemory::backward(bool input_gradient) {
  int64_t gradient = 0;  // of the layer at hand; the output's is the caller's
  for (size_t k = layers_.size(); k-- > 0;) {
    const Layer& layer = layers_[k];
    const int64_t y = rows_of(layer.out);
    if (layer.hidden) {
      ledger_.take(MemoryUse::temporary, y);
      ledger_.give(MemoryUse::temporary, gradient);
      gradient = y;
      ledger_.give(kept_, y);  // the activation, or what went into it
      if (config_.layer_norm) {
        ledger_.touch(y);
        ledger_.give(kept_, y + statistics_bytes());
      }
    }
    if (layer.team) team_mean_backward(layer);
    const int64_t next = k > 0 || input_gradient ? rows_of(layer.in) : 0;
    ledger_.take(MemoryUse::temporary, next);
    ledger_.touch(weight_gradient_bytes(layer));
    ledger_.give(MemoryUse::temporary, gradient);
    gradient = next;
    ledger_.give(kept_, weight_copy_bytes(layer));
    if (layer.team) ledger_.give(MemoryUse::temporary, next);  // both ways' gradients are added in place
    if (k > 0 && keeps_input_of_activation()) ledger_.give(kept_, rows_of(layer.in));
  }
  return gradient;
}

void MlpMemory::team_mean_backward(const Layer& layer) {
  ledger_.take(MemoryUse::temporary, states_of(layer.out) + states_of(layer.in));
  ledger_.touch(weight_gradient_bytes(layer));
  ledger_.give(MemoryUse::temporary, states_of(layer.out));
  ledger_.give(kept_, states_of(layer.in));
  ledger_.take(MemoryUse::temporary, rows_of(layer.in));
  ledger_.give(MemoryUse::temporary, states_of(layer.in));
}

CriticMemory::CriticMemory(MemoryLedger& ledger, MemoryUse kept, const CriticConfig& config, const CriticShape& shape,
                           const Size& size)
    : ledger_(ledger), kept_(kept), config_(config), shape_(shape), size_(size) {
  const int64_t rows = size.states * own();
  if (config.kind != CriticKind::state) {
    const int64_t states = config.kind == CriticKind::composed ? size.states : 0;
    value_.emplace(ledger, kept, config, MlpMemory::Shape{shape.inputs.size, 1, rows, states, size.element_bytes});
    return;
  }
  const auto [first, rest] = split_state_critic(config);
  code_ = first.hidden[0];
  entity_.emplace(ledger, kept, first,
                  MlpMemory::Shape{kEntityFeatures, 0, size.states * n_agents(), 0, size.element_bytes});
  value_.emplace(ledger, kept, rest,
                 MlpMemory::Shape{3 * code_ + shape.world_features, 1, rows, 0, size.element_bytes});
}

void CriticMemory::infer() {
  const int64_t before = ledger_.live();
  if (entity_) {
    // The agents' columns of the state are copied: in bf16 at the cast, which has a name, else for the first product.
    const int64_t entities = per_state(n_agents() * kEntityFeatures);
    ledger_.take(kept_, entities);
    ledger_.touch(entity_->output_bytes());
    if (size_.element_bytes != 2) ledger_.give(kept_, entities);
    entity_->infer();
    ledger_.take(kept_, join_codes() + value_input_bytes());
  } else {
    ledger_.take(kept_, cast_bytes());
  }
  value_->infer();
  ledger_.touch(values_bytes());
  ledger_.give(kept_, ledger_.live() - before);
}

// What Critic::forward makes between the codes and the input of the value network, and holds until it returns.
int64_t CriticMemory::join_codes() {
  const int64_t world = per_state(shape_.world_features), world_cast = size_.element_bytes == 2 ? world : 0;
  ledger_.touch(per_state((largest_team() + 1) * code_));  // copy of a team's codes, and their mean
  return world_cast + per_state(2 * code_) + per_state(2 * code_) + world;
}

void CriticMemory::learn() {
  const int64_t entities = per_state(n_agents() * kEntityFeatures), codes = per_state(n_agents() * code_);
  if (entity_) {
    ledger_.take(MemoryUse::minibatch, state_bytes());
    ledger_.take(kept_, entities);
    entity_->forward();
    ledger_.take(kept_, living_bytes());
    const int64_t joined = join_codes();
    ledger_.take(MemoryUse::temporary, joined);
    ledger_.take(kept_, value_input_bytes());
    value_->forward();
    ledger_.give(MemoryUse::temporary, joined);
    ledger_.give(MemoryUse::minibatch, state_bytes());
    if (!entity_->keeps_output()) ledger_.give(kept_, codes);
  } else {
    ledger_.take(kept_, cast_bytes());
    value_->forward();
  }
  // The values, their gradient, and their loss; the gradient in the network's precision.
  const int64_t values = 3 * values_bytes() + cast_of_values();
  ledger_.take(MemoryUse::temporary, values);
  const int64_t gradient = value_->backward(entity_.has_value());
  if (entity_) {
    ledger_.give(kept_, value_input_bytes());
    join_codes_backward(gradient);
    entity_->backward(false);
    ledger_.give(MemoryUse::temporary, codes);
    ledger_.give(kept_, entities + living_bytes());
  } else {
    ledger_.give(kept_, cast_bytes());
  }
  ledger_.give(MemoryUse::temporary, values);
  ledger_.give(kept_, value_->output_bytes());
}

// From the gradient of the value network's input, which is given back, to that of the codes, which is held. Each slice
// of the codes gets a gradient of full size, which is added to the first.
void CriticMemory::join_codes_backward(int64_t gradient) {
  const int64_t context = per_state(2 * code_ + shape_.world_features), codes = per_state(n_agents() * code_);
  ledger_.take(MemoryUse::temporary, codes + context);
  ledger_.give(MemoryUse::temporary, gradient);
  ledger_.touch(codes + per_state((largest_team() + 1) * code_));
  ledger_.give(MemoryUse::temporary, context);
}

}  // namespace giga
