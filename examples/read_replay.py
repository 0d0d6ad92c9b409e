#!/usr/bin/env python3
"""Reads replays of gigastep with nothing but Python's standard library; docs/replays.md says what is in them.

  python3 examples/read_replay.py game.replay       what happened, in words

As a module: `replay = read_replay("game.replay")`; replay["episodes"][0].x[agent][state] and so on."""

import array
import itertools
import json
import math
import sys
import zlib

FORMATS = (3, 4)  # worlds of up to 1,024 agents; crowds
RULES = {"limit_x": 10, "limit_y": 10, "limit_z": 10, "seconds_per_step": 0.1, "health_unit": 0.01}  # left out
MOST = 4_194_304  # agents of a world
MINDS = 64  # agents of each team of a crowd of which it is kept what their networks said
FLIGHT = ("x", "y", "z", "heading", "speed")


def f32(number):
    """The 32-bit float that gigastep has for a number of the header."""
    return array.array("f", [number])[0]


class Bits:
    """Bits [pairs, states]."""

    def __init__(self, data, states):
        self.data, self.row = data, (states + 7) // 8

    def at(self, pair, state):
        return self.data[pair * self.row + state // 8] >> (state % 8) & 1


class Episode:
    """Everything of one episode: `head` of the header, states by agent, actions, bits, and what the networks said."""

    def __init__(self, replay, head, take):
        n, steps = len(replay["agents"]), head["steps"]
        self.teams = [sum(a["team"] == team for a in replay["agents"]) for team in (0, 1)]
        self.head, self.states, self.crowd = head, steps + 1, replay["format"] == 4
        if self.crowd:
            self.read_deaths(take, n)
        discrete = replay["actions"] == "discrete"
        actions = take(n * steps * (1 if discrete else 12))
        if zlib.crc32(actions, zlib.crc32(replay["seed"].encode())) != head["action_check"]:
            raise ValueError("the actions do not have their checksum")
        numbers = actions if discrete else array.array("f", actions)
        width = len(numbers) // n
        self.action = [numbers[i * width:(i + 1) * width] for i in range(n)]  # continuous: three numbers a step
        self.read_flight(replay, take, n)
        opponents = 0 if self.crowd else 2 * self.teams[0] * self.teams[1] * ((self.states + 7) // 8)
        mates = sum(m * (m - 1) for m in self.teams) * ((self.states + 7) // 8) if n <= 64 else 0
        sees = n * ((self.states + 7) // 8) if self.crowd else opponents  # crowd: is the agent seen by an opponent?
        self.sees, self.fires, self.hears = (Bits(take(size), self.states) for size in (sees, opponents, mates))
        self.value, self.likely, self.probability = [], [], []
        for team, m in enumerate(self.teams):
            mind = head[f"mind_{team}"]
            low, high, rows = mind["low"], mind["high"], (min(m, MINDS) if self.crowd else m) * self.states
            values = self.cut(take(rows if low < high else 0))
            self.value.append([[low + (high - low) * (v % 256) / 31 for v in itertools.accumulate(row)] for row in values])
            ranks = mind["top"] if discrete else 3 * mind["top"]
            likely, probability = take(rows * ranks), take(rows * ranks if discrete else 0)
            self.likely.append([row for rank in range(ranks) for row in self.cut(likely[rank::ranks])])
            shares = [row for rank in range(ranks) for row in self.cut(probability[rank::ranks])]
            self.probability.append([[v / 15 for v in row] for row in shares])
        self.fire = self.read_fire(take) if self.crowd else None
        if not self.crowd:
            self.add_hits(replay["rules"]["min_tracking_time"])

    def read_deaths(self, take, n):
        """Of a crowd: when the agents died (-1: they lived), of what, and by whose fire."""
        causes = ("none", "damage", "agent", "obstacle", "out_of_bounds")
        self.head["died"] = [k - 1 for k in numbers(take(4 * n))]
        self.head["cause"] = [causes[k] for k in take(n)]
        by = numbers(take(4 * n))
        deaths = [{"step": step, "what": "death", "agent": i, "other": by[i] - 1}
                  for i, step in enumerate(self.head["died"]) if step >= 0]
        self.head["events"] = sorted(self.head["events"] + deaths, key=lambda event: event["step"])

    @staticmethod
    def read_fire(take):
        """Of a crowd, unbroken fire: (first state, last state, target, shooter)."""
        count = numbers(take(4))[0]
        wait, more, target, shooter = (numbers(take(4 * count)) for _ in range(4))
        start = list(itertools.accumulate(wait))
        return list(zip(start, map(sum, zip(start, more)), target, shooter))

    def cut(self, numbers):
        return [numbers[k:k + self.states] for k in range(0, len(numbers), self.states)]

    def read_flight(self, replay, take, n):
        """States: what they differ by from where the actions lead (docs/replays.md)."""
        rules, flight = {**RULES, **replay["rules"]}, {name: f32(number) for name, number in replay["flight"].items()}
        longer, dt = max(rules["limit_x"], rules["limit_y"]), f32(rules["seconds_per_step"])
        self.place = max(f32(f32(longer) / 30000), f32(0.01)) if self.crowd else f32(f32(longer) / 5000)
        unit = (self.place, self.place, f32(0.02), 2 * math.pi / 65536, f32(0.05))
        start = array.array("f", take(4 * len(FLIGHT) * n))
        apart = [self.cut(unfolded(take(2 * n * self.states))) for _ in FLIGHT]
        for name in FLIGHT:
            setattr(self, name, [])
        for i, agent in enumerate(replay["agents"]):
            x, y, z, heading, speed = start[i::n]
            thrust, died, rows = flight["thrust"] * f32(agent["thrust"]), self.head["died"][i], [[] for _ in FLIGHT]
            for s in range(self.states):
                if s > 0 and (died < 0 or s <= died):
                    turn, dive, throttle = controls(self.action[i], s - 1, replay["actions"])
                    heading += dt * flight["turn_rate"] * turn
                    pushed = speed + dt * thrust * throttle
                    pushed -= flight["drag"] * pushed * pushed
                    x += dt * pushed * math.cos(heading)
                    y += dt * pushed * math.sin(heading)
                    above = min(max(z + dt * flight["climb_rate"] * dive, 0.0), rules["limit_z"])
                    speed = math.sqrt(max(pushed * pushed + flight["half_gravity"] * (z - above), flight["min_speed"] ** 2))
                    z = above
                now = [x, y, z, heading, speed]
                for c, row in enumerate(rows):
                    step = 64 if c == 3 else 1  # of headings every 64th is used
                    expected = rounded(now[c] / (unit[c] * step)) * step
                    difference = apart[c][i][s]
                    number = (expected + difference + 32768) % 65536 - 32768
                    if abs(difference) > step:  # more than a rounding
                        now[c] = number * unit[c]
                    row.append(number * unit[c])
                x, y, z, heading, speed = now
            for name, row in zip(FLIGHT, rows):
                getattr(self, name).append(row)
        each = f32(rules["health_unit"])
        self.health = [[each * v for v in itertools.accumulate(row)] for row in self.cut(unfolded(take(2 * n * self.states)))]

    def add_hits(self, min_tracking_time):
        """Fire does damage from the step after `min_tracking_time` on."""
        n0, n1 = self.teams
        hits = []
        for target in range(n0 + n1):
            for shooter in range(n0, n0 + n1) if target < n0 else range(n0):
                pair, unbroken = self.sees_pair(target, shooter), 0
                for step in range(self.states):
                    unbroken = unbroken + 1 if self.fires.at(pair, step) else 0
                    if unbroken == min_tracking_time + 1:
                        hits.append({"step": step, "what": "hit", "agent": shooter, "other": target})
        self.head["events"] = sorted(self.head["events"] + hits, key=lambda event: event["step"])

    def sees_pair(self, target, opponent):
        """Number of a pair in `sees` and `fires`: is the target detected by, or under fire of, the opponent?"""
        n0, n1 = self.teams
        return target * n1 + opponent - n0 if target < n0 else n0 * n1 + (target - n0) * n0 + opponent

    def hears_pair(self, listener, mate):
        """Number of a pair in `hears`: does the listener hear its mate?"""
        team = int(listener >= self.teams[0])
        first, n = team * self.teams[0], self.teams[team]
        row = (listener - first) * (n - 1) + mate - first - (mate > listener)
        return row + (self.teams[0] * (self.teams[0] - 1) if team else 0)


def rounded(number):
    return int(math.copysign(math.floor(abs(number) + 0.5), number)) if math.isfinite(number) else 0


def controls(actions, step, kind):
    """Heading, dive and throttle, from -1 to 1."""
    if kind == "continuous":
        return [min(max(c, -1.0), 1.0) for c in actions[3 * step:3 * step + 3]]
    return actions[step] // 3 % 3 - 1, actions[step] % 3 - 1, actions[step] // 9 - 1


def unfolded(data):
    """16-bit numbers, folded to 0, -1, 1, -2, 2, ...: all low bytes, then all high ones."""
    half = len(data) // 2
    folded = (low | high << 8 for low, high in zip(data[:half], data[half:]))
    return [-(f + 1) // 2 if f & 1 else f // 2 for f in folded]


def numbers(data):
    """32-bit numbers: all lowest bytes, then those above them, and so on."""
    count = len(data) // 4
    return [sum(data[k + byte * count] << 8 * byte for byte in range(4)) for k in range(count)]


def read_replay(path):
    """Raises ValueError, whose message names the file, where it is no whole replay."""
    with open(path, "rb") as file:
        line, rest = file.readline(), file.read()
    formats = [number for number in FORMATS if line == b"gigastep replay %d\n" % number]
    if not formats:
        raise ValueError(f"{path} is no replay of the formats {FORMATS}")
    try:
        stream = zlib.decompressobj()
        raw = stream.decompress(rest)
        if not stream.eof or stream.unused_data:
            raise ValueError("it ends too early, or something follows its end")
        return read_columns(formats[0], memoryview(raw))
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError, zlib.error) as error:
        raise ValueError(f"{path} is damaged: {error}") from error


def read_columns(number, raw):
    at = 4 + int.from_bytes(raw[:4], "little")
    replay = json.loads(bytes(raw[4:at]))
    replay["format"] = number
    if sum(agent.get("count", 1) for agent in replay["agents"]) > MOST:
        raise ValueError("it has too many agents")
    replay["agents"] = [agent for agent in replay["agents"] for _ in range(agent.get("count", 1))]

    def take(size):
        nonlocal at
        at += size
        if not 0 <= size <= at <= len(raw):
            raise ValueError("a column ends behind the last byte")
        return bytes(raw[at - size:at])

    replay["episodes"] = [Episode(replay, head, take) for head in replay["episodes"]]
    if at != len(raw):
        raise ValueError("something follows the columns")
    return replay


def main(path):
    replay = read_replay(path)
    print(f"{replay['players'][0]} against {replay['players'][1]} in {replay['scenario_name']}")
    for k, episode in enumerate(replay["episodes"]):
        head = episode.head
        print(f"episode {k}: {head['steps']} steps on {replay['maps'][head['map']]['name']}, winner: {head['winner']}")
        for event in head["events"]:
            if event["what"] in ("death", "collected"):
                i, t = event["agent"], event["step"]
                what = f"dies ({head['cause'][i]})" if event["what"] == "death" else "collects a waypoint"
                by = f", by agent {event['other']}" if event["other"] >= 0 else ""
                print(f"  step {t:4}: agent {i} {what}{by} at "
                      f"({episode.x[i][t]:.2f}, {episode.y[i][t]:.2f}), altitude {episode.z[i][t]:.1f}")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: read_replay.py FILE.replay")
    try:
        main(sys.argv[1])
    except (OSError, ValueError) as error:
        sys.exit(str(error))
