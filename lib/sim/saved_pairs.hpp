// What a saved state says of pairs, in the other way of keeping them (Pairs): a run goes on in either.
#pragma once

#include <string>

#include "core/named_array.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// Whether the worlds that were saved under this prefix have lists, and no tables.
bool saved_with_lists(const std::string& prefix, const NamedArrays& in);

/// Fills in what a state of this shape keeps of pairs, in host memory, from worlds that were saved in the other way;
/// all else of it, and zeros there. Steps that follow are the same, bit for bit: fire is what they ask for, and whom
/// agents see they find out anew. Until then tables have of those that an agent sees the ones of its row, and nobody
/// who is detected. Throws InputError where more fire at an agent than lists hold.
void convert_pairs(const StateShape& shape, int n_worlds, const std::string& prefix, const NamedArrays& in,
                   const StateView& state, const PairLists& lists);

}  // namespace giga
