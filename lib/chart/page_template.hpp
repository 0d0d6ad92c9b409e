// Pages from a template, and the files inside the program that they are made of.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace giga {

/// Puts texts in the places {{name}} of a template; what is put in is not looked at again. Throws Error where a place
/// has no text.
std::string fill_template(std::string_view page, const std::map<std::string, std::string>& texts);

/// A file that giga_embed put into the program. Throws Error where there is none of that name.
std::string embedded_file(std::optional<std::string_view> (*find)(std::string_view), std::string_view name);

/// What stands in the head of a page, for its place {{head}}.
struct PageHead {
  std::string title = {}, kind = {};       ///< "title - gigastep kind"
  std::string style = {};                  ///< its style sheet
  std::string style_file = {};             ///< where it is a file beside the page: the name, in the place of `style`
  std::string source = "'unsafe-inline'";  ///< where styles and scripts come from (CSP): all lies in the page
  std::string more_scripts = {}, connect = {};  ///< what scripts may do besides, and whom they may ask
};
/// A page of this head loads nothing else.
std::string page_head(const PageHead& head);

}  // namespace giga
