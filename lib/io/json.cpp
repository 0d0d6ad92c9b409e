// JSON values: what was read, and printing.
#include "io/json.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iostream>

#include "config/document.hpp"
#include "core/error.hpp"
#include "core/utf8.hpp"
#include "io/files.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

/// In quotes, with escapes. Bytes that are not UTF-8 (a file name may have them) become the replacement character.
std::string quoted(const std::string& text) {
  static constexpr char kHex[] = "0123456789abcdef";
  std::string out = "\"";
  for (size_t at = 0; at < text.size();) {
    const auto c = static_cast<unsigned char>(text[at]);
    if (c < 0x80) {
      if (c == '"' || c == '\\') {
        out += {'\\', static_cast<char>(c)};
      } else if (c == '\n') {
        out += "\\n";
      } else if (c == '\t') {
        out += "\\t";
      } else if (c < 0x20 || c == 0x7f) {
        out += {'\\', 'u', '0', '0', kHex[c >> 4], kHex[c & 15]};
      } else {
        out += static_cast<char>(c);
      }
      ++at;
      continue;
    }
    const size_t length = utf8_length(text, at);
    out += length ? text.substr(at, length) : "\xEF\xBF\xBD";
    at += length ? length : 1;
  }
  return out + '"';
}

}  // namespace

Json Json::object() {
  Json json;
  json.value_ = Object{};
  return json;
}

Json Json::array() {
  Json json;
  json.value_ = Array{};
  return json;
}

Json& Json::set(std::string key, Json value) {
  Object* members = std::get_if<Object>(&value_);
  GIGA_CHECK(members, "a member '", key, "' for what is no object");
  members->emplace_back(std::move(key), std::move(value));
  return *this;
}

Json& Json::push(Json value) {
  Array* items = std::get_if<Array>(&value_);
  GIGA_CHECK(items, "an item for what is no array");
  items->push_back(std::move(value));
  return *this;
}

bool Json::is_container() const {
  return std::holds_alternative<Array>(value_) || std::holds_alternative<Object>(value_);
}

void Json::print(std::string& out, int depth) const {
  const auto new_line = [&out](int indent) { out.append("\n").append(2 * static_cast<size_t>(indent), ' '); };
  if (const bool* b = std::get_if<bool>(&value_)) {
    out += *b ? "true" : "false";
  } else if (const Integer* n = std::get_if<Integer>(&value_)) {
    out += n->negative ? std::to_string(static_cast<int64_t>(n->bits)) : std::to_string(n->bits);
  } else if (const double* d = std::get_if<double>(&value_)) {
    out += std::isfinite(*d) ? print_number(*d) : "null";
  } else if (const std::string* s = std::get_if<std::string>(&value_)) {
    out += quoted(*s);
  } else if (const Array* items = std::get_if<Array>(&value_)) {
    const bool one_line = std::none_of(items->begin(), items->end(), [](const Json& j) { return j.is_container(); });
    out += '[';
    for (size_t k = 0; k < items->size(); ++k) {
      if (k) out += one_line ? ", " : ",";
      if (!one_line) new_line(depth + 1);
      (*items)[k].print(out, depth + 1);
    }
    if (!one_line) new_line(depth);
    out += ']';
  } else if (const Object* members = std::get_if<Object>(&value_)) {
    out += '{';
    for (size_t k = 0; k < members->size(); ++k) {
      if (k) out += ',';
      new_line(depth + 1);
      out += quoted((*members)[k].first) + ": ";
      (*members)[k].second.print(out, depth + 1);
    }
    if (!members->empty()) new_line(depth);
    out += '}';
  } else {
    out += "null";
  }
}

std::string Json::text() const {
  std::string out;
  print(out, 0);
  return out;
}

Json json_of(const Node& node) {
  if (node.is_sequence()) {
    Json list = Json::array();
    for (const Node& item : node.items) list.push(json_of(item));
    return list;
  }
  if (node.is_map()) {
    Json map = Json::object();
    for (const Node::Entry& entry : node.entries) map.set(entry.key, json_of(entry.value));
    return map;
  }
  const std::string& text = node.text;
  if (node.quoted) return text;
  if (node.is_null() || text == "null") return {};
  if (text == "true" || text == "false") return text == "true";
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  const bool is_number = error == std::errc{} && end == text.data() + text.size() && std::isfinite(number);
  return is_number ? Json(number) : Json(text);
}

void write_json(const Json& json, const std::string& destination) {
  const std::string text = json.text() + "\n";
  if (destination != "-") return write_file(destination, text);
  std::cout << text << std::flush;
  if (!std::cout) throw Error("cannot write to the standard output");
}

}  // namespace giga
