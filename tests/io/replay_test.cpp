// Replays: what is written is read, what is broken is told.
#include "io/replay.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include <functional>
#include <limits>

#include "core/error.hpp"
#include "sample_replay.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

std::string refusal(const std::string& bytes) {
  return input_error_of([&] { decode_replay(bytes, "x.replay"); });
}

constexpr size_t kFirstLine = sizeof "gigastep replay 3\n" - 1;

/// The same stream with other bytes inside.
std::string repacked(const std::string& bytes, const std::function<void(std::string&)>& change) {
  std::string raw(1 << 17, '\0');
  uLongf size = raw.size();
  const auto* from = reinterpret_cast<const Bytef*>(bytes.data() + kFirstLine);
  EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(raw.data()), &size, from, bytes.size() - kFirstLine), Z_OK);
  raw.resize(size);
  change(raw);
  std::string packed(compressBound(raw.size()), '\0');
  size = packed.size();
  EXPECT_EQ(
      compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(raw.data()), raw.size()),
      Z_OK);
  return bytes.substr(0, kFirstLine) + packed.substr(0, size);
}

TEST(Replay, ReadsBackToTheSame) {
  for (const ReplayActions actions : {ReplayActions::discrete, ReplayActions::continuous}) {
    const Replay before = sample_replay(actions), after = decode_replay(encode_replay(before), "x");
    EXPECT_EQ(encode_replay(after), encode_replay(before));
    EXPECT_EQ(after.seed, "18446744073709551615");
    EXPECT_EQ(after.players[1], "<b>circle</b>");
    EXPECT_EQ(after.scenario, before.scenario);
    const ReplayEpisode &a = before.episodes[0], &b = after.episodes.at(0);
    EXPECT_EQ(b.start, a.start);
    EXPECT_EQ(b.x, a.x);
    EXPECT_EQ(b.y, a.y);
    EXPECT_EQ(b.z, a.z);
    EXPECT_EQ(b.heading, a.heading);
    EXPECT_EQ(b.speed, a.speed);
    EXPECT_EQ(b.health, a.health);
    EXPECT_EQ(b.action, a.action);
    EXPECT_EQ(b.sees, a.sees);
    EXPECT_EQ(b.hears, a.hears);
    EXPECT_EQ(b.mind[0].value, a.mind[0].value);
    EXPECT_EQ(b.mind[0].likely, a.mind[0].likely);
    EXPECT_EQ(b.mind[0].probability, a.mind[0].probability);
    EXPECT_EQ(b.events.size(), 5u);
    EXPECT_EQ(b.events[3].what, ReplayEventKind::hit);
    EXPECT_EQ(b.cause[1], ReplayDeath::damage);
  }
}

// Health is kept in 16 bits: of more than 320 not by hundredths.
TEST(Replay, OfMuchHealthKeepsItInLargerUnits) {
  EXPECT_EQ(health_unit(3), 0.01f);
  EXPECT_EQ(health_unit(3200), 0.1f);  // 3,200 / 32,000
  Replay replay = sample_replay();
  replay.rules.health_unit = health_unit(3200);
  EXPECT_EQ(decode_replay(encode_replay(replay), "x").rules.health_unit, 0.1f);
}

TEST(Replay, OfAGameOfAMillionStepsReadsBack) {
  Replay replay = sample_replay();
  ReplayEpisode& e = replay.episodes[0];
  e.steps = 1'000'000;  // as long as a scenario may be
  const size_t n = 3, states = 1'000'001, pairs = 4, mates = 2, bits = (states + 7) / 8;
  for (auto* column : {&e.x, &e.y, &e.z, &e.heading, &e.speed, &e.health}) column->assign(n * states, 100);
  e.action.assign(n * (states - 1), 13);
  e.sees.assign(pairs * bits, 0);
  e.fires.assign(pairs * bits, 0);
  e.hears.assign(mates * bits, 0);
  for (auto& mind : e.mind) mind = {};
  e.action_check = action_checksum(replay, e);
  const Replay again = decode_replay(encode_replay(replay), "long");
  EXPECT_EQ(again.episodes.at(0).steps, 1'000'000);
}

// Names of folders need not be UTF-8.
TEST(Replay, NamesOfFilesNeedNotBeText) {
  Replay replay = sample_replay();
  replay.players[0] = "runs/caf\xe9\x7f";
  replay.origins[0] = "runs/caf\xe9\x7f/best.h5";
  replay.scenario_name = "caf\xe9";
  const Replay again = decode_replay(encode_replay(replay), "x");
  EXPECT_EQ(again.players[0], "runs/caf\xEF\xBF\xBD\xEF\xBF\xBD");
  EXPECT_EQ(again.origins[0], "runs/caf\xEF\xBF\xBD\xEF\xBF\xBD/best.h5");
  EXPECT_EQ(again.scenario_name, "caf\xEF\xBF\xBD");
}

// 600 games (--episodes takes 1,000) of 160 events: a header of 4.7 MB.
TEST(Replay, ManyGamesOfManyEventsReadBack) {
  Replay replay = sample_replay();
  ReplayEpisode& game = replay.episodes.at(0);
  game.events.assign(160, {2, ReplayEventKind::collected, 0, -1});  // of which no column tells
  replay.episodes.assign(600, game);
  const Replay again = decode_replay(encode_replay(replay), "many");
  ASSERT_EQ(again.episodes.size(), 600u);
  EXPECT_EQ(again.episodes.back().events.size(), 161u) << "and the death that a column tells";
}

TEST(Replay, ACrowdReadsBackToTheSame) {
  const Replay before = sample_crowd();
  const std::string bytes = encode_replay(before);
  EXPECT_EQ(bytes.substr(0, kFirstLine), "gigastep replay 4\n");
  const Replay after = decode_replay(bytes, "x");
  EXPECT_EQ(encode_replay(after), bytes);
  ASSERT_EQ(after.n_agents(), 1150);
  EXPECT_EQ(after.agents[999].kind, "scout");
  EXPECT_EQ(after.agents[1000].kind, "default");
  EXPECT_EQ(after.n_team(0), 1050);
  EXPECT_FLOAT_EQ(after.place_unit(), 0.03f);  // 900 / 30,000
  const ReplayEpisode &a = before.episodes[0], &b = after.episodes.at(0);
  EXPECT_EQ(b.died, a.died);
  EXPECT_EQ(b.cause, a.cause);
  EXPECT_EQ(b.x, a.x);
  EXPECT_EQ(b.sees, a.sees);
  EXPECT_EQ(b.fire, a.fire);
  EXPECT_EQ(b.mind[1].likely, a.mind[1].likely);
  EXPECT_EQ(b.mind[0].top, 0);
  ASSERT_EQ(b.events.size(), 4u);
  EXPECT_EQ(b.events[2].agent, 7);
  EXPECT_EQ(b.events[2].other, 1149);
  EXPECT_EQ(b.events[3].agent, 1049);
  EXPECT_EQ(b.events[3].other, -1);
}

TEST(Replay, WhatIsBrokenInACrowd) {
  const auto broken = [](const std::function<void(ReplayEpisode&)>& change) {
    Replay replay = sample_crowd();
    change(replay.episodes[0]);
    return refusal(encode_replay(replay));
  };
  EXPECT_EQ(broken([](auto& e) { e.fire[2].to = 3; }),
            "x.replay is damaged: episode 0 has fire of agent 999 at agent 1149 from step 1 of 2");
  EXPECT_TRUE(contains(broken([](auto& e) { e.fire[1].target = 4; }), {"has fire of agent 3 at agent 4"}));
  EXPECT_TRUE(contains(broken([](auto& e) { e.fire[0].shooter = 1150; }), {"has fire of agent 1150 at agent 7"}));
  EXPECT_TRUE(contains(broken([](auto& e) { e.fire[2] = e.fire[1]; }), {"has lines of fire out of their order"}));
  EXPECT_TRUE(contains(broken([](auto& e) { e.died[8] = 3; }), {"has a death of agent 8 in step 4 of 2"}));
  const std::string good = encode_replay(sample_crowd());
  const auto with = [&](const std::string& from, const std::string& to) {
    return refusal(repacked(good, [&](std::string& raw) {
      const size_t at = raw.find(from);
      ASSERT_NE(at, std::string::npos) << from;
      ASSERT_EQ(from.size(), to.size());
      raw.replace(at, from.size(), to);
    }));
  };
  EXPECT_EQ(with("\"count\": 1000", "\"count\":  800"),
            "x.replay has 950 agents; in format 4 it would have 1025 to 20000");
  EXPECT_TRUE(contains(with("\"count\": 1000", "\"count\": 1e99"), {"count"}));
  EXPECT_TRUE(contains(with("\"contact\"", "\"hit\"    "), {"has deaths or hits among its events"}));
  std::string other = good;
  other[kFirstLine - 2] = '3';
  EXPECT_TRUE(contains(refusal(other), {"count"})) << "format 3 has no groups of agents";
  // Four bytes that ask for 4,294,967,295 lines of fire: 64 GiB.
  EXPECT_EQ(refusal(repacked(good,
                             [](std::string& raw) {
                               const size_t count = raw.size() - 3 * 16 - 4;
                               for (size_t k = 0; k < 4; ++k) raw[count + k] = '\xff';
                             })),
            "x.replay asks for more than 1024 MiB");
}

TEST(Replay, NumbersOfPairs) {
  // Two against three. Targets 0 and 1 have opponents 2, 3, 4: pairs 0 to 5; targets 2, 3, 4 have 0, 1: 6 to 11.
  const ReplayPairs pairs(2, 3);
  EXPECT_EQ(pairs.n_opponents(), 12);
  EXPECT_EQ(pairs.opponents(0, 2), 0);
  EXPECT_EQ(pairs.opponents(1, 4), 5);
  EXPECT_EQ(pairs.opponents(2, 0), 6);
  EXPECT_EQ(pairs.opponents(4, 1), 11);
  // Mates: 0 of 1, 1 of 0, then 2 of 3 and 4, 3 of 2 and 4, 4 of 2 and 3.
  EXPECT_EQ(pairs.n_mates(), 8);
  EXPECT_EQ(pairs.mates(0, 1), 0);
  EXPECT_EQ(pairs.mates(1, 0), 1);
  EXPECT_EQ(pairs.mates(2, 3), 2);
  EXPECT_EQ(pairs.mates(3, 4), 5);
  EXPECT_EQ(pairs.mates(4, 3), 7);
}

TEST(Replay, WhatIsNone) {
  EXPECT_EQ(refusal(""), "x.replay is empty");
  EXPECT_EQ(refusal("seed: 3\n"), "x.replay is no replay: it does not begin as one (gigastep record writes them)");
  EXPECT_EQ(refusal("gigastep replay x\n"), "x.replay is damaged: its first line makes no sense");
  EXPECT_EQ(refusal("gigastep replay 5\n"), "x.replay has format version 5, newer than 4, which this gigastep reads");
  EXPECT_EQ(refusal("gigastep replay 2\n"),
            "x.replay has format version 2, of gigastep before its first release; this one reads 3 and 4");
}

/// A generator for the test below: the same numbers everywhere.
struct Digits {
  uint32_t state = 1;
  int below(int limit) {
    state = state * 1664525 + 1013904223;
    return static_cast<int>((state >> 8) % static_cast<uint32_t>(limit));
  }
};

// Whatever the columns hold, they come back: also states that no movement leads to, and numbers at the ends of their
// ranges.
TEST(Replay, AnyColumnsComeBack) {
  for (const ReplayActions actions : {ReplayActions::discrete, ReplayActions::continuous}) {
    Digits digits;
    Replay before = sample_replay(actions);
    before.agents[1].thrust = 1e30f;
    ReplayEpisode& e = before.episodes[0];
    e.steps = 300;
    e.events.clear();
    const auto fill = [&](auto& column, size_t size, int limit) {
      column.resize(size);
      for (auto& value : column) value = static_cast<std::decay_t<decltype(value)>>(digits.below(limit));
    };
    for (const auto column : {&ReplayEpisode::x, &ReplayEpisode::y, &ReplayEpisode::z, &ReplayEpisode::heading,
                              &ReplayEpisode::speed, &ReplayEpisode::health})
      fill(e.*column, 3 * 301, 65536);
    e.start = {1e30f, -1e30f, 5, std::numeric_limits<float>::quiet_NaN(), 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
    const bool discrete = actions == ReplayActions::discrete;
    fill(e.action, discrete ? 900 : 900 * 12, discrete ? 27 : 256);  // floats of any bits, some of them NaN
    for (auto* bits : {&e.sees, &e.fires}) fill(*bits, 4 * 38, 256);
    fill(e.hears, 2 * 38, 256);
    for (auto* bits : {&e.sees, &e.fires, &e.hears})
      for (size_t k = 37; k < bits->size(); k += 38) (*bits)[k] &= 31;  // bits behind the last state are none
    ReplayMind& mind = e.mind[0];
    fill(mind.value, 2 * 301, 256);
    fill(mind.likely, (discrete ? 2u : 3u) * 2 * 301, discrete ? 27 : 256);
    if (discrete) fill(mind.probability, 2 * 2 * 301, 16);
    e.action_check = action_checksum(before, e);
    const ReplayEpisode after = decode_replay(encode_replay(before), "x").episodes.at(0);
    EXPECT_EQ(after.x, e.x);
    EXPECT_EQ(after.y, e.y);
    EXPECT_EQ(after.z, e.z);
    EXPECT_EQ(after.heading, e.heading);
    EXPECT_EQ(after.speed, e.speed);
    EXPECT_EQ(after.health, e.health);
    EXPECT_EQ(after.action, e.action);
    EXPECT_EQ(after.sees, e.sees);
    EXPECT_EQ(after.fires, e.fires);
    EXPECT_EQ(after.hears, e.hears);
    EXPECT_EQ(after.mind[0].value, mind.value);
    EXPECT_EQ(after.mind[0].likely, mind.likely);
    EXPECT_EQ(after.mind[0].probability, mind.probability);
  }
}

TEST(Replay, WhatIsBroken) {
  const std::string good = encode_replay(sample_replay());
  EXPECT_EQ(refusal(good.substr(0, good.size() - 1)), "x.replay is truncated");
  EXPECT_EQ(refusal(good.substr(0, 40)), "x.replay is truncated");
  EXPECT_EQ(refusal(good + "x"), "x.replay is damaged: something follows its end");
  std::string flipped = good;
  flipped[good.size() - 1] ^= 1;  // of the stream's checksum
  EXPECT_EQ(refusal(flipped), "x.replay is damaged: its bytes do not unpack");
  EXPECT_EQ(refusal(repacked(good, [](std::string& raw) { raw.pop_back(); })),
            "x.replay is damaged: it holds less than it says");
  EXPECT_EQ(refusal(repacked(good, [](std::string& raw) { raw += 'x'; })),
            "x.replay is damaged: it holds more than it says");
  EXPECT_EQ(refusal(repacked(good, [](std::string& raw) { raw[3] = 127; })).substr(0, 33),
            "x.replay is damaged: a header of ");
  const auto with = [&](const std::string& from, const std::string& to) {
    return refusal(repacked(good, [&](std::string& raw) {
      const size_t at = raw.find(from);
      ASSERT_NE(at, std::string::npos) << from;
      ASSERT_EQ(from.size(), to.size());
      raw.replace(at, from.size(), to);
    }));
  };
  EXPECT_TRUE(contains(with("\"seed\"", "\"sead\""), {"sead", "seed"})) << "the nearest name is told";
  EXPECT_TRUE(contains(with("\"map\": 0", "\"map\": 9"), {"episode 0 is on map 9 of 1"}));
  EXPECT_TRUE(contains(with("\"agent\": 2", "\"agent\": 5"), {"an event of agents 5"}));
  EXPECT_TRUE(contains(with("\"steps\": 4", "\"steps\": 2"), {"has a death in step 3 of 2"}));
  EXPECT_TRUE(contains(with("\"steps\": 4", "\"steps\": 5"), {"holds less than it says"}));
  EXPECT_TRUE(contains(with("\"team\": 1", "\"team\": 0"), {"has a team without agents"}));
}

TEST(Replay, GamesThatAreTooLargeAreToldBeforeTheyArePlayed) {
  Replay frame = sample_replay();
  frame.agents.assign(1024, {});
  for (size_t k = 512; k < 1024; ++k) frame.agents[k].team = 1;
  // Of 2 x 512 x 512 pairs who sees whom and who shoots at whom, 63 bytes each for 501 states: 66,060,288. 12 bytes of
  // each state and agent, 1 of each action, 20 of each start: 6,156,288 + 512,000 + 20,480. 1 GiB, 1,073,741,824, has
  // room for 14.8 of that.
  EXPECT_EQ(too_large_to_keep(frame, 14, 500), "");
  EXPECT_EQ(too_large_to_keep(frame, 15, 500), "a replay has room for 14 of these games, not for 15");
}

TEST(Replay, TheLargestCrowd) {
  Replay frame = sample_crowd();
  frame.agents.assign(20'000, frame.agents[0]);
  frame.agents[19'999].team = 1;
  // For each agent 9 bytes of its death, 20 of its start, 63 of who sees it; for each of 501 states 12, for each of 500
  // steps 1 of the action and 4 for lines of fire: 20,000 x 8,604 = 172,080,000. 1 GiB has room for 6.24 of that.
  EXPECT_EQ(too_large_to_keep(frame, 6, 500), "");
  EXPECT_EQ(too_large_to_keep(frame, 7, 500), "a replay has room for 6 of these games, not for 7");
  frame.agents.push_back(frame.agents.back());
  EXPECT_EQ(too_large_to_keep(frame, 1, 1),
            "scenario 'small' has 20001 agents in a world; replays hold games of at most 20000");
}

TEST(Replay, OtherActionsAreNoticed) {
  Replay replay = sample_replay();
  replay.episodes[0].action[0] = 21;
  EXPECT_EQ(refusal(encode_replay(replay)), "x.replay is damaged: the actions of episode 0 do not have their checksum");
  replay.episodes[0].action[0] = 27;
  EXPECT_EQ(refusal(encode_replay(replay)), "x.replay is damaged: episode 0 has an action above 26");
}

// The header asks for 1.2 MB of each episode's states, which the stream does not have.
TEST(Replay, ASmallFileDoesNotTakeMuchMemory) {
  const std::string wrong = repacked(encode_replay(sample_replay()), [](std::string& raw) {
    const std::string from = "\"steps\": 4", to = "\"steps\": 100000";
    raw.replace(raw.find(from), from.size(), to);
    size_t size = 0;  // of the header, the lowest byte first
    for (size_t byte = 0; byte < 4; ++byte) size |= size_t{static_cast<unsigned char>(raw[byte])} << 8 * byte;
    size += to.size() - from.size();
    for (size_t byte = 0; byte < 4; ++byte) raw[byte] = static_cast<char>(size >> 8 * byte & 255);
  });
  EXPECT_TRUE(contains(refusal(wrong), {"holds less than it says"}));
}

}  // namespace
}  // namespace giga::test
