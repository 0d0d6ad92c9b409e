// Seal: the first 512 bytes of a checkpoint, in text: what the file is, how long, and a checksum over all of it. They
// are looked at before anything else reads the file, because the HDF5 library is not made for damaged ones. HDF5 knows
// such a block as "user block" and skips it, so that h5py and h5dump open the file as it is.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace giga {

constexpr size_t kSealBytes = 512;

/// Writes the seal into the first kSealBytes of a file whose other bytes are complete.
void seal(std::string& bytes, const std::string& kind, int format_version, const std::string& gigastep_version);

/// What is wrong with a file that should begin with a seal of that kind, as "is truncated: ..."; empty if nothing is.
std::string broken_seal(std::string_view bytes, const std::string& kind, int format_version);

}  // namespace giga
