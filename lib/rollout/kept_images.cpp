#include "rollout/kept_images.hpp"

#include "core/error.hpp"
#include "sim/image_rows.hpp"
#include "sim/image_state.hpp"

namespace giga {

at::Tensor KeptImages::draw(int team, const at::Tensor& from, const at::Tensor& rows) const {
  GIGA_CHECK(sim && from.dim() == 2 && from.is_contiguous() && (!rows.defined() || rows.is_contiguous()),
             "image states with gaps");
  const SimParams& p = sim->params();
  const int64_t count = rows.defined() ? rows.numel() : from.size(0);
  const at::Tensor images =
      at::empty({count, p.n_team[team], image_bytes(p.resolution)}, from.options().dtype(at::kByte));
  if (count == 0) return images;
  sim->redraw({.team = team,
               .states = from.const_data_ptr<int32_t>(),
               .rows = rows.defined() ? rows.const_data_ptr<int64_t>() : nullptr,
               .count = count,
               .images = images.data_ptr<uint8_t>()});
  return images;
}

}  // namespace giga
