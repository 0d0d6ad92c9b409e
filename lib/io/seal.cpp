// The text in front of a checkpoint, and its checksum.
#include "io/seal.hpp"

#include <zlib.h>

#include <charconv>
#include <cstdio>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr std::string_view kHdf5Signature = "\x89HDF\r\n\x1a\n";
constexpr std::string_view kChecksumKey = "crc32 ";
constexpr size_t kChecksumDigits = 8;

/// Over the whole file, the digits of the checksum itself counted as zeros.
std::string checksum(std::string_view bytes, size_t digits_at) {
  const auto add = [](uLong crc, std::string_view part) {
    return ::crc32_z(crc, reinterpret_cast<const Bytef*>(part.data()), part.size());
  };
  uLong crc = add(0, bytes.substr(0, digits_at));
  crc = add(crc, std::string(kChecksumDigits, '0'));
  crc = add(crc, bytes.substr(digits_at + kChecksumDigits));
  char text[kChecksumDigits + 1];
  std::snprintf(text, sizeof text, "%08lx", crc & 0xFFFFFFFFul);
  return text;
}

/// What follows `key` at the beginning of a line of the seal.
std::string_view value_of(std::string_view text, std::string_view key) {
  const size_t at = text.find(cat('\n', key, ' '));
  if (at == std::string_view::npos) return {};
  const size_t from = at + key.size() + 2;
  return text.substr(from, text.find('\n', from) - from);
}

/// -1 where the text is no number.
long long number(std::string_view text) {
  long long value = -1;
  const char* end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, value);
  return result.ec == std::errc() && result.ptr == end ? value : -1;
}

}  // namespace

void seal(std::string& bytes, const std::string& kind, int format_version, const std::string& gigastep_version) {
  std::string text = cat(kind, "\nformat_version ", format_version, "\ngigastep_version ", gigastep_version, "\nbytes ",
                         bytes.size(), '\n', kChecksumKey);
  const size_t digits_at = text.size();
  text += std::string(kChecksumDigits, '0') + "\n";
  GIGA_CHECK(text.size() <= kSealBytes && bytes.size() >= kSealBytes, "a seal of ", text.size(), " bytes");
  text.resize(kSealBytes, '\0');
  bytes.replace(0, kSealBytes, text);
  bytes.replace(digits_at, kChecksumDigits, checksum(bytes, digits_at));
}

std::string broken_seal(std::string_view bytes, const std::string& kind, int format_version) {
  if (bytes.empty()) return "is empty";
  const std::string_view text = bytes.substr(0, kSealBytes);
  if (text.substr(0, kHdf5Signature.size()) == kHdf5Signature) return cat("is an HDF5 file but not a ", kind);
  if (text.substr(0, kind.size() + 1) != kind + "\n") return cat("is not a ", kind);

  const long long version = number(value_of(text, "format_version"));
  if (version >= 1 && version != format_version)
    return cat("has format version ", version, version > format_version ? ", newer than " : ", older than ",
               format_version, ", which this gigastep reads: use gigastep ", value_of(text, "gigastep_version"),
               ", which wrote it", version > format_version ? "" : ", or train again");
  const long long size = number(value_of(text, "bytes"));
  if (size > static_cast<long long>(bytes.size())) return cat("is truncated: ", bytes.size(), " of ", size, " bytes");
  const size_t key_at = text.find(cat('\n', kChecksumKey));
  const size_t digits_at = key_at + 1 + kChecksumKey.size();
  if (version < 1 || size != static_cast<long long>(bytes.size()) || key_at == std::string_view::npos ||
      digits_at + kChecksumDigits > text.size())
    return "is damaged: its first lines make no sense";
  if (text.substr(digits_at, kChecksumDigits) != checksum(bytes, digits_at))
    return "is damaged: its checksum does not match, so it has changed since it was written";
  return "";
}

}  // namespace giga
