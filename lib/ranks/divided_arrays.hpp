// Arrays with a row for each world, of which every rank has its share, as a checkpoint keeps them: whole.
#pragma once

#include "core/named_array.hpp"
#include "ranks/ranks.hpp"

namespace giga {

/// The rows of all ranks in the place of this one's, those of rank 0 first.
void gather_rows(Ranks& ranks, NamedArray& array);
/// The rows of rank `from` in the place of this one's; all ranks have an array of the same name, type and row.
void broadcast_rows(Ranks& ranks, NamedArray& array, int from);
/// This rank's share of the rows. Throws InputError where they cannot be divided.
NamedArray own_rows(const Ranks& ranks, const NamedArray& array);

}  // namespace giga
