#include "play/spec_bytes.hpp"

#include <cstddef>

#include "play/byte_stream.hpp"

namespace giga {
namespace {

/// The numbers of SimParams lie before its tables of pointers, at the same places everywhere. Only where the pointers
/// begin depends on their size.
constexpr size_t kNumbers = offsetof(SimParams, agents);
constexpr size_t kPointerSize = 8;

}  // namespace

std::string spec_bytes(const SimSpec& spec) {
  ByteWriter out;
  out.put_text(spec.name);
  const auto* numbers = reinterpret_cast<const char*>(&spec.params);
  out.put_text({numbers, kNumbers});
  out.put_all(spec.agents);
  out.put(static_cast<uint32_t>(spec.maps.size()));
  for (const MapSpec& map : spec.maps) {
    out.put_text(map.name);
    out.put_all(map.boxes);
    for (const StartArea& area : map.start) out.put(area);
    out.put_all(map.paths);
  }
  out.put(static_cast<int32_t>(spec.neighbor_limit));
  return out.take();
}

SimSpec read_spec(std::string_view bytes) {
  ByteReader in(bytes);
  SimSpec spec;
  spec.name = in.get_text();
  const std::string numbers = in.get_text();
  GIGA_CHECK(numbers.size() >= kNumbers && numbers.size() < kNumbers + kPointerSize, numbers.size(),
             " bytes of parameters, ", kNumbers, " expected");
  std::memcpy(reinterpret_cast<char*>(&spec.params), numbers.data(), kNumbers);
  spec.agents = in.get_all<AgentSpec>();
  spec.maps.resize(in.get<uint32_t>());
  for (MapSpec& map : spec.maps) {
    map.name = in.get_text();
    map.boxes = in.get_all<Box>();
    for (StartArea& area : map.start) area = in.get<StartArea>();
    map.paths = in.get_all<uint16_t>();
  }
  spec.neighbor_limit = in.get<int32_t>();
  GIGA_CHECK(in.at_end(), "bytes behind a scenario");
  return spec;
}

}  // namespace giga
