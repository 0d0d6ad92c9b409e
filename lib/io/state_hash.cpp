// SHA-256 by OpenSSL.
#include "io/state_hash.hpp"

#include <openssl/evp.h>

#include <array>
#include <memory>

#include "core/error.hpp"

namespace giga {
namespace {

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    check(context_ && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1);
  }

  void add(const void* bytes, size_t size) { check(EVP_DigestUpdate(context_.get(), bytes, size) == 1); }
  void add(const std::string& text) { add(text.data(), text.size()); }

  std::string hex() {
    std::array<unsigned char, 32> digest{};
    check(EVP_DigestFinal_ex(context_.get(), digest.data(), nullptr) == 1);
    static constexpr char kHex[] = "0123456789abcdef";
    std::string text;
    for (const unsigned char byte : digest) text += {kHex[byte >> 4], kHex[byte & 15]};
    return text;
  }

 private:
  static void check(bool good) {
    if (!good) throw Error("OpenSSL offers no SHA-256 here");
  }
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

std::string state_sha256(const NamedArrays& arrays) {
  Sha256 hash;
  for (const NamedArray& array : arrays) {
    // A header that cannot be mistaken for that of another array: names have no line ends.
    std::string header = cat(array.name, '\n', static_cast<int>(array.type), ' ', array.shape.size());
    for (const int64_t side : array.shape) header += cat(' ', side);
    hash.add(header + '\n');
    hash.add(array.bytes.data(), array.bytes.size());
  }
  return hash.hex();
}

}  // namespace giga
