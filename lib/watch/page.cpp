#include "watch/page.hpp"

#include <openssl/evp.h>

#include "chart/markup.hpp"
#include "chart/page_template.hpp"
#include "core/error.hpp"
#include "watch/assets.hpp"

namespace giga {
namespace {

std::string asset(const char* name) { return embedded_file(watch_asset, name); }

}  // namespace

std::string base64(std::string_view bytes) {
  std::string text((bytes.size() + 2) / 3 * 4 + 1, '\0');  // OpenSSL ends it with a zero
  const int size =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                      reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<int>(bytes.size()));
  text.resize(static_cast<size_t>(size));
  return text;
}

std::string watch_page(const std::vector<std::string>& replays, const std::string& title, const std::string& version) {
  GIGA_CHECK(!replays.empty(), "a page needs a replay");
  std::string data;
  for (const std::string& replay : replays) data += cat(data.empty() ? "[\"" : ",\n\"", base64(replay), '"');
  return fill_template(asset("page.html"), {{"head", page_head({title, "replay", asset("page.css")})},
                                            {"title", escaped(title)},
                                            {"version", escaped(version)},
                                            {"data", data + "]"},
                                            {"script", asset("data.js") + asset("scene.js") + asset("agent.js") +
                                                           asset("pane.js") + asset("page.js")}});
}

}  // namespace giga
