// Encoders of images: `nature` (Mnih et al. 2015), `impala` (Espeholt et al. 2018) and `compact`, our own. An image is
// a row of bytes [side, side, 3], which is channels-last already: what it becomes is a view until the first
// convolution.
#pragma once

#include "policy/encoder.hpp"

namespace giga {

/// Three convolutions (8 x 8 by 4, 4 x 4 by 2, 3 x 3) of 32, 64 and 64 channels, ReLU behind each, then dense layers of
/// config.hidden. Throws InputError where the input is no image or smaller than kNatureSide.
EncoderFactory make_nature;

/// The agent is moved to the middle of its image (math/image_patches.hpp), so that where others lie is where they are
/// seen from it. Then three convolutions (4 x 4 by 4, 3 x 3 by 2 twice) of 32 channels, ReLU behind each, and dense
/// layers of config.hidden: a fifth of the arithmetic of `nature`. For images of any size; of a side that is no
/// multiple of 4 the last pixels are not seen, and what lies farther from the agent than half a side never is.
EncoderFactory make_compact;

/// Three sections of config.impala_width, twice and twice as many channels, each a convolution, a pooling that halves
/// the sides and two residual blocks; then ReLU and dense layers of config.hidden. For images of any size.
EncoderFactory make_impala;

/// The largest of 3 x 3 at every second pixel, of x [R, C, H, W]: at::max_pool2d with stride 2 and padding 1. On a GPU
/// the gradient of that adds up in any order, and a run would not repeat; where several are the largest, this one
/// divides the gradient among them.
at::Tensor pool_of_three(const at::Tensor& x);

}  // namespace giga
