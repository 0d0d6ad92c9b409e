#include "policy/encoder.hpp"

#include "core/error.hpp"
#include "policy/convolution.hpp"

namespace giga {

EncoderFactory make_mlp;  // mlp.cpp

namespace {

/// The table of encoders: one file and one row each.
struct EncoderRow {
  EncoderKind kind;
  EncoderFactory* make;
};
constexpr EncoderRow kEncoders[] = {{EncoderKind::mlp, make_mlp},
                                    {EncoderKind::nature, make_nature},
                                    {EncoderKind::impala, make_impala},
                                    {EncoderKind::compact, make_compact}};

}  // namespace

EncoderFactory* encoder_factory(EncoderKind kind) {
  for (const EncoderRow& row : kEncoders)
    if (row.kind == kind) return row.make;
  throw Error("an encoder without a row in the table");
}

}  // namespace giga
