#include "kernels/ptx_module.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <numeric>
#include <random>
#include <set>
#include <string_view>

#include "core/error.hpp"
#include "kernels/ptx_operations.hpp"

namespace giga::test {
namespace {

constexpr int kLanes = 32, kPoison = 0xFF;
constexpr uint64_t kUnwritten = 0xFFFFFFFFFFFFFF01;  // in registers: NaNs; a predicate that is true

/// Registers that a thread finds filled.
enum Given : int { kThread, kBlock, kBlockY, kBlockZ, kBlocks, kThreads, kParameter, kLocal, kNGiven };

bool is_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '$' || c == '%'; }

std::string trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\n"), last = text.find_last_not_of(" \t\n");
  return first == std::string_view::npos ? std::string() : std::string(text.substr(first, last - first + 1));
}

/// At `separator`, but not within {} and [].
std::vector<std::string> split(std::string_view text, char separator) {
  std::vector<std::string> parts;
  std::string part;
  int depth = 0;
  for (const char c : text) {
    if (c == '{' || c == '[') ++depth;
    if (c == '}' || c == ']') --depth;
    if (c == separator && depth == 0) {
      parts.push_back(trimmed(part));
      part.clear();
    } else {
      part += c;
    }
  }
  if (!trimmed(part).empty()) parts.push_back(trimmed(part));
  return parts;
}

std::string without_comments(const std::string& text) {
  std::string out;
  for (size_t at = 0; at < text.size();) {
    const size_t comment = std::min(text.find("//", at), text.size());
    out.append(text, at, comment - at);
    at = std::min(text.find('\n', comment), text.size());
  }
  return out;
}

/// Reads the body of a kernel.
class Reader {
 public:
  Reader(PtxKernel& kernel, const std::string& parameter) : kernel_(kernel) {
    for (int given = 0; given < kNGiven; ++given) ++kernel_.n_registers;
    registers_ = {{"%tid.x", kThread},    {"%ctaid.x", kBlock},  {"%ctaid.y", kBlockY},  {"%ctaid.z", kBlockZ},
                  {"%nctaid.x", kBlocks}, {"%ntid.x", kThreads}, {parameter, kParameter}};
  }
  /// Memory that begins at an address; in the shared one 0.
  void add_memory(const std::string& name, uint64_t address) { registers_[name] = constant(address); }

  void read(std::string_view body) {
    for (size_t at = 0; at < body.size();) {
      const char c = body[at];
      if (std::isspace(static_cast<unsigned char>(c)) || c == '{' || c == '}' || c == ';') {
        ++at;
        continue;
      }
      const bool line = body.substr(at).starts_with(".loc") || body.substr(at).starts_with(".file");
      size_t end = at;
      while (end < body.size() && body[end] != (line ? '\n' : ';') && !(body[end] == ':' && is_label(body, at, end)))
        ++end;
      const std::string statement = trimmed(body.substr(at, end - at));
      if (end < body.size() && body[end] == ':' && !line)
        labels_[statement] = kernel_.operations.size();
      else if (c == '.')
        directive(statement);
      else
        instruction(statement);
      at = end + 1;
    }
    for (const auto& [operation, label] : branches_) {
      const auto found = labels_.find(label);
      GIGA_CHECK(found != labels_.end(), "no label ", label);
      *operation = found->second;
    }
  }

 private:
  static bool is_label(std::string_view body, size_t begin, size_t end) {
    return std::all_of(body.begin() + static_cast<std::ptrdiff_t>(begin),
                       body.begin() + static_cast<std::ptrdiff_t>(end), is_name);
  }

  void directive(const std::string& text) {
    if (text.starts_with(".local")) {  // .local .align 16 .b8 name[128]
      GIGA_CHECK(kernel_.local_bytes == 0, "two arrays of a thread's own");
      const size_t bracket = text.find('['), name = text.find_last_of(" \t", bracket) + 1;
      registers_[text.substr(name, bracket - name)] = kLocal;
      kernel_.local_bytes = std::strtoul(text.c_str() + bracket + 1, nullptr, 10);
    } else if (text.starts_with(".reg")) {  // .reg .b32 %r<7>, or .reg .f16 low,high
      for (const std::string& name : split(text.substr(text.find_first_of(" \t", text.find('.', 1))), ','))
        if (const size_t count = name.find('<'); count != std::string::npos)
          prefixes_.insert(name.substr(0, count));
        else
          named(name);
    }
  }

  int named(const std::string& name) {
    const auto [at, is_new] = registers_.try_emplace(name, kernel_.n_registers);
    if (is_new) ++kernel_.n_registers;
    return at->second;
  }
  int constant(uint64_t bits) {
    const auto [at, is_new] = constants_.try_emplace(bits, kernel_.n_registers);
    if (is_new) kernel_.constants.emplace_back(kernel_.n_registers++, bits);
    return at->second;
  }

  int value(const std::string& text) {
    if (text.starts_with("0f") || text.starts_with("0F") || text.starts_with("0d") || text.starts_with("0D"))
      return constant(std::strtoull(text.c_str() + 2, nullptr, 16));
    if (std::isdigit(static_cast<unsigned char>(text[0])) || text[0] == '-')
      return constant(text[0] == '-' ? static_cast<uint64_t>(std::strtoll(text.c_str(), nullptr, 0))
                                     : std::strtoull(text.c_str(), nullptr, 0));
    const auto found = registers_.find(text);
    if (found != registers_.end()) return found->second;
    GIGA_CHECK(prefixes_.contains(text.substr(0, text.find_first_of("0123456789"))), "no register or symbol ", text);
    return named(text);
  }

  PtxOperand operand(const std::string& text) {
    PtxOperand out;
    if (text[0] == '{') {
      for (const std::string& part : split(text.substr(1, text.size() - 2), ',')) out.registers.push_back(value(part));
    } else if (text[0] == '[') {
      const std::string inside = text.substr(1, text.size() - 2);
      const size_t plus = inside.find('+');
      out.registers = {value(trimmed(inside.substr(0, plus)))};
      if (plus != std::string::npos) out.offset = std::strtoll(inside.c_str() + plus + 1, nullptr, 10);
    } else {
      for (const std::string& part : split(text, '|')) out.registers.push_back(value(part));
    }
    return out;
  }

  void instruction(std::string text) {
    int predicate = -1;
    bool negated = false;
    const std::string whole = text;
    if (text[0] == '@') {
      negated = text[1] == '!';
      const size_t begin = negated ? 2 : 1, end = text.find_first_of(" \t", begin);
      predicate = value(text.substr(begin, end - begin));
      text = trimmed(text.substr(end));
    }
    const size_t end = std::min(text.find_first_of(" \t"), text.size());
    std::vector<std::string> words;
    for (std::string part : split(text.substr(0, end), '.')) {
      const size_t space = part.find("::");  // ld.shared::cta
      words.push_back(part.substr(0, space));
    }
    const std::vector<std::string> operands = split(text.substr(end), ',');
    if (words[0] == "bra") {
      auto target = std::make_shared<size_t>(0);
      branches_.emplace_back(target, operands.at(0));
      return add(whole, predicate, negated, [target](PtxThread& t) { t.next = *target; });
    }
    if (words[0] == "ret" || words[0] == "exit")
      return add(whole, predicate, negated, [](PtxThread& t) { t.state = PtxThread::State::done; });
    std::vector<PtxOperand> read;
    for (const std::string& part : operands) read.push_back(operand(part));
    add(whole, predicate, negated, ptx_operation(words, read));
    if (auto result = ptx_result(words, read)) add(whole, predicate, negated, std::move(result));
  }

  void add(const std::string& line, int predicate, bool negated, PtxOperation operation) {
    kernel_.lines.push_back(line);
    if (predicate < 0) return kernel_.operations.push_back(std::move(operation));
    kernel_.operations.push_back([=, operation = std::move(operation)](PtxThread& t) {
      if (t.get<bool>(predicate) != negated) operation(t);
    });
  }

  PtxKernel& kernel_;
  std::map<std::string, int> registers_;
  std::set<std::string> prefixes_;  // of registers that have been declared: %rd
  std::map<uint64_t, int> constants_;
  std::map<std::string, size_t> labels_;
  std::vector<std::pair<std::shared_ptr<size_t>, std::string>> branches_;
};

/// Behind the brace that ends what begins at text[at].
size_t end_of_body(const std::string& text, size_t at) {
  int depth = 0;
  do {
    GIGA_CHECK(at < text.size(), "a kernel without an end");
    depth += text[at] == '{' ? 1 : text[at] == '}' ? -1 : 0;
    ++at;
  } while (depth > 0);
  return at;
}

std::string name_before(const std::string& text, size_t bracket) {
  const size_t first = text.find_last_of(" \t\n", bracket) + 1;
  return text.substr(first, bracket - first);
}

/// Runs a warp until all its lanes are at the barrier of the block or done.
void advance(const PtxKernel& kernel, PtxThread* lanes, const std::vector<int>& order) {
  for (bool goes_on = true; goes_on;) {
    for (const int lane : order) {
      PtxThread& t = lanes[lane];
      while (t.state == PtxThread::State::runs) {
        const size_t at = t.next++;
        GIGA_CHECK(at < kernel.operations.size(), "a thread has run out of ", kernel.name);
        try {
          kernel.operations[at](t);
        } catch (const std::exception& e) {
          throw Error(cat(e.what(), "; ", kernel.lines[at]));
        }
      }
    }
    const auto asks = [](const PtxThread& t) { return t.state == PtxThread::State::at_warp; };
    goes_on = std::any_of(lanes, lanes + kLanes, asks);
    if (!goes_on) return;
    do_warp_work(lanes);
    for (int lane = 0; lane < kLanes; ++lane) lanes[lane].state = PtxThread::State::runs;
  }
}

}  // namespace

PtxModule::PtxModule(const std::string& commented) {
  const std::string text = without_comments(commented);
  std::vector<std::string> shared;
  const std::string extern_shared = ".extern .shared";
  for (size_t at = text.find(extern_shared); at != std::string::npos; at = text.find(extern_shared, at + 1))
    shared.push_back(name_before(text, text.find('[', at)));
  // .global .align 4 .b8 name[3] = {65, 144, 67};
  for (size_t at = text.find("] = {"); at != std::string::npos; at = text.find("] = {", at + 1)) {
    auto& bytes = tables_[name_before(text, text.rfind('[', at))];
    bytes = std::make_unique<std::vector<uint8_t>>();
    for (const std::string& byte : split(text.substr(at + 5, text.find('}', at) - at - 5), ','))
      bytes->push_back(static_cast<uint8_t>(std::strtoul(byte.c_str(), nullptr, 0)));
  }
  for (size_t at = text.find(".entry"); at != std::string::npos; at = text.find(".entry", at)) {
    const size_t parameters = text.find('(', at), body = text.find('{', parameters), end = end_of_body(text, body);
    PtxKernel& kernel = kernels_.emplace_back();
    kernel.name = name_before(text, parameters);
    // The only parameter: .param .align 8 .b8 name[256], or .param .u64 name
    const std::string parameter = trimmed(text.substr(parameters + 1, text.find(')', parameters) - parameters - 1));
    Reader reader(kernel, name_before(parameter, std::min(parameter.find('['), parameter.size())));
    for (const std::string& name : shared) reader.add_memory(name, 0);
    for (const auto& [name, bytes] : tables_) reader.add_memory(name, reinterpret_cast<uint64_t>(bytes->data()));
    reader.read(std::string_view(text).substr(body, end - body));
    at = end;
  }
}

const PtxKernel& PtxModule::find(const std::vector<std::string>& words) const {
  const PtxKernel* found = nullptr;
  for (const PtxKernel& kernel : kernels_) {
    const bool fits = std::all_of(words.begin(), words.end(),
                                  [&](const std::string& word) { return kernel.name.find(word) != std::string::npos; });
    if (!fits) continue;
    GIGA_CHECK(!found, "two kernels with ", words.front());
    found = &kernel;
  }
  GIGA_CHECK(found, "no kernel with ", words.front());
  return *found;
}

void PtxModule::run(const PtxKernel& kernel, const PtxGrid& grid, int threads, size_t shared_bytes,
                    const void* parameter, size_t parameter_bytes, ThreadOrder order) {
  GIGA_CHECK(threads % kLanes == 0, threads, " threads are no whole warps");
  struct alignas(128) Line {
    char bytes[128];
  };
  std::vector<Line> shared(shared_bytes / sizeof(Line) + 1);
  std::vector<char> handed_over(static_cast<const char*>(parameter),
                                static_cast<const char*>(parameter) + parameter_bytes);
  std::mt19937 dice(1);
  const auto in_order = [&](int n) {
    std::vector<int> numbers(static_cast<size_t>(n));
    std::iota(numbers.begin(), numbers.end(), 0);
    if (order == ThreadOrder::backward) std::reverse(numbers.begin(), numbers.end());
    if (order == ThreadOrder::shuffled) std::shuffle(numbers.begin(), numbers.end(), dice);
    return numbers;
  };
  std::vector<PtxThread> all(static_cast<size_t>(threads));
  for (int number = 0; number < grid.x * grid.y * grid.z; ++number) {
    std::memset(shared.data(), kPoison, shared.size() * sizeof(Line));
    for (int thread = 0; thread < threads; ++thread) {
      PtxThread& t = all[static_cast<size_t>(thread)];
      t.registers.assign(static_cast<size_t>(kernel.n_registers), kUnwritten);
      for (const auto& [at, bits] : kernel.constants) t.registers[static_cast<size_t>(at)] = bits;
      t.local.assign(kernel.local_bytes, static_cast<char>(kPoison));
      t.set<int>(kThread, thread);
      t.set<int>(kBlock, number % grid.x);
      t.set<int>(kBlockY, number / grid.x % grid.y);
      t.set<int>(kBlockZ, number / grid.x / grid.y);
      t.set<int>(kBlocks, grid.x);
      t.set<int>(kThreads, threads);
      t.set<const char*>(kParameter, handed_over.data());
      t.set<char*>(kLocal, t.local.data());
      t.shared = shared.data()->bytes;
      t.shared_bytes = shared_bytes;
      t.next = 0;
      t.state = PtxThread::State::runs;
      t.copies.clear();
      t.copies_at_once = order == ThreadOrder::backward;
    }
    const auto count = [&](PtxThread::State state) {
      return std::count_if(all.begin(), all.end(), [&](const PtxThread& t) { return t.state == state; });
    };
    while (count(PtxThread::State::done) < threads) {
      for (const int warp : in_order(threads / kLanes))
        advance(kernel, all.data() + static_cast<ptrdiff_t>(warp) * kLanes, in_order(kLanes));
      const auto waiting = count(PtxThread::State::at_barrier);
      GIGA_CHECK(waiting == 0 || waiting == threads, waiting, " of ", threads,
                 " threads are at a barrier of the block");
      if (waiting > 0)
        for (PtxThread& t : all) t.state = PtxThread::State::runs;
    }
  }
}

}  // namespace giga::test
