// What a page draws against the pictures in tests/<folder>/pictures. GIGASTEP_WRITE_PICTURES=1 writes these anew; look
// at them before they are committed.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>

#include "config/document.hpp"
#include "io/browser.hpp"
#include "io/files.hpp"
#include "support/source.hpp"
#include "watch/page.hpp"

namespace giga::test {

/// The share of pixels that may differ plainly (tests/io/browser_check.js says what that is).
constexpr double kMostPixels = 0.002;

/// REFERENCES for a check.
inline std::string reference_pictures(const std::string& tests) {
  std::string all;
  const std::filesystem::path folder = source_path("tests/" + tests + "/pictures");
  if (std::filesystem::exists(folder))
    for (const auto& file : std::filesystem::directory_iterator(folder))
      all +=
          "\"" + file.path().stem().string() + "\": \"data:image/png;base64," + base64(read_file(file.path())) + "\",";
  return "const REFERENCES = {" + all + "};\n";
}

/// Holds what notePicture and noteWrong noted to the tolerance. What differs is kept beside the system's temporary
/// files.
inline void expect_pictures(const Document& seen, const std::string& tests, const Texts& names) {
  const char* write = std::getenv("GIGASTEP_WRITE_PICTURES");
  const std::filesystem::path folder = source_path("tests/" + tests + "/pictures");
  Texts drawn;
  for (const std::string& line : texts(seen, "pictures")) {
    std::istringstream words(line);
    std::string name, share, png;
    words >> name >> share >> png;
    drawn.push_back(name);
    if (write && *write) {
      std::filesystem::create_directories(folder);
      write_file(folder / (name + ".png"), from_hex(png));
      continue;
    }
    if (std::stod(share) <= kMostPixels) continue;
    const std::filesystem::path kept = std::filesystem::temp_directory_path() / (tests + "_" + name + ".png");
    write_file(kept, from_hex(png));
    ADD_FAILURE() << share << " of the pixels of tests/" << tests << "/pictures/" << name << ".png are others: see "
                  << kept << "; if that is right, GIGASTEP_WRITE_PICTURES=1 writes it anew";
  }
  EXPECT_EQ(drawn, names);
  if (write && *write) GTEST_SKIP() << "pictures were written to " << folder;
  EXPECT_FALSE(texts(seen, "wrong").empty());
  for (const std::string& line : texts(seen, "wrong")) {
    std::istringstream words(line);
    std::string name, share;
    words >> name >> share;
    EXPECT_GT(std::stod(share), 2 * kMostPixels) << "a wrong picture passes: " << line;
  }
}

}  // namespace giga::test
