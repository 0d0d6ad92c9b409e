// JSON values: what was read, and printing.
#include "io/json.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "config/document.hpp"
#include "io/files.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

/// Bytes that are not UTF-8 (a file name may have them) become the replacement character.
std::string scalar_text(const Json& json) {
  const bool is_finite = json.is_number_float() && std::isfinite(json.get<double>());
  return is_finite ? print_number(json.get<double>()) : json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void print_json(const Json& json, int depth, std::string& out) {
  if (!json.is_structured()) {
    out += scalar_text(json);
    return;
  }
  const bool is_object = json.is_object();
  const bool one_line =
      json.empty() || (!is_object && std::none_of(json.begin(), json.end(), [](auto& j) { return j.is_structured(); }));
  const auto new_line = [&](int indent) {
    if (!one_line) out.append("\n").append(2 * static_cast<size_t>(indent), ' ');
  };
  out += is_object ? '{' : '[';
  for (auto item = json.begin(); item != json.end(); ++item) {
    if (item != json.begin()) out += one_line ? ", " : ",";
    new_line(depth + 1);
    if (is_object) out += scalar_text(item.key()) + ": ";
    print_json(*item, depth + 1, out);
  }
  new_line(depth);
  out += is_object ? '}' : ']';
}

}  // namespace

std::string json_text(const Json& json) {
  std::string out;
  print_json(json, 0, out);
  return out;
}

Json json_of(const Node& node) {
  if (node.is_sequence()) {
    Json list = Json::array();
    for (const Node& item : node.items) list.push_back(json_of(item));
    return list;
  }
  if (node.is_map()) {
    Json map = Json::object();
    for (const Node::Entry& entry : node.entries) map[entry.key] = json_of(entry.value);
    return map;
  }
  const std::string& text = node.text;
  if (node.quoted) return text;
  if (node.is_null() || text == "null") return {};
  if (text == "true" || text == "false") return text == "true";
  const auto read = [&text](auto& number) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    return error == std::errc{} && end == text.data() + text.size();
  };
  int64_t whole = 0;
  uint64_t large = 0;
  double number = 0;
  if (read(whole)) return whole;  // a double has no room for all of its digits
  if (read(large)) return large;
  return read(number) && std::isfinite(number) ? Json(number) : Json(text);
}

void write_json(const Json& json, const std::string& destination) {
  write_or_print(destination, json_text(json) + "\n");
}

}  // namespace giga
