// Replays: what is written is read, what is broken is told.
#include "io/replay.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include <functional>

#include "core/error.hpp"
#include "sample_replay.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

std::string refusal(const std::string& bytes) {
  return input_error_of([&] { decode_replay(bytes, "x.replay"); });
}

constexpr size_t kFirstLine = sizeof "gigastep replay 1\n" - 1;

/// The same stream with other bytes inside.
std::string repacked(const std::string& bytes, const std::function<void(std::string&)>& change) {
  std::string raw(1 << 16, '\0');
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
    EXPECT_EQ(b.x, a.x);
    EXPECT_EQ(b.y, a.y);
    EXPECT_EQ(b.heading, a.heading);
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
  EXPECT_EQ(refusal("gigastep replay 2\n"), "x.replay has format version 2, newer than 1, which this gigastep reads");
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
  // each state and agent, 1 of each action: 6,156,288 + 512,000. 1 GiB, 1,073,741,824, has room for 14.8 of that.
  EXPECT_EQ(too_large_to_keep(frame, 14, 500), "");
  EXPECT_EQ(too_large_to_keep(frame, 15, 500), "a replay has room for 14 of these games, not for 15");
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
    raw[0] = static_cast<char>(raw[0] + static_cast<char>(to.size() - from.size()));  // the size of the header
  });
  EXPECT_TRUE(contains(refusal(wrong), {"holds less than it says"}));
}

}  // namespace
}  // namespace giga::test
