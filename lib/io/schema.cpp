// From field lists to JSON schema.
#include "io/schema.hpp"

#include <cmath>
#include <limits>

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
  if (std::isfinite(allowed.lo)) schema.set(allowed.lo_open ? "exclusiveMinimum" : "minimum", number(allowed.lo));
  if (std::isfinite(allowed.hi)) schema.set(allowed.hi_open ? "exclusiveMaximum" : "maximum", number(allowed.hi));
}

Json type_schema(const char* type) { return Json::object().set("type", type); }

Json any_of(Json alternatives) { return Json::object().set("anyOf", std::move(alternatives)); }

Json number_schema(const ValueShape& shape) {
  Json as_number = type_schema(shape.kind == ValueShape::Kind::integer ? "integer" : "number");
  set_limits(as_number, shape.allowed);
  Json as_text = type_schema("string");
  as_text.set("pattern", kNumberText);
  return any_of(Json::array().push(std::move(as_number)).push(std::move(as_text)));
}

Json value_schema(const ValueShape& shape) {
  switch (shape.kind) {
    case ValueShape::Kind::boolean:
      return type_schema("boolean");
    case ValueShape::Kind::integer:
    case ValueShape::Kind::real:
      return number_schema(shape);
    case ValueShape::Kind::text:
      if (!shape.allowed.choices.empty()) return Json::object().set("enum", Json::array(shape.allowed.choices));
      return type_schema("string");
    case ValueShape::Kind::duration:
      return type_schema("string").set("pattern", kDurationPattern);
    case ValueShape::Kind::none:
      return Json::object().set("enum", Json::array().push("none").push(Json()));
    case ValueShape::Kind::list: {
      Json list = type_schema("array");
      list.set("items", value_schema(shape.parts.at(0)));
      if (shape.allowed.min_items > 0) list.set("minItems", shape.allowed.min_items);
      if (shape.allowed.max_items != std::numeric_limits<size_t>::max()) list.set("maxItems", shape.allowed.max_items);
      return list;
    }
    case ValueShape::Kind::either:
      break;
  }
  Json alternatives = Json::array();
  for (const ValueShape& part : shape.parts) alternatives.push(value_schema(part));
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
      schema = type_schema("array").set("items", map_schema(field.example()));
      break;
    case FieldShape::table:
      schema = type_schema("object").set("additionalProperties", map_schema(field.example()));
      break;
    case FieldShape::tree:
      schema = field.example ? map_schema(field.example()) : type_schema("object");
      break;
  }
  if (!field.doc.empty()) schema.set("description", field.doc);
  if (field.print) schema.set("default", json_of(parse_yaml_text(field.print(), field.name).root));
  return schema;
}

Json map_schema(const FieldList& fields, Json schema) {
  Json properties = Json::object();
  for (const Field& field : fields.fields()) properties.set(field.name, field_schema(field));
  schema.set("type", "object").set("properties", std::move(properties)).set("additionalProperties", false);
  return schema;
}

}  // namespace

Json json_schema(const FieldList& defaults, const std::string& title) {
  Json head = Json::object();
  head.set("$schema", "http://json-schema.org/draft-07/schema#").set("title", title);
  return map_schema(defaults, std::move(head));
}

}  // namespace giga
