// start_ranks(): several processes of this command on this machine, one for each rank.
#pragma once

namespace giga {

/// Runs this very command line, without --ranks and --gpus, as `n` ranks, and waits for their end. A signal that comes
/// here reaches them. Where one fails or is killed, the others are told, and killed if they have not ended 30 s later.
/// Returns the exit code of the one that failed first (1 where a signal had ended it), else that of rank 0; where a
/// signal that came here ended ranks that did not yet listen to it, 128 + that.
int start_ranks(int n);

}  // namespace giga
