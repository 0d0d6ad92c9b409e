// The module of a page: what JavaScript calls. Compiled for WebAssembly alone (cmake/Web.cmake).
#include <cstdlib>
#include <memory>
#include <string_view>
#include <typeinfo>
#include <vector>

#include "math/distributions.hpp"
#include "math/forget_episodes.hpp"
#include "play/session.hpp"
#include "play/spec_bytes.hpp"
#include "scripted/actions.hpp"

#define PLAY_EXPORT(name) extern "C" __attribute__((export_name(#name)))

/// Of the page: it throws an exception of its own with the text.
extern "C" __attribute__((import_module("page"), import_name("fail"))) void page_fail(const char* text, size_t size);

// C++ exceptions: nothing here catches any, so all become the page's.
extern "C" void* __cxa_allocate_exception(size_t size) noexcept { return std::malloc(size); }
extern "C" void __cxa_free_exception(void*) noexcept {}
extern "C" [[noreturn]] void __cxa_throw(void* exception, void* type, void (*)(void*)) {
  const auto& kind = *static_cast<const std::type_info*>(type);
  std::string_view text = "the module failed";
  if (kind == typeid(giga::Error) || kind == typeid(giga::InputError))
    text = static_cast<const giga::Error*>(exception)->what();
  page_fail(text.data(), text.size());
  std::abort();
}

namespace giga {

// There is no GPU in a page.
template <class Op>
void launch_elementwise(const Op&, int64_t, int, void*) {
  throw Error("no GPU in a page");
}
template void launch_elementwise(const SampleCategorical&, int64_t, int, void*);
template void launch_elementwise(const SampleGaussian&, int64_t, int, void*);
template void launch_elementwise(const ScriptedActions&, int64_t, int, void*);
template void launch_elementwise(const BlindActions&, int64_t, int, void*);
template void launch_elementwise(const ForgetEpisodes&, int64_t, int, void*);

namespace {

/// What the page has handed over.
struct Page {
  SimSpec spec;
  std::vector<std::shared_ptr<const PlainNetwork>> networks;
  std::unique_ptr<PlaySession> session;
};
/// A module is one page's, and its functions have no other place to find it.
Page& page() {
  static Page page;
  return page;
}

/// `who`: a network by its number, or a script (script_of_network).
PlayTeam team_of(int32_t who) {
  if (who < 0) return {script_of_network(who)};
  GIGA_CHECK(static_cast<size_t>(who) < page().networks.size(), "network ", who);
  return {Scripted::noop, page().networks[static_cast<size_t>(who)]};
}

}  // namespace

PLAY_EXPORT(play_allocate) void* play_allocate(size_t size) { return std::malloc(size); }
PLAY_EXPORT(play_release) void play_release(void* bytes) { std::free(bytes); }

/// Sets the scenario that is played from now on.
PLAY_EXPORT(play_scenario) void play_scenario(const char* bytes, size_t size) {
  page().session.reset();
  page().spec = read_spec({bytes, size});
}
/// Adds a network and returns its number.
PLAY_EXPORT(play_network) int32_t play_network(const char* bytes, size_t size) {
  page().networks.push_back(std::make_shared<const PlainNetwork>(read_network({bytes, size})));
  return static_cast<int32_t>(page().networks.size()) - 1;
}
PLAY_EXPORT(play_start) void play_start(uint64_t seed, int32_t who_0, int32_t who_1, int32_t person) {
  page().session.reset();
  page().session = std::make_unique<PlaySession>(page().spec, seed, team_of(who_0), team_of(who_1), person);
}
/// Returns whether the game is over.
PLAY_EXPORT(play_step) int32_t play_step(float heading, float dive, float throttle) {
  page().session->step({heading, dive, throttle});
  return page().session->over() ? 1 : 0;
}
PLAY_EXPORT(play_actions) const void* play_actions(int32_t team) { return page().session->actions(team); }

/// Fields of the state by their numbers in its list: where they lie, and their names, which end with a zero.
PLAY_EXPORT(play_field) const void* play_field(int32_t number) {
  const void* found = nullptr;
  int32_t k = 0;
  for_each_field([&](auto, auto member) {
    if (k++ == number) found = page().session->state().view().*member;
  });
  return found;
}
PLAY_EXPORT(play_field_name) const char* play_field_name(int32_t number) {
  const char* name = nullptr;
  int32_t k = 0;
  for_each_field([&](auto field, auto) {
    if (k++ == number) name = field.name;
  });
  return name;
}
/// The same of the columns of the field `stats`.
PLAY_EXPORT(play_stat_name) const char* play_stat_name(int32_t number) {
  return number < kNEpisodeStats ? kEpisodeStatNames[number] : nullptr;
}

PLAY_EXPORT(play_hash) uint64_t play_hash(int32_t steps) { return states_hash(page().spec, steps); }

}  // namespace giga
