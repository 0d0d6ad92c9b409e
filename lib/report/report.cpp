// Putting the page together.
#include "report/report.hpp"

#include <nlohmann/json.hpp>
#include <string_view>

#include "chart/markup.hpp"
#include "chart/page_template.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "io/files.hpp"
#include "io/host_info.hpp"
#include "io/run_folder.hpp"
#include "report/assets.hpp"
#include "report/curves.hpp"
#include "report/sections.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

std::string asset(const char* name) { return embedded_file(report_asset, name); }

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

std::string page_title(const std::vector<RunGroup>& groups) {
  if (groups.size() == 1) return groups[0].label;
  return cat(groups.size(), " configurations compared");
}

}  // namespace

std::string report_page(const std::vector<RunData>& runs, const std::vector<FieldInfo>& keys,
                        const std::string& first_section) {
  GIGA_CHECK(!runs.empty(), "a report needs a run");
  const std::vector<RunGroup> groups = group_runs(runs, points_for(runs));
  std::string written = utc_now();
  replace_all(written, "T", " ");
  replace_all(written, "Z", " UTC");
  const std::string title = page_title(groups);
  return fill_template(asset("page.html"), {{"head", page_head({title, "report", asset("page.css")})},
                                            {"title", escaped(title)},
                                            {"written", written},
                                            {"colour", groups.size() < 3 ? "team" : "group"},
                                            {"sections", first_section + page_sections(groups, keys)},
                                            {"data", json_text(group_axes(groups))},
                                            {"script", asset("chart.js") + asset("page.js")}});
}

std::vector<std::string> write_report(const std::vector<fs::path>& runs, const fs::path& out,
                                      const std::vector<FieldInfo>& keys, const std::string& first_section) {
  std::vector<RunData> all;
  std::vector<std::string> left_out;
  const std::vector<std::string> names = names_of_folders(runs);
  for (size_t k = 0; k < runs.size(); ++k) {
    for (size_t j = 0; j < k; ++j) {
      std::error_code code;
      if (fs::equivalent(runs[j], runs[k], code))
        throw InputError(cat("the run ", runs[k].string(), " is given twice"));
    }
    try {
      all.push_back(read_run(runs[k]));
      all.back().name = names[k];
      const fs::path page = fs::absolute(runs[k]) / RunFolder::kReplaysPage;
      if (fs::exists(page))
        all.back().replays = page.lexically_normal()
                                 .lexically_relative(fs::absolute(out).lexically_normal().parent_path())
                                 .generic_string();
    } catch (const InputError& e) {
      if (runs.size() == 1) throw;
      left_out.emplace_back(e.what());
    }
  }
  if (all.empty()) throw InputError("none of these can be reported:\n" + join(left_out, "\n"));
  const std::string page = report_page(all, keys, first_section);
  make_folder_of(out);
  write_file(out, page);
  return left_out;
}

}  // namespace giga
