// What the recordings of the original package hold: which files there are, and a recorded configuration as a SimSpec.
#pragma once

#include <string>
#include <vector>

#include "config/document.hpp"
#include "golden/hdf5_file.hpp"
#include "sim/draws.hpp"
#include "sim/spec.hpp"

namespace giga::golden {

struct Recording {
  std::string file;  ///< name without folder, for messages
  H5Group root;
};

/// All *.h5 files of $GIGASTEP_GOLDEN_DIR, or of tests/golden/data. Throws if there is none, or one with nothing known.
std::vector<Recording> recordings();
/// Whether GIGASTEP_GOLDEN_DIR names the folder. Such a folder may lack a kind of recordings; our own may not.
bool foreign_folder();

/// The groups of a file that are step cases: those with before/ and after/.
std::vector<std::string> step_cases(const H5Group& root);

/// A JSON object with the scalar parameters of the original's constructor, under the original's names.
class Params {
 public:
  explicit Params(const std::string& json, const std::string& name);
  bool has(const std::string& key) const { return document_.root.find(key) != nullptr; }
  double number(const std::string& key) const;
  bool flag(const std::string& key) const;
  std::string text(const std::string& key) const { return node(key).text; }
  bool is_null(const std::string& key) const;
  const Node& root() const { return document_.root; }

 private:
  const Node& node(const std::string& key) const;
  Document document_;
};

/// The recorded configuration of a step case or of a reset, independent of the scenario library.
SimSpec recorded_spec(const H5Group& recorded, const std::string& name);
/// The part of it that stands in `params`: everything but agents and maps.
SimParams recorded_params(const Params& params);
/// The maps of a set: datasets PREFIX boxes, start_pos_team_a, ...
std::vector<MapSpec> recorded_maps(const H5Group& recorded, const std::string& prefix);

/// Recorded draws with the functions of PhiloxDraws. A draw that was not recorded throws.
struct RecordedDraws {
  int n_agents = 0;
  const float* detect_at = nullptr;  // [n, n] target, observer
  const float* comm_at = nullptr;    // [n, n] ego, sender
  const float* appear_at = nullptr;
  const float* location_at = nullptr;  // [2]
  const float* time_at = nullptr;
  int map_index = -1;
  const float* start_at[4] = {};  // [n] by StartDraw
  const float* retry_at[4] = {};  // [3, n]; none for the heading

  float waypoint_appears() const { return *checked(appear_at, "wp_appear"); }
  float waypoint_location(int axis) const { return checked(location_at, "wp_loc_unit")[axis]; }
  float waypoint_time() const { return *checked(time_at, "wp_time_unit"); }
  float detect(int target, int observer) const { return checked(detect_at, "detect")[target * n_agents + observer]; }
  float comm(int ego, int sender, bool) const { return checked(comm_at, "comm")[ego * n_agents + sender]; }
  int map(int n_maps) const;
  float start(int agent, int round, StartDraw what) const;

 private:
  static const float* checked(const float* p, const char* name);
};

}  // namespace giga::golden
