// The result of matches between two players: for people, as CSV and as JSON.
#pragma once

#include <string>
#include <vector>

#include "apps/evaluation.hpp"
#include "io/json.hpp"

namespace giga {

/// Matches of A, seen from A: TeamResult::team is its side, TeamResult::opponent the name of B.
struct MatchReport {
  std::string a, scenario;
  std::vector<std::string> policies_of_a, policies_of_b;  ///< names of those that share a mixed team; of others one
  std::string win;                                        ///< what a win is, in words
  std::vector<TeamResult> results;
};

/// Shares with Wilson's intervals, then what became of both sides.
std::string report_text(const MatchReport& report);

/// A header and a row per match (RFC 4180).
std::string report_csv(const MatchReport& report);

/// The figures of one match of a report.
Json result_json(const MatchReport& report, const TeamResult& result);

}  // namespace giga
