#include "learn/memory/report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/error.hpp"
#include "learn/team_policy.hpp"

namespace giga {
namespace {

template <class... Args>
std::string format(const char* pattern, const Args&... args) {
  char text[512];
  std::snprintf(text, sizeof text, pattern, args...);
  return text;
}

std::string advice(const LoadedRun& run, Device device, int64_t available_bytes) {
  const int64_t largest = largest_size(run, device, available_bytes);
  if (largest > 0) return cat("the largest ", run_size(run.config).key(), " that fits is ", largest);
  return is_evolution(run.config.train)
             ? "not even the smallest population fits with these settings: smaller networks, fewer episodes per member "
               "or a smaller pool take less"
             : "not even one world fits with these settings: smaller networks or a shorter horizon take less";
}

/// What networks are computed in on the device.
std::string print_precision(const LoadedRun& run, Device device) {
  return FieldCodec<Precision>::print(precision_on(run, device));
}

/// A line for the table; nothing where there are no members.
std::string networks_line(const LoadedRun& run, Device device, MemberNetworks networks) {
  if (networks == MemberNetworks::none) return "";
  return cat("members' networks: in ", print_precision(run, device), ", ",
             networks == MemberNetworks::libtorch ? "through LibTorch" : "by the fused kernel", "\n");
}

const char* name_of(MemberNetworks networks) {
  constexpr const char* kNames[] = {"none", "libtorch", "fused"};
  return kNames[static_cast<size_t>(networks)];
}

}  // namespace

std::string print_bytes(int64_t bytes) {
  static constexpr const char* kUnits[] = {"B", "KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes);
  size_t unit = 0;
  for (; value >= 1023.5 && unit + 1 < std::size(kUnits); ++unit) value /= 1024;
  const int decimals = unit == 0 || value >= 99.95 ? 0 : value >= 9.995 ? 1 : 2;
  return format("%.*f %s", decimals, value, kUnits[unit]);
}

std::string plan_table(const LoadedRun& run, Device device, const MemorySpace& space) {
  const MemoryPlan plan = plan_memory(run, device);
  const int64_t total = plan.total();
  const RunSize size = run_size(run.config);
  std::string table =
      format("%-46s %10s %7s %12s  %s\n", "item", "memory", "share", ("per " + size.unit).c_str(), "what it is");
  for (const MemoryItem& item : plan.items)
    table += format("%-46s %10s %6.1f%% %12s  %s\n", item.name.c_str(), print_bytes(item.bytes).c_str(),
                    100 * static_cast<double>(item.bytes) / static_cast<double>(total),
                    item.bytes_per_unit > 0 ? print_bytes(item.bytes_per_unit).c_str() : "-", item.note.c_str());
  table += format("%-46s %10s\n", "total", print_bytes(total).c_str());
  table += cat("\n", networks_line(run, device, plan.networks), device.name(), ": ", print_bytes(space.free),
               " free of ", print_bytes(space.total), "; ", size.key(), " ", size.value,
               total <= space.free ? " fits" : " does not fit", "\n", advice(run, device, space.free), "\n");
  return table;
}

Json plan_json(const LoadedRun& run, Device device, const MemorySpace& space) {
  const MemoryPlan plan = plan_memory(run, device);
  const RunSize size = run_size(run.config);
  Json items = Json::array();
  for (const MemoryItem& item : plan.items) {
    items.push_back({{"name", item.name},
                     {"bytes", item.bytes},
                     {"bytes_per_" + size.unit, item.bytes_per_unit},
                     {"note", item.note}});
  }
  Json json{{"device", device.name()}, {"precision", print_precision(run, device)}, {size.name, size.value}};
  json["items"] = std::move(items);
  if (plan.networks != MemberNetworks::none) json["member_networks"] = name_of(plan.networks);
  json["total_bytes"] = plan.total();
  json["device_bytes"] = space.total;
  json["free_bytes"] = space.free;
  json["fits"] = plan.total() <= space.free;
  json["largest_" + size.name] = largest_size(run, device, space.free);
  return json;
}

void check_fits(const LoadedRun& run, Device device, const MemorySpace& space) {
  MemoryPlan plan = plan_memory(run, device);
  const int64_t total = plan.total();
  if (total <= space.free) return;
  const size_t named = std::min<size_t>(3, plan.items.size());
  std::partial_sort(plan.items.begin(), plan.items.begin() + static_cast<std::ptrdiff_t>(named), plan.items.end(),
                    [](const MemoryItem& a, const MemoryItem& b) { return a.bytes > b.bytes; });
  std::string largest;
  for (size_t k = 0; k < named; ++k)
    largest += cat(k ? ", " : "", plan.items[k].name, " ", print_bytes(plan.items[k].bytes));
  const RunSize size = run_size(run.config);
  throw InputError(cat(size.key(), ": ", size.value, " needs ", print_bytes(total), " of memory on ", device.name(),
                       ", which has ", print_bytes(space.free), " free of ", print_bytes(space.total),
                       "\n  most of it: ", largest, "\n  ", advice(run, device, space.free)));
}

}  // namespace giga
