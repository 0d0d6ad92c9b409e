#include "apps/known_rating.hpp"

#include <iostream>
#include <nlohmann/json.hpp>

#include "core/error.hpp"
#include "rating/sheet.hpp"

namespace giga {
namespace fs = std::filesystem;

Json known_rating(const RatedPolicy& policy, const char* consequence) {
  const fs::path file = policy.run / RatingFiles::kFolder / RatingFiles::kJson;
  std::error_code code;
  if (!fs::exists(file, code)) return Json::object();
  try {
    return find_rating(file, policy);
  } catch (const InputError& e) {
    std::cerr << "warning: " << e.what() << "; " << consequence << '\n';
    return Json::object();
  }
}

}  // namespace giga
