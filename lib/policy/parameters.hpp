// ParameterSet: all parameters of a network in one flat buffer, their gradients in another, so that clipping and the
// optimizer are one call each.
#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/named_array.hpp"

namespace giga {

/// How a parameter starts: orthogonal rows or columns times `value` (Saxe et al. 2014), or all equal to `value`, a part
/// of them to another one.
struct Init {
  enum class Kind : uint8_t { orthogonal, constant } kind = Kind::constant;
  float value = 0;
  struct Part {
    int64_t first = 0, count = 0;
    float value = 0;
  } part = {};
};

/// The place of a weight matrix among the flat parameters, row by row.
struct MatrixPlace {
  int64_t offset, rows, columns;
};

class ParameterSet {
 public:
  /// Announces a parameter and returns its number. All are announced before `allocate`.
  int add(const std::string& name, std::vector<int64_t> shape, Init init);
  /// Announces a matrix [rows, columns] with as many rows as matrix `k`: two inputs of one layer. The two start as one
  /// orthogonal matrix over the columns of both. Started one by one, their sum would be too large.
  int add_beside(int k, const std::string& name, int64_t columns);

  /// Allocates and initialises everything. The same seed gives the same values on every device.
  /// Without one all are zeros, to be loaded.
  void allocate(at::Device device, std::optional<uint64_t> seed);

  /// Parameter `k`: a leaf view into the flat buffer, whose gradient is a view into the flat gradient.
  const at::Tensor& operator[](int k) const { return views_[static_cast<size_t>(k)]; }

  /// The same parameters, all rounded to bfloat16 at once: one kernel, and three on the way back, in the place of three
  /// for each parameter. One of eight numbers or more that would not begin at 16 bytes is copied once more: tensor
  /// cores read it slowly, and the kernels of dense_epilogue.hpp not at all.
  ParameterSet in_bfloat16() const;
  /// Parameter `k` as it is, also of a set that is rounded.
  const at::Tensor& exact(int k) const { return (exact_.empty() ? views_ : exact_)[static_cast<size_t>(k)]; }

  const at::Tensor& values() const { return values_; }      // [P]
  const at::Tensor& gradient() const { return gradient_; }  // [P]
  int64_t size() const { return size_; }

  /// Parameter `k` of each member of a population [M, P] of such sets: a view [M, shape].
  at::Tensor of_members(const at::Tensor& members, int k) const;
  const std::vector<int64_t>& shape(int k) const { return specs_[static_cast<size_t>(k)].shape; }
  /// Where parameter `k` begins in the flat buffer.
  int64_t offset(int k) const { return specs_[static_cast<size_t>(k)].offset; }
  /// All parameters of two dimensions.
  std::vector<MatrixPlace> matrices() const;

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  struct Spec {
    std::string name;
    std::vector<int64_t> shape;
    Init init;
    int64_t offset;
    int beside = -1;  // the parameter whose columns follow in the matrix that both start as; none
  };
  std::vector<at::Tensor> starts(uint64_t seed) const;
  static at::Tensor of(const at::Tensor& all, const Spec& spec);  // its part of a flat buffer
  std::vector<Spec> specs_;
  std::vector<at::Tensor> views_, exact_;  // exact_: of a rounded set
  at::Tensor values_, gradient_;
  at::Tensor leaf_;  // the values, with the gradient of all
  int64_t size_ = 0;
};

/// Parameters as layers read them: rounded to bfloat16 at once, or as they are.
class ReadParameters {
 public:
  ReadParameters(const ParameterSet& set, bool in_bfloat16) : set_(set) {
    if (in_bfloat16) rounded_ = set.in_bfloat16();
  }
  const ParameterSet& operator*() const { return rounded_ ? *rounded_ : set_; }

 private:
  const ParameterSet& set_;
  std::optional<ParameterSet> rounded_;
};

/// Copies between tensors and checkpoint arrays; shapes must match.
NamedArray to_array(const std::string& name, const at::Tensor& tensor);
void from_array(const NamedArray& array, const at::Tensor& tensor);

}  // namespace giga
