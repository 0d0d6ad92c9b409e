#include "policy/cpu_passes.hpp"

namespace giga {

StatePass::StatePass(const FusedMlp& net) : net_(net) {}

/// The numbers of the agents of a block, of the other team's only the living, and those of the worlds.
void StatePass::gather(const FusedRows& rows, const Block& block) {
  const FusedState& layout = net_.state;
  const int width = net_.width[0];
  using Numbers = Eigen::Map<const Vector>;
  Rows own = top(agents_[kOwn], block.rows, width);
  Rows other = top(agents_[kOther], block.states * layout.n_other, width);
  Rows of_state = top(of_state_, block.states, reads() - codes());
  other_begin_.assign(1, 0);
  other_share_.clear();
  int n_others = 0;
  for (int s = 0; s < block.states; ++s) {
    const int64_t state = block.state[static_cast<size_t>(s)];
    const float* from = rows.obs + state * rows.obs_stride;
    for (int r = block.begin[static_cast<size_t>(s)]; r < block.begin[static_cast<size_t>(s) + 1]; ++r) {
      const int64_t agent = block.source[static_cast<size_t>(r)] - state * rows.n;
      own.row(r) = Numbers(from + (layout.first_own + agent) * width, width);
    }
    const int first = n_others;
    for (int i = 0; i < layout.n_other; ++i) {
      const float* agent = from + (layout.first_other + i) * width;
      if (agent[0] != 0) other.row(n_others++) = Numbers(agent, width);  // the first one says who lives
    }
    other_share_.resize(static_cast<size_t>(n_others), 1.0f / static_cast<float>(std::max(1, n_others - first)));
    other_begin_.push_back(n_others);
    of_state.row(s).tail(layout.world) = Numbers(from + (rows.n + layout.n_other) * width, layout.world);
  }
}

Rows StatePass::forward(const float* parameters, const FusedRows& rows, const Block& block) {
  parameters_ = parameters;
  gather(rows, block);
  const int count[2] = {block.rows, other_begin_.back()};
  for (int team = 0; team < 2; ++team) {
    Rows code = top(code_[team], count[team], codes());
    code.noalias() = top(agents_[team], count[team]) * encoder().transpose();
    code.rowwise() += Eigen::Map<const Vector>(parameters_ + net_.bias[0], codes());
    apply_activation(net_.activation, code, top(slope_[team], count[team], codes()));
  }

  Rows of_state = top(of_state_, block.states);
  const int* begins[2] = {block.begin.data(), other_begin_.data()};
  const float* shares[2] = {block.share.data(), other_share_.data()};
  for (int team = 0; team < 2; ++team) {
    const Rows mean = top(mean_, block.states, codes());
    mean_of_states(block.states, begins[team], shares[team], code_[team], mean_);
    of_state.middleCols(team * codes(), codes()) = mean;
  }

  Rows sums = top(sums_, block.states, hidden());
  sums.noalias() = of_state * reader().rightCols(reads() - codes()).transpose();
  sums.rowwise() += Eigen::Map<const Vector>(parameters_ + net_.bias[1], hidden());
  Rows features = top(features_, block.rows, hidden());
  features.noalias() = top(code_[kOwn], block.rows) * reader().leftCols(codes()).transpose();
  for (int s = 0; s < block.states; ++s)
    for (int r = block.begin[static_cast<size_t>(s)]; r < block.begin[static_cast<size_t>(s) + 1]; ++r)
      features.row(r) += sums.row(s);
  apply_activation(net_.activation, features, top(features_slope_, block.rows, hidden()));

  Rows value = top(value_, block.rows, 1);
  value.noalias() = features * Eigen::Map<const Vector>(parameters_ + net_.weight[2], hidden()).transpose();
  value.array() += parameters_[net_.bias[2]];
  return value;
}

void StatePass::backward(const Block& block, Matrix& d_value, float* gradient) {
  const int states = block.states, shared = reads() - codes();
  const int count[2] = {block.rows, other_begin_.back()};
  const Rows dv = top(d_value, block.rows);
  Eigen::Map<Vector>(gradient + net_.weight[2], hidden()).noalias() += dv.transpose() * top(features_, block.rows);
  gradient[net_.bias[2]] += dv.sum();

  // The second layer: what its rows read alike goes back once for each state.
  Rows d = top(d_features_, block.rows, hidden());
  d.noalias() = dv * Eigen::Map<const Vector>(parameters_ + net_.weight[2], hidden());
  d.array() *= top(features_slope_, block.rows).array();
  const Rows sums = top(sums_, states);
  sum_of_states(states, block.begin.data(), d_features_, sums_);
  Eigen::Map<Matrix> d_reader(gradient + net_.weight[1], hidden(), reads());
  d_reader.leftCols(codes()).noalias() += d.transpose() * top(code_[kOwn], block.rows);
  d_reader.rightCols(shared).noalias() += sums.transpose() * top(of_state_, states);
  Eigen::Map<Vector>(gradient + net_.bias[1], hidden()) += sums.colwise().sum();

  // The codes, of which the means are made too.
  top(d_code_[kOwn], block.rows, codes()).noalias() = d * reader().leftCols(codes());
  top(d_code_[kOther], count[kOther], codes()).setZero();
  const int* begins[2] = {block.begin.data(), other_begin_.data()};
  const float* shares[2] = {block.share.data(), other_share_.data()};
  Eigen::Map<Matrix> d_encoder(gradient + net_.weight[0], codes(), net_.width[0]);
  for (int team = 0; team < 2; ++team) {
    Rows d_code = top(d_code_[team], count[team]), d_mean = top(mean_, states);
    d_mean.noalias() = sums * reader().middleCols(first_of_mean(team), codes());
    share_with_rows(states, begins[team], shares[team], mean_, d_code_[team]);
    d_code.array() *= top(slope_[team], count[team]).array();
    d_encoder.noalias() += d_code.transpose() * top(agents_[team], count[team]);
    Eigen::Map<Vector>(gradient + net_.bias[0], codes()) += d_code.colwise().sum();
  }
}

}  // namespace giga
