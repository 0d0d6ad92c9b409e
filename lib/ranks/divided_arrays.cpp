#include "ranks/divided_arrays.hpp"

#include "core/error.hpp"

namespace giga {

void gather_rows(Ranks& ranks, NamedArray& array) {
  const std::vector<std::string> all = ranks.gather({array.bytes.begin(), array.bytes.end()});
  const size_t mine = array.bytes.size();
  array.bytes.clear();
  for (const std::string& rows : all) {
    GIGA_CHECK(rows.size() == mine, "'", array.name, "': a rank has ", rows.size(), " bytes, not ", mine);
    array.bytes.insert(array.bytes.end(), rows.begin(), rows.end());
  }
  array.shape.at(0) *= ranks.size();
}

void broadcast_rows(Ranks& ranks, NamedArray& array, int from) {
  std::string rows;
  if (ranks.rank() == from) rows.assign(array.bytes.begin(), array.bytes.end());
  rows = ranks.broadcast(rows, from);
  auto row = static_cast<int64_t>(size_of(array.type));
  for (size_t k = 1; k < array.shape.size(); ++k) row *= array.shape[k];
  const auto size = static_cast<int64_t>(rows.size());
  GIGA_CHECK(row > 0 && size % row == 0, "'", array.name, "': rank ", from, " has ", size, " bytes, of rows of ", row);
  array.shape.at(0) = size / row;
  array.bytes.assign(rows.begin(), rows.end());
}

NamedArray own_rows(const Ranks& ranks, const NamedArray& array) {
  const int64_t rows = array.shape.at(0);
  if (rows % ranks.size() != 0)
    throw InputError(cat("the checkpoint's array '", array.name, "' has ", rows, " rows, which ", ranks.size(),
                         " ranks cannot share"));
  NamedArray mine{array.name, array.type, array.shape, {}};
  mine.shape[0] /= ranks.size();
  const auto size = static_cast<int64_t>(array.bytes.size()) / ranks.size();
  const auto from = array.bytes.begin() + ranks.rank() * size;
  mine.bytes.assign(from, from + size);
  return mine;
}

}  // namespace giga
