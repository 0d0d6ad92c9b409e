#include "io/replay_header.hpp"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/error.hpp"
#include "core/utf8.hpp"
#include "io/json.hpp"
#include "io/replay_columns.hpp"

namespace giga {
namespace {

/// What is wrong with when agents died; empty: nothing.
std::string broken_deaths(const Replay& r, const ReplayEpisode& e) {
  if (e.died.size() != r.agents.size() || e.cause.size() != r.agents.size())
    return cat("tells the deaths of ", e.died.size(), " of ", r.n_agents(), " agents");
  for (const int died : e.died)
    if (died > e.steps) return cat("has a death in step ", died, " of ", e.steps);
  return "";
}

/// The same agent so many times, as crowds have them.
struct AgentGroup : ReplayAgent {
  int count = 1;
};
template <class V>
void visit_fields(V& v, AgentGroup& c) {
  v("count", c.count, "agents in a row", range(1, kMostReplayAgents));
  visit_fields(v, static_cast<ReplayAgent&>(c));
}

/// The header of a crowd: without agents one by one, and without deaths.
struct CrowdHeader {
  Replay replay;
  std::vector<AgentGroup> agents;
};
template <class V>
void visit_fields(V& v, CrowdHeader& c) {
  visit_header(v, c.replay, c.agents);
}

bool same(const ReplayAgent& a, const ReplayAgent& b) {
  return a.team == b.team && a.kind == b.kind && a.sprite == b.sprite && a.max_health == b.max_health &&
         a.range == b.range && a.damage_range == b.damage_range && a.thrust == b.thrust;
}

/// Without columns, and without the events that these tell too.
Replay header_of(const Replay& r) {
  const ReplayEventKind told = r.is_crowd() ? ReplayEventKind::death : ReplayEventKind::hit;
  Replay header{r.gigastep_version, r.scenario_name, r.scenario, r.seed, r.actions, r.players,
                r.origins,          r.rules,         r.flight,   {},     r.maps,    {}};
  // Names of files need not be UTF-8, which a header is.
  header.scenario_name = printable_utf8(header.scenario_name);
  for (auto* names : {&header.players, &header.origins})
    for (std::string& name : *names) name = printable_utf8(name);
  if (!r.is_crowd()) header.agents = r.agents;
  for (const ReplayEpisode& e : r.episodes) {
    ReplayEpisode& head = header.episodes.emplace_back();
    head.map = e.map;
    head.steps = e.steps;
    head.winner = e.winner;
    head.at_time_limit = e.at_time_limit;
    head.returns = e.returns;
    head.score = e.score;
    if (!r.is_crowd()) {
      head.died = e.died;
      head.cause = e.cause;
    }
    std::copy_if(e.events.begin(), e.events.end(), std::back_inserter(head.events),
                 [told](const ReplayEvent& event) { return event.what != told; });
    head.waypoints = e.waypoints;
    for (size_t team = 0; team < 2; ++team) {
      head.mind[team].low = e.mind[team].low;
      head.mind[team].high = e.mind[team].high;
      head.mind[team].top = e.mind[team].top;
    }
    head.action_check = e.action_check;
    head.state_check = e.state_check;
  }
  return header;
}

CrowdHeader crowd_header(const Replay& r) {
  CrowdHeader header{header_of(r), {}};
  for (const ReplayAgent& agent : r.agents) {
    if (header.agents.empty() || !same(header.agents.back(), agent)) header.agents.push_back({agent, 0});
    ++header.agents.back().count;
  }
  return header;
}

/// What is wrong with the header of a crowd; where nothing is, its agents are told one by one then.
std::string spread_out(CrowdHeader& header) {
  size_t count = 0;
  for (const AgentGroup& group : header.agents) count += static_cast<size_t>(group.count);
  if (count <= kMostPaired || count > kMostReplayAgents)
    return cat("has ", count, " agents; in format ", kCrowdFormat, " it would have ", kMostPaired + 1, " to ",
               kMostReplayAgents);
  for (const AgentGroup& group : header.agents)
    header.replay.agents.insert(header.replay.agents.end(), static_cast<size_t>(group.count), group);
  for (const ReplayEpisode& e : header.replay.episodes)
    for (const ReplayEvent& event : e.events)
      if (event.what == ReplayEventKind::death || event.what == ReplayEventKind::hit)
        return "has deaths or hits among its events, which those of a crowd are not";
  return "";
}

/// Hits among the events of a header; empty: none.
std::string told_hits(const Replay& replay) {
  for (const ReplayEpisode& e : replay.episodes)
    for (const ReplayEvent& event : e.events)
      if (event.what == ReplayEventKind::hit) return "has hits among its events, which the columns tell";
  return "";
}

}  // namespace

// Deaths in a crowd are columns.
std::string broken_header(const Replay& r) {
  if (r.agents.empty() || r.agents.size() > kMostReplayAgents) return cat("has ", r.agents.size(), " agents");
  if (r.n_team(0) == 0 || r.n_team(1) == 0) return "has a team without agents";
  for (size_t k = 1; k < r.agents.size(); ++k)
    if (r.agents[k].team < r.agents[k - 1].team) return "has agents of team 1 before those of team 0";
  if (r.maps.empty()) return "has no map";
  if (r.seed.empty() || r.seed.size() > 20 || r.seed.find_first_not_of("0123456789") != std::string::npos)
    return cat("has the seed '", r.seed, "'");
  const auto n = r.n_agents();
  size_t bytes = 0;
  for (size_t k = 0; k < r.episodes.size(); ++k) {
    const ReplayEpisode& e = r.episodes[k];
    const std::string where = cat("episode ", k, " ");
    if (e.map >= static_cast<int>(r.maps.size())) return cat(where, "is on map ", e.map, " of ", r.maps.size());
    if (!r.is_crowd())
      if (const std::string wrong = broken_deaths(r, e); !wrong.empty()) return where + wrong;
    for (const ReplayEvent& event : e.events)
      if (event.step > e.steps || event.agent >= n || event.other >= n)
        return cat(where, "has an event of agents ", event.agent, " and ", event.other, " in step ", event.step);
    for (const ReplayWaypoint& w : e.waypoints)
      if (w.to > e.steps || w.from > w.to) return cat(where, "has a waypoint from step ", w.from, " to ", w.to);
    for (const ReplayMind& mind : e.mind)
      if (mind.high < mind.low) return cat(where, "has values from ", mind.low, " to ", mind.high);
    bytes += EpisodeSizes(r, e).all(r, e) + (r.is_crowd() ? kCountBytes + kFireBytes * e.fire.size() : 0);
    if (bytes > kMostReplayBytes) return cat("asks for more than ", kMostReplayBytes >> 20, " MiB");
  }
  return "";
}

Replay read_header(const std::string& json, const std::string& name, int format) {
  Errors errors;
  const Document document = parse_yaml_text(json, name, errors);  // JSON is YAML
  if (!errors.empty()) throw InputError(cat(name, " is damaged: its header cannot be read: ", errors.text()));
  if (!document.root.is_map()) throw InputError(cat(name, " is damaged: its header is no JSON object"));
  CrowdHeader header;
  if (format == kCrowdFormat)
    read_fields(document.root, header, errors);
  else
    read_fields(document.root, header.replay, errors);
  errors.throw_if_any();
  Replay& replay = header.replay;
  std::string wrong = format == kCrowdFormat ? spread_out(header)
                      : replay.is_crowd()    ? cat("has ", replay.n_agents(), " agents")
                                             : "";
  if (wrong.empty() && format == kReplayFormat) wrong = told_hits(replay);
  if (wrong.empty()) wrong = broken_header(replay);
  if (!wrong.empty()) throw InputError(cat(name, " ", wrong));
  return std::move(replay);
}

std::string header_text(const Replay& replay) {
  const std::string yaml =
      replay.is_crowd() ? print_yaml(crowd_header(replay), false) : print_yaml(header_of(replay), false);
  return json_text(json_of(parse_yaml_text(yaml, "header").root));
}

}  // namespace giga
