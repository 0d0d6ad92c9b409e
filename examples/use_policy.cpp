// Uses an exported policy from C++, with nothing but the header of nlohmann/json (Debian: nlohmann-json3-dev):
//   c++ -std=c++20 -O2 examples/use_policy.cpp -o use_policy && ./use_policy FOLDER
// FOLDER is what `gigastep export RUN --team 0 --format safetensors --view input --out FOLDER` wrote. Describes a
// situation by the names in the manifest, and prints the most likely action and the first outputs. For networks of tanh
// layers without memory, which is the default; the folder's act.py shows what the others compute, and the egocentric
// view of policies that were exported without --view input. A graph of --format onnx computes all that, and ONNX
// Runtime runs it in C++.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

using Json = nlohmann::json;
using Vector = std::vector<float>;

std::string read_file(const std::string& name) {
  std::ifstream file(name, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + name);
  return {std::istreambuf_iterator<char>(file), {}};
}

class Policy {
 public:
  explicit Policy(const std::string& folder) : manifest(Json::parse(read_file(folder + "/manifest.json"))) {
    // A safetensors file: the length of the header in 8 bytes, the header in JSON, the numbers.
    bytes_ = read_file(folder + "/" + manifest.at("file").get<std::string>());
    uint64_t length = 0;
    std::memcpy(&length, bytes_.data(), sizeof length);
    header_ = Json::parse(bytes_.substr(sizeof length, length));
    numbers_ = sizeof length + length;
    const Json& architecture = manifest.at("architecture");
    n_layers_ = architecture.at("hidden").size() + 1;
    if (architecture.at("activation") != "tanh" || architecture.at("layer_norm") == true ||
        architecture.at("normalizes_observations") == true || architecture.at("memory") != "none")
      throw std::runtime_error("this example computes tanh layers alone");
    if (manifest.contains("egocentric_view_inside"))
      throw std::runtime_error("this example does not compute the egocentric view: export with --view input");
  }

  /// Logits [27], or the means [3] of continuous actions before their tanh.
  Vector operator()(Vector x) const {
    for (size_t k = 0; k < n_layers_; ++k) {
      const std::string name = "layers." + std::to_string(k) + ".";
      const Vector weight = tensor(name + "weight"), bias = tensor(name + "bias");  // [outputs, inputs], [outputs]
      Vector y = bias;
      for (size_t row = 0; row < y.size(); ++row)
        for (size_t column = 0; column < x.size(); ++column) y[row] += weight[row * x.size() + column] * x[column];
      if (k + 1 < n_layers_)
        for (float& number : y) number = std::tanh(number);
      x = y;
    }
    return x;
  }

  const Json manifest;

 private:
  Vector tensor(const std::string& name) const {
    const Json& place = header_.at(name).at("data_offsets");
    const size_t begin = numbers_ + place.at(0).get<size_t>(), end = numbers_ + place.at(1).get<size_t>();
    if (header_.at(name).at("dtype") != "F32" || end > bytes_.size()) throw std::runtime_error("damaged: " + name);
    Vector values((end - begin) / sizeof(float));
    std::memcpy(values.data(), bytes_.data() + begin, end - begin);
    return values;
  }

  std::string bytes_;
  Json header_;
  size_t numbers_ = 0, n_layers_ = 0;
};

/// Sets a feature of the first item of a block; blocks that are not there are passed over.
void set_number(Vector& obs, const Json& manifest, const std::string& block, const std::string& feature, float value) {
  for (const Json& b : manifest.at("observation").at("blocks"))
    for (const Json& f : b.at("features"))
      if (b.at("name") == block && f.at("name") == feature) obs.at(f.at("slice").at(0).get<size_t>()) = value;
}

int main(int argc, char** argv) try {
  if (argc != 2) throw std::runtime_error("usage: use_policy FOLDER");
  const Policy policy(argv[1]);
  const Json& action = policy.manifest.at("action");

  // The agent is in the middle of the map and flies along x; one opponent is ahead of it, to its left.
  Vector obs(policy.manifest.at("observation").at("size").get<size_t>());
  const std::pair<const char*, float> self[] = {{"seen", 1}, {"same_team", 1}, {"x", 0.5},    {"y", 0.5},
                                                {"z", 0.5},  {"speed", 0.15},  {"health", 1}, {"sprite", 1}};
  for (const auto& [feature, value] : self) set_number(obs, policy.manifest, "self", feature, value);
  const std::pair<const char*, float> neighbor[] = {{"seen", 1},   {"x", 0.08},  {"y", 0.06}, {"heading", 3.1415927f},
                                                    {"health", 1}, {"sprite", 1}};
  for (const auto& [feature, value] : neighbor) set_number(obs, policy.manifest, "neighbors", feature, value);
  const std::pair<const char*, float> opponent[] = {
      {"nearness", 0.5}, {"ahead", 0.8}, {"left", 0.6}, {"course_ahead", -1}, {"health", 1}};
  for (const auto& [feature, value] : opponent)
    set_number(obs, policy.manifest, "egocentric_opponents", feature, value);

  const Vector head = policy(obs);
  if (action.at("kind") == "discrete") {
    const auto best = std::max_element(head.begin(), head.end()) - head.begin();
    std::printf("action: %s\n", action.at("table").at(static_cast<size_t>(best)).dump().c_str());
  } else {
    std::printf("action: %.4f %.4f %.4f\n", std::tanh(head[0]), std::tanh(head[1]), std::tanh(head[2]));
  }
  std::printf("head: %.4f %.4f %.4f\n", head.at(0), head.at(1), head.at(2));
} catch (const std::exception& error) {
  std::fprintf(stderr, "use_policy: %s\n", error.what());
  return 1;
}
