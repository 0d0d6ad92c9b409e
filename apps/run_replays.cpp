#include "apps/run_replays.hpp"

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "apps/program_info.hpp"
#include "eval/record.hpp"
#include "io/files.hpp"
#include "watch/page.hpp"

namespace giga {

std::string why_games_have_no_room(const LoadedRun& run) {
  return too_large_to_keep(replay_frame(run.scenario, run.spec, program_version()), run.config.eval.record,
                           run.spec.with_time_limit().params.max_episode_length);
}

void ReplayWriter::write(int64_t updates, std::unique_ptr<TeamRecording> games) {
  wait();
  games_ = std::move(games);
  written_ = std::async(std::launch::async, [this, updates] {
    folder_.save_replay(updates, encode_replay(games_->replay(program_version())));
  });
}

void ReplayWriter::wait() {
  if (const std::exception_ptr failure = ended()) std::rethrow_exception(failure);
}

std::exception_ptr ReplayWriter::ended() {
  if (!written_.valid()) return nullptr;
  std::exception_ptr failure;
  try {
    written_.get();
  } catch (...) {
    failure = std::current_exception();
  }
  games_.reset();
  return failure;
}

void write_replays_page(const RunFolder& folder, int64_t updates) {
  constexpr size_t kMost = 12, kMostBytes = size_t{24} << 20;  // browsers open no page of any size
  const std::vector<std::filesystem::path> files = folder.replays(updates);
  if (files.empty()) return;
  std::vector<std::string> shown;
  const size_t count = std::min(kMost, files.size());
  size_t bytes = 0;
  for (size_t k = 0; k < count; ++k) {
    shown.push_back(
        read_file(files[count == 1 ? files.size() - 1 : (files.size() - 1) * (count - 1 - k) / (count - 1)]));
    bytes += shown.back().size();
    if (bytes <= kMostBytes || shown.size() == 1) continue;
    shown.pop_back();
    break;
  }
  write_file(folder.replays_page(), watch_page(shown, folder.path().filename().string(), program_version()));
}

}  // namespace giga
