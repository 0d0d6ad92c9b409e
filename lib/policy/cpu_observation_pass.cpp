#include "policy/cpu_passes.hpp"

namespace giga {

ObservationPass::ObservationPass(const FusedMlp& net) : net_(net) {
  for (int k = 0; k <= FusedMlp::kLayers; ++k) x_[k].resize(kBlockRows, net.width[k]);
  for (int k = 0; k < FusedMlp::kLayers; ++k) {
    slope_[k].resize(kBlockRows, net.width[k + 1]);
    if (net.team_weight[k] < 0) continue;
    mean_[k].resize(kBlockRows, net.width[k]);
    team_[k].resize(kBlockRows, net.width[k + 1]);
  }
}

Rows ObservationPass::forward(const float* parameters, const FusedRows& rows, const Block& block) {
  parameters_ = parameters;
  gather(rows, block);
  for (int k = 0; k < FusedMlp::kLayers; ++k) {
    Rows y = top(x_[k + 1], block.rows);
    y.noalias() = top(x_[k], block.rows) * weight(net_.weight[k], k).transpose();
    y.rowwise() += bias(k);
    if (net_.team_weight[k] >= 0) exchange(block, k, y);
    if (k + 1 < FusedMlp::kLayers) apply_activation(net_.activation, y, top(slope_[k], block.rows));
  }
  return top(x_[FusedMlp::kLayers], block.rows);
}

void ObservationPass::backward(const Block& block, Matrix& d_output, float* gradient) {
  Matrix* d = &d_output;
  for (int k = FusedMlp::kLayers - 1; k >= 0; --k) {
    const Rows dy = top(*d, block.rows);
    place(gradient + net_.weight[k], k).noalias() += dy.transpose() * top(x_[k], block.rows);
    Eigen::Map<Vector>(gradient + net_.bias[k], net_.width[k + 1]) += dy.colwise().sum();
    const bool exchanges = net_.team_weight[k] >= 0;
    if (exchanges) {
      sum_of_states(block.states, block.begin.data(), *d, team_[k]);
      place(gradient + net_.team_weight[k], k).noalias() +=
          top(team_[k], block.states).transpose() * top(mean_[k], block.states);
    }
    if (k == 0) break;
    Rows dx = top(d_[k - 1], block.rows, net_.width[k]);
    dx.noalias() = dy * weight(net_.weight[k], k);
    if (exchanges) {
      top(mean_[k], block.states).noalias() = top(team_[k], block.states) * weight(net_.team_weight[k], k);
      share_with_rows(block.states, block.begin.data(), block.share.data(), mean_[k], d_[k - 1]);
    }
    dx.array() *= top(slope_[k - 1], block.rows).array();
    d = &d_[k - 1];
  }
}

void ObservationPass::gather(const FusedRows& rows, const Block& block) {
  const Eigen::Index width = net_.width[0];
  using Numbers = Eigen::Map<const Eigen::Array<float, 1, Eigen::Dynamic>>;
  for (int r = 0; r < block.rows; ++r) {
    auto x = x_[0].row(r).array();
    x = Numbers(rows.obs + block.source[static_cast<size_t>(r)] * rows.obs_stride, width);
    if (!rows.obs_mean) continue;
    x = ((x - Numbers(rows.obs_mean, width)) / Numbers(rows.obs_std, width)).max(-rows.obs_limit).min(rows.obs_limit);
  }
}

/// Composed critics: a layer reads the mean of what the living agents of the team feed into it, too.
void ObservationPass::exchange(const Block& block, int k, Rows& y) {
  mean_of_states(block.states, block.begin.data(), block.share.data(), x_[k], mean_[k]);
  top(team_[k], block.states).noalias() = top(mean_[k], block.states) * weight(net_.team_weight[k], k).transpose();
  for (int s = 0; s < block.states; ++s)
    for (int r = block.begin[static_cast<size_t>(s)]; r < block.begin[static_cast<size_t>(s) + 1]; ++r)
      y.row(r) += team_[k].row(s);
}

}  // namespace giga
