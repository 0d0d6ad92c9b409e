// What exports give in Python, against numbers of ours.
#pragma once

#include <torch/types.h>

#include <filesystem>

#include "io/temporary_folder.hpp"

namespace giga::test {

/// The plain numbers of a tensor, for compare.py.
void write_tensor(const std::filesystem::path& file, const at::Tensor& tensor);

/// Lets Python compare the n exports of a folder with the numbers beside them (compare.py); skips the test where it
/// lacks a package.
void expect_agreement(const TemporaryFolder& folder, size_t n);

}  // namespace giga::test
