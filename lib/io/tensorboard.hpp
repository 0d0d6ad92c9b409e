// TensorBoardEvents: the figures of a run in a file that TensorBoard shows: curves, texts and hyper-parameters.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "io/append_file.hpp"
#include "io/hyper_parameters.hpp"
#include "io/metrics_csv.hpp"

namespace giga {

/// Name of the file in a run's folder. TensorBoard reads what has `tfevents` in its name and calls a run by its folder,
/// so that `tensorboard --logdir runs` shows the names of the run folders.
constexpr const char* kTensorBoardFile = "events.out.tfevents.gigastep";

/// Wall times are seconds since 1970. Texts and names are UTF-8 (Error else). Each call hands whole
/// records to the system (AppendFile), so that an open TensorBoard shows them.
///
/// A TensorBoard that is open while a run is resumed goes on at the byte where it was: it keeps the rows that it has
/// read and follows again once the file is longer than before, because the same figures take the same number of bytes.
/// Where they do not (other figures, or a run that had ended) it stops following until it is started again.
class TensorBoardEvents {
 public:
  /// A new file; throws Error where it exists or cannot be written.
  static TensorBoardEvents create(const std::filesystem::path& path, double wall_time);
  /// Goes on behind the first `size` bytes of a file, as `size()` gave it; what was written later is cut off. Throws
  /// InputError.
  static TensorBoardEvents resume(const std::filesystem::path& path, uint64_t size);

  /// For the HPARAMS tab, once, at the start: what the run was told, and the tags of the figures by which runs are
  /// compared there (of comparison_tag). Numbers must be finite. TensorBoard takes its columns
  /// from one of the runs that it shows: a key that this run lacks is not shown for the others.
  void hyper_parameters(const HyperParameters& values, const std::vector<std::string>& metric_tags, double wall_time);
  /// For the HPARAMS tab: the run is over.
  void session_end(bool success, double wall_time);
  /// For the TEXT tab. A configuration stays as it is between lines of three back quotes.
  void text(const std::string& tag, const std::string& markdown, int64_t step, double wall_time);
  /// One point for each figure that is known (not NaN), in single precision; `step` is its place on the axis: the
  /// agent-steps that are done.
  void scalars(int64_t step, double wall_time, const MetricsRow& row);
  /// The figures of the HPARAMS tab, under tags of their own (comparison_tag): that tab fails where the step of one of
  /// its figures is not below 2^31, so that they stand at the number of the update.
  void comparison(int64_t update, double wall_time, const MetricsRow& row);

  uint64_t size() const { return file_.size(); }
  void flush_to_disk() const { file_.flush_to_disk(); }

 private:
  explicit TensorBoardEvents(AppendFile&& file) : file_(std::move(file)) {}
  void append(int64_t step, double wall_time, const MetricsRow& row, std::string (*tag)(std::string_view));

  AppendFile file_;
};

/// Under which tag a figure is shown. TensorBoard groups tags by what stands before the slash, so that both teams'
/// curves of a figure stand side by side: "policy_loss_1" = "policy_loss/team_1", "win_rate_0_vs_circle" =
/// "win_rate/team_0_vs_circle"; a figure of no team belongs to the run: "run/agent_steps_per_second".
std::string tensorboard_tag(std::string_view name);
/// "hparams/win_rate_0_vs_circle": the figure by which the HPARAMS tab compares runs.
std::string comparison_tag(std::string_view name);

}  // namespace giga
