// The LibTorch headers that giga_use_torch_pch() precompiles: tensors, their functions, autograd.
// <torch/torch.h> instead would cost 33 s rather than 20 s once, and 7 s rather than 2.3 s in every file.
#pragma once
#include <torch/types.h>

#include <torch/autograd.h>
#include <torch/utils.h>
