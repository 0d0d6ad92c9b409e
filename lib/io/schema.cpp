// From field lists to JSON schema.
#include "io/schema.hpp"

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "config/duration.hpp"

namespace giga {
namespace {

// Numbers that we read and that some YAML readers take for texts: 300_000_000 (YAML 1.2), 3e8 (YAML 1.1).
constexpr const char* kNumberText =
    "^[-+]?[0-9]+(_[0-9]+)+([.][0-9]*)?([eE][-+]?[0-9]+)?$|^[-+]?([0-9]+[.]?[0-9]*|[.][0-9]+)[eE][-+]?[0-9]+$";

/// A whole number as an integer of JSON, where that is exact.
Json number(double value) {
  if (value == std::floor(value) && std::abs(value) < 9e15) return static_cast<int64_t>(value);
  return value;
}

void set_limits(Json& schema, const Allowed& allowed) {
  if (std::isfinite(allowed.lo)) schema[allowed.lo_open ? "exclusiveMinimum" : "minimum"] = number(allowed.lo);
  if (std::isfinite(allowed.hi)) schema[allowed.hi_open ? "exclusiveMaximum" : "maximum"] = number(allowed.hi);
}

Json type_schema(const char* type) { return {{"type", type}}; }

Json any_of(Json alternatives) { return {{"anyOf", std::move(alternatives)}}; }

Json number_schema(const ValueShape& shape) {
  Json as_number = type_schema(shape.kind == ValueShape::Kind::integer ? "integer" : "number");
  set_limits(as_number, shape.allowed);
  return any_of(Json::array({std::move(as_number), {{"type", "string"}, {"pattern", kNumberText}}}));
}

Json value_schema(const ValueShape& shape) {
  switch (shape.kind) {
    case ValueShape::Kind::boolean:
      return type_schema("boolean");
    case ValueShape::Kind::integer:
    case ValueShape::Kind::real:
      return number_schema(shape);
    case ValueShape::Kind::text:
      if (!shape.allowed.choices.empty()) return {{"enum", shape.allowed.choices}};
      if (!shape.allowed.pattern.empty()) return {{"type", "string"}, {"pattern", shape.allowed.pattern}};
      return type_schema("string");
    case ValueShape::Kind::duration:
      return {{"type", "string"}, {"pattern", kDurationPattern}};
    case ValueShape::Kind::none:
      return {{"enum", {"none", nullptr}}};
    case ValueShape::Kind::list: {
      Json list{{"type", "array"}, {"items", value_schema(shape.parts.at(0))}};
      if (shape.allowed.min_items > 0) list["minItems"] = shape.allowed.min_items;
      if (shape.allowed.max_items != std::numeric_limits<size_t>::max()) list["maxItems"] = shape.allowed.max_items;
      return list;
    }
    case ValueShape::Kind::either:
      break;
  }
  Json alternatives = Json::array();
  for (const ValueShape& part : shape.parts) alternatives.push_back(value_schema(part));
  return any_of(std::move(alternatives));
}

Json map_schema(const FieldList& fields, Json schema = Json::object());

Json field_schema(const Field& field) {
  Json schema;
  switch (field.shape) {
    case FieldShape::value:
      schema = value_schema(field.value);
      break;
    case FieldShape::group:
      schema = map_schema(field.members);
      break;
    case FieldShape::list:
      schema = {{"type", "array"}, {"items", map_schema(field.example())}};
      break;
    case FieldShape::table:
      schema = {{"type", "object"}, {"additionalProperties", map_schema(field.example())}};
      break;
    case FieldShape::tree:
      schema = field.example ? map_schema(field.example()) : type_schema("object");
      break;
  }
  if (!field.doc.empty()) schema["description"] = field.doc;
  if (field.print) schema["default"] = json_of(parse_yaml_text(field.print(), field.name).root);
  return schema;
}

Json map_schema(const FieldList& fields, Json schema) {
  Json properties = Json::object();
  for (const Field& field : fields.fields()) properties[field.name] = field_schema(field);
  schema["type"] = "object";
  schema["properties"] = std::move(properties);
  schema["additionalProperties"] = false;
  return schema;
}

}  // namespace

Json json_schema(const FieldList& defaults, const std::string& title) {
  return map_schema(defaults, {{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", title}});
}

}  // namespace giga
