#include "policy/parameters.hpp"

#include <ATen/ATen.h>
#include <ATen/CPUGeneratorImpl.h>
#include <ATen/core/grad_mode.h>

#include "core/error.hpp"

namespace giga {
namespace {

at::Tensor orthogonal(const std::vector<int64_t>& shape, float gain, at::Generator& generator) {
  GIGA_CHECK(shape.size() == 2, "orthogonal initialisation of ", shape.size(), " dimensions");
  const bool wide = shape[0] < shape[1];
  const std::vector<int64_t> tall = wide ? std::vector<int64_t>{shape[1], shape[0]} : shape;
  const at::Tensor normal = at::randn(tall, generator, at::TensorOptions().dtype(at::kDouble));
  const auto [q, r] = at::linalg_qr(normal);
  const at::Tensor columns = q * at::sign(at::diagonal(r));  // makes the distribution uniform
  return (wide ? columns.t() : columns).to(at::kFloat) * gain;
}

ArrayType array_type(at::ScalarType type) {
  switch (type) {
    case at::kFloat:
      return ArrayType::f32;
    case at::kDouble:
      return ArrayType::f64;
    case at::kInt:
      return ArrayType::i32;
    case at::kLong:
      return ArrayType::i64;
    case at::kByte:
      return ArrayType::u8;
    default:
      throw Error("a tensor of this type cannot be saved");
  }
}

}  // namespace

int ParameterSet::add(const std::string& name, std::vector<int64_t> shape, Init init) {
  int64_t count = 1;
  for (const int64_t side : shape) count *= side;
  specs_.push_back({name, std::move(shape), init, size_});
  size_ += count;
  return static_cast<int>(specs_.size()) - 1;
}

int ParameterSet::add_beside(int k, const std::string& name, int64_t columns) {
  const Spec first = specs_.at(static_cast<size_t>(k));
  GIGA_CHECK(first.init.kind == Init::Kind::orthogonal && first.beside < 0, first.name);
  const int right = add(name, {first.shape[0], columns}, first.init);
  specs_[static_cast<size_t>(k)].beside = right;
  return right;
}

/// What each parameter starts with, on the CPU.
std::vector<at::Tensor> ParameterSet::starts(uint64_t seed) const {
  at::Generator generator = at::detail::createCPUGenerator(seed);
  std::vector<at::Tensor> start(specs_.size());
  for (size_t k = 0; k < specs_.size(); ++k) {
    const Spec& spec = specs_[k];
    if (start[k].defined()) continue;  // the right part of an earlier one
    if (spec.init.kind == Init::Kind::constant) {
      start[k] = at::full(spec.shape, spec.init.value);
      const Init::Part& part = spec.init.part;
      start[k].view({-1}).narrow(0, part.first, part.count).fill_(part.value);
    } else if (spec.beside < 0) {
      start[k] = orthogonal(spec.shape, spec.init.value, generator);
    } else {
      const auto right = static_cast<size_t>(spec.beside);
      const int64_t columns = spec.shape[1], more = specs_[right].shape[1];
      const at::Tensor both = orthogonal({spec.shape[0], columns + more}, spec.init.value, generator);
      start[k] = both.narrow(1, 0, columns);
      start[right] = both.narrow(1, columns, more);
    }
  }
  return start;
}

void ParameterSet::allocate(at::Device device, std::optional<uint64_t> seed) {
  at::NoGradGuard no_grad;
  const std::vector<at::Tensor> start = seed ? starts(*seed) : std::vector<at::Tensor>();
  values_ = at::zeros({size_}, at::TensorOptions().dtype(at::kFloat).device(device));
  gradient_ = at::zeros_like(values_);
  leaf_ = values_.detach().set_requires_grad(true);
  leaf_.mutable_grad() = gradient_;
  for (size_t k = 0; k < specs_.size(); ++k) {
    const Spec& spec = specs_[k];
    at::Tensor view = of(values_, spec).detach();
    if (seed) view.copy_(start[k]);
    view.set_requires_grad(true);
    view.mutable_grad() = of(gradient_, spec);
    views_.push_back(view);
  }
}

ParameterSet ParameterSet::in_bfloat16() const {
  constexpr int64_t kAligned = 8;  // numbers of 16 bytes
  std::vector<int64_t> sizes;
  for (const at::Tensor& view : views_) sizes.push_back(view.numel());
  ParameterSet rounded = *this;
  rounded.exact_ = views_;
  const std::vector<at::Tensor> parts = leaf_.to(at::kBFloat16).split_with_sizes(sizes);
  for (size_t k = 0; k < parts.size(); ++k) {
    const Spec& spec = specs_[k];
    const bool aligned = spec.offset % kAligned == 0 || sizes[k] < kAligned;
    rounded.views_[k] = (aligned ? parts[k] : parts[k].clone()).view(spec.shape);
  }
  return rounded;
}

at::Tensor ParameterSet::of_members(const at::Tensor& members, int k) const {
  const Spec& spec = specs_[static_cast<size_t>(k)];
  int64_t count = 1;
  for (const int64_t side : spec.shape) count *= side;
  return members.narrow(1, spec.offset, count).unflatten(1, spec.shape);
}

std::vector<MatrixPlace> ParameterSet::matrices() const {
  std::vector<MatrixPlace> places;
  for (const Spec& spec : specs_)
    if (spec.shape.size() == 2) places.push_back({spec.offset, spec.shape[0], spec.shape[1]});
  return places;
}

void ParameterSet::save(const std::string& prefix, NamedArrays& out) const {
  const at::Tensor host = values_.detach().cpu();  // in one copy
  for (const Spec& spec : specs_) out.push_back(to_array(prefix + spec.name, of(host, spec)));
}

void ParameterSet::load(const std::string& prefix, const NamedArrays& in) {
  at::NoGradGuard no_grad;
  const at::Tensor host = at::empty(values_.sizes(), values_.options().device(at::kCPU).requires_grad(false));
  for (const Spec& spec : specs_) from_array(find_array(in, prefix + spec.name), of(host, spec));
  values_.detach().copy_(host);
}

at::Tensor ParameterSet::of(const at::Tensor& all, const Spec& spec) {
  int64_t count = 1;
  for (const int64_t side : spec.shape) count *= side;
  return all.narrow(0, spec.offset, count).view(spec.shape);
}

NamedArray to_array(const std::string& name, const at::Tensor& tensor) {
  const at::Tensor host = tensor.detach().cpu().contiguous();
  NamedArray array{name, array_type(host.scalar_type()), host.sizes().vec(), {}};
  array.bytes.resize(static_cast<size_t>(host.nbytes()));
  if (!array.bytes.empty()) std::memcpy(array.bytes.data(), host.data_ptr(), array.bytes.size());
  return array;
}

void from_array(const NamedArray& array, const at::Tensor& tensor) {
  if (array.type != array_type(tensor.scalar_type()) || at::IntArrayRef(array.shape) != tensor.sizes())
    throw InputError(cat("array '", array.name, "' of the checkpoint has shape ", shape_text(array.shape),
                         ", expected ", shape_text(tensor.sizes().vec()),
                         ": it was written with other settings or by another version"));
  at::NoGradGuard no_grad;
  const at::Tensor host = at::empty(array.shape, tensor.options().device(at::kCPU).requires_grad(false));
  GIGA_CHECK(static_cast<size_t>(host.nbytes()) == array.bytes.size(), array.name);
  if (!array.bytes.empty()) std::memcpy(host.data_ptr(), array.bytes.data(), array.bytes.size());
  tensor.detach().copy_(host);
}

}  // namespace giga
