// From the tree of a config to a flat list.
#include "io/hyper_parameters.hpp"

#include "config/fields.hpp"

namespace giga {
namespace {

/// Reads as config files are read; false where it is another kind of value.
template <class T>
bool reads_as(const Node& node, T& value) {
  Errors ignored;
  return FieldCodec<T>::read(node, value, anything(), {"", ignored});
}

HyperParameter hyper_parameter(const Node& node) {
  double number = 0;
  if (reads_as(node, number)) return number;
  bool flag = false;
  if (reads_as(node, flag)) return flag;
  return node.is_scalar() ? node.text : print_node(node);
}

void add(const std::string& path, const Node& node, HyperParameters& out) {
  if (!node.is_map()) {
    out.emplace_back(path, hyper_parameter(node));
    return;
  }
  for (const Node::Entry& entry : node.entries) add(path + "." + entry.key, entry.value, out);
}

}  // namespace

HyperParameters flat_hyper_parameters(const Node& root) {
  HyperParameters all;
  for (const Node::Entry& entry : root.entries) add(entry.key, entry.value, all);
  return all;
}

}  // namespace giga
