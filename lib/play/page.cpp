#include "play/page.hpp"

#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <system_error>

#include "chart/markup.hpp"
#include "chart/page_template.hpp"
#include "config/document.hpp"
#include "core/error.hpp"
#include "io/deflate.hpp"
#include "io/files.hpp"
#include "io/json.hpp"
#include "play/assets.hpp"
#include "play/session.hpp"
#include "play/spec_bytes.hpp"
#include "watch/assets.hpp"
#include "watch/page.hpp"

namespace giga {
namespace {
namespace fs = std::filesystem;

constexpr int kSelfCheck = 100;  // steps

std::string module_bytes() {
  if (!has_play_module()) throw InputError(kNoPlayModule);
  return embedded_file(play_asset, "play.wasm");
}

std::string packed(std::string_view raw) { return base64(deflated(raw)); }

std::string digits_of(uint64_t hash) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

Json frame_json(const Replay& frame) { return json_of(parse_yaml_text(print_yaml(frame, false), "frame").root); }

Json data_of(const PlayPage& page) {
  Json data;
  data["about"] = page.about;
  data["self_check"] = kSelfCheck;
  data["scenarios"] = Json::array();
  for (const PageScenario& scenario : page.scenarios) {
    const SimSpec played = scenario.spec.with_time_limit();
    data["scenarios"].push_back({{"name", scenario.name},
                                 {"spec", packed(spec_bytes(scenario.spec))},
                                 {"frame", frame_json(scenario.frame)},
                                 {"most_states", played.params.max_episode_length + 1},
                                 {"waypoint_unseen_time", played.params.waypoint_unseen_time},
                                 {"dead_collect", played.params.original()},
                                 {"hash", digits_of(states_hash(scenario.spec, kSelfCheck))},
                                 {"players", scenario.players}});
  }
  data["players"] = Json::array();
  for (const PagePlayer& player : page.players) data["players"].push_back({{"name", player.name}, {"who", player.who}});
  data["mates"] = page.mates;
  data["opponents"] = page.opponents;
  data["networks"] = Json::array();
  for (const PlainNetwork& network : page.networks) data["networks"].push_back(packed(network_bytes(network)));
  return data;
}

/// Names of folders need not be UTF-8; what is not is shown as a replacement character.
std::string text_of(const Json& data) { return data.dump(-1, ' ', false, Json::error_handler_t::replace); }

/// As a script element may hold it: JSON reads < the same way.
std::string inside_script(const Json& data) {
  std::string text;
  for (const char letter : text_of(data)) letter == '<' ? text += "\\u003c" : text += letter;
  return text;
}

std::string style() { return embedded_file(watch_asset, "page.css") + embedded_file(play_asset, "page.css"); }
std::string script() {
  return embedded_file(watch_asset, "data.js") + embedded_file(watch_asset, "scene.js") +
         embedded_file(play_asset, "module.js") + embedded_file(play_asset, "live.js") +
         embedded_file(play_asset, "play.js");
}

std::string html(const PlayPage& page, PageHead head, std::map<std::string, std::string> parts) {
  head.title = page.title;
  head.kind = "play";
  head.more_scripts = "'wasm-unsafe-eval'";
  parts["head"] = page_head(head);
  parts["title"] = escaped(page.title);
  parts["version"] = escaped(page.version);
  return fill_template(embedded_file(play_asset, "page.html"), parts);
}

}  // namespace

bool has_play_module() { return play_asset("play.wasm").has_value(); }

std::string play_page(const PlayPage& page) {
  Json data = data_of(page);
  data["module"] = packed(module_bytes());
  return html(page, {.style = style()},
              {{"data", inside_script(data)},
               {"script", "<script>" + script() + "</script>"},
               {"needs", "This file needs no network."}});
}

void write_play_folder(const fs::path& folder, const PlayPage& page) {
  const std::string module = module_bytes();
  std::error_code code;
  fs::create_directories(folder, code);
  if (code) throw InputError(cat("cannot create the folder ", folder.string(), ": ", code.message()));
  write_file(folder / "play.wasm", module);
  write_file(folder / "game.json", text_of(data_of(page)));
  write_file(folder / "play.css", style());
  write_file(folder / "play.js", script());
  write_file(
      folder / "index.html",
      html(page, {.style_file = "play.css", .source = "'self'", .connect = "'self'"},
           {{"data", ""}, {"script", "<script src=\"play.js\"></script>"}, {"needs", "It is served as a folder."}}));
}

}  // namespace giga
