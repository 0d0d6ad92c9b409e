// What stands on a page, for tests of reports.
#pragma once

#include <string>
#include <vector>

#include "support/xml.hpp"

namespace giga::test {

using Elements = std::vector<XmlElement>;
using Texts = std::vector<std::string>;
using Rows = std::vector<Texts>;

/// The elements of a section by its title; none where there is no such section. Throws Error where the sections are not
/// well-formed.
Elements section_of(const std::string& page, const std::string& title);

/// The texts of all elements of a name, and of a class where one is given.
Texts texts_of(const Elements& elements, const std::string& name, const std::string& of_class = "");

/// The cells of the tables in a section.
std::vector<Rows> tables_of(const Elements& section);

}  // namespace giga::test
