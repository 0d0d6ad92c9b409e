// Formulas over arrays as code for other programs: written once in C++, they become Python or a graph of ONNX.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace giga {

/// An operation element by element, with the rules of NumPy for arrays of different shapes.
struct ArrayOperation {
  const char* python;  ///< of NumPy and of PyTorch alike; an operator where it is no word
  const char* onnx;
};
namespace array_operation {
constexpr ArrayOperation kAdd{"+", "Add"}, kSubtract{"-", "Sub"}, kMultiply{"*", "Mul"}, kDivide{"/", "Div"},
    kLess{"<", "Less"}, kGreater{">", "Greater"}, kEqual{"==", "Equal"}, kBoth{"&", "And"}, kEither{"|", "Or"},
    kMaximum{"maximum", "Max"}, kMinimum{"minimum", "Min"}, kWhere{"where", "Where"}, kSqrt{"sqrt", "Sqrt"},
    kSin{"sin", "Sin"}, kCos{"cos", "Cos"}, kFloor{"floor", "Floor"}, kNot{"logical_not", "Not"};
}  // namespace array_operation

/// Writes a formula in one language. Arrays are known by what stands for them there: a name or an expression. Their
/// first side is the batch.
class ArrayWriter {
 public:
  virtual ~ArrayWriter() = default;
  virtual std::string operation(const ArrayOperation& op, const std::vector<std::string>& arguments) = 0;
  virtual std::string number(float value) = 0;
  /// x[:, first:end] of x [B, n].
  virtual std::string columns(const std::string& x, int first, int end) = 0;
  /// [B, sides...].
  virtual std::string reshaped(const std::string& x, const std::vector<int>& sides) = 0;
  /// x[:, :, k] of x [B, m, n].
  virtual std::string feature(const std::string& x, int k) = 0;
  /// Running sums along the second side of x [B, n].
  virtual std::string running_sum(const std::string& x) = 0;
  /// Sum along the second side of x [B, m, n].
  virtual std::string sum_of_items(const std::string& x) = 0;
  /// The least along the third side of x [B, m, n].
  virtual std::string least(const std::string& x) = 0;
  /// One behind the other along the second side.
  virtual std::string joined(const std::vector<std::string>& parts) = 0;
  /// The value under a name that tells the reader what it is, computed once.
  virtual std::string named(const std::string& name, const std::string& x) = 0;
};

/// An array of a formula. The operators write what computes it.
struct Array {
  ArrayWriter* to;
  std::string text;

  Array columns(int first, int end) const { return {to, to->columns(text, first, end)}; }
  Array column(int k) const { return columns(k, k + 1); }
  Array reshaped(const std::vector<int>& sides) const { return {to, to->reshaped(text, sides)}; }
  Array feature(int k) const { return {to, to->feature(text, k)}; }
  Array named(const std::string& name) const { return {to, to->named(name, text)}; }
};

inline Array apply(const ArrayOperation& op, const std::vector<Array>& arguments) {
  std::vector<std::string> texts;
  for (const Array& a : arguments) texts.push_back(a.text);
  ArrayWriter* to = arguments.front().to;
  return {to, to->operation(op, texts)};
}
inline Array number(const Array& beside, float value) { return {beside.to, beside.to->number(value)}; }

inline Array operator+(const Array& a, const Array& b) { return apply(array_operation::kAdd, {a, b}); }
inline Array operator-(const Array& a, const Array& b) { return apply(array_operation::kSubtract, {a, b}); }
inline Array operator*(const Array& a, const Array& b) { return apply(array_operation::kMultiply, {a, b}); }
inline Array operator/(const Array& a, const Array& b) { return apply(array_operation::kDivide, {a, b}); }
inline Array operator<(const Array& a, const Array& b) { return apply(array_operation::kLess, {a, b}); }
inline Array operator>(const Array& a, const Array& b) { return apply(array_operation::kGreater, {a, b}); }
inline Array operator==(const Array& a, const Array& b) { return apply(array_operation::kEqual, {a, b}); }
inline Array operator&(const Array& a, const Array& b) { return apply(array_operation::kBoth, {a, b}); }
inline Array operator|(const Array& a, const Array& b) { return apply(array_operation::kEither, {a, b}); }
inline Array operator!(const Array& a) { return apply(array_operation::kNot, {a}); }
inline Array operator*(float a, const Array& b) { return number(b, a) * b; }
inline Array operator-(float a, const Array& b) { return number(b, a) - b; }
inline Array operator+(float a, const Array& b) { return number(b, a) + b; }
inline Array operator/(float a, const Array& b) { return number(b, a) / b; }
inline Array operator-(const Array& a, float b) { return a - number(a, b); }
inline Array operator<(const Array& a, float b) { return a < number(a, b); }
inline Array operator>(const Array& a, float b) { return a > number(a, b); }
inline Array operator==(const Array& a, float b) { return a == number(a, b); }
inline Array maximum(const Array& a, const Array& b) { return apply(array_operation::kMaximum, {a, b}); }
inline Array minimum(const Array& a, const Array& b) { return apply(array_operation::kMinimum, {a, b}); }
inline Array where(const Array& condition, const Array& yes, const Array& no) {
  return apply(array_operation::kWhere, {condition, yes, no});
}
inline Array square_root(const Array& a) { return apply(array_operation::kSqrt, {a}); }
inline Array sine(const Array& a) { return apply(array_operation::kSin, {a}); }
inline Array cosine(const Array& a) { return apply(array_operation::kCos, {a}); }
inline Array whole_part(const Array& a) { return apply(array_operation::kFloor, {a}); }
inline Array running_sum(const Array& a) { return {a.to, a.to->running_sum(a.text)}; }
inline Array sum_of_items(const Array& a) { return {a.to, a.to->sum_of_items(a.text)}; }
inline Array least(const Array& a) { return {a.to, a.to->least(a.text)}; }
inline Array joined(const std::vector<Array>& parts) {
  std::vector<std::string> texts;
  for (const Array& part : parts) texts.push_back(part.text);
  return {parts.front().to, parts.front().to->joined(texts)};
}

/// Python, a line for each named value: `library` is "np" or "torch", whose functions have the same names.
class PythonWriter final : public ArrayWriter {
 public:
  PythonWriter(std::string library, std::string indent) : library_(std::move(library)), indent_(std::move(indent)) {}

  const std::string& code() const { return code_; }

  std::string operation(const ArrayOperation& op, const std::vector<std::string>& arguments) override;
  std::string number(float value) override;
  std::string columns(const std::string& x, int first, int end) override;
  std::string reshaped(const std::string& x, const std::vector<int>& sides) override;
  std::string feature(const std::string& x, int k) override;
  std::string running_sum(const std::string& x) override;
  std::string sum_of_items(const std::string& x) override;
  std::string least(const std::string& x) override;
  std::string joined(const std::vector<std::string>& parts) override;
  std::string named(const std::string& name, const std::string& x) override;

 private:
  std::string call(const std::string& function, const std::string& arguments) const;

  std::string library_, indent_, code_;
  std::map<std::string, int> uses_;  // of names: the second one is name_2
};

}  // namespace giga
