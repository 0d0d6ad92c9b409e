// Replays as they lie in the page: unpacked, and asked. docs/replays.md describes the format.

const PI2 = 2 * Math.PI;

// Bits [pairs, states].
class Bits {
  constructor(data, states) { this.data = data; this.row = (states + 7) >> 3; }
  at(pair, state) { return this.data[pair * this.row + (state >> 3)] >> (state & 7) & 1; }
}

// The most agents of which pairs are kept; those of a larger team whose minds are; the most of a world.
const PAIRED = 1024, MINDS = 64, MOST = 4194304;

// What can be asked of an episode: states by agent and step, and who detected, shot and heard whom. `states` is the length
// of a row, `steps` the last state. Of a crowd, which has more agents than PAIRED, it is kept who is seen, not by whom.
class EpisodeBase {
  constructor(replay, head) {
    this.replay = replay; this.head = head; this.n = replay.agents.length; this.crowd = this.n > PAIRED;
    this.teams = [0, 1].map(team => replay.agents.filter(agent => agent.team === team).length);
  }
  team(i) { return i < this.teams[0] ? 0 : 1; }
  alive(i, state) { const died = this.head.died[i]; return died < 0 || state < died; }
  living(team, state) {
    let count = 0;
    for (let i = 0; i < this.n; ++i) if (this.team(i) === team && this.alive(i, state)) ++count;
    return count;
  }
  opponents(i) { return this.team(i) ? [0, this.teams[0]] : [this.teams[0], this.n]; }
  pair(target, opponent) {
    const [n0, n1] = this.teams;
    return target < n0 ? target * n1 + opponent - n0 : n0 * n1 + (target - n0) * n0 + opponent;
  }
  detects(observer, target, state) { return this.sees.at(this.pair(target, observer), state); }
  // Of a crowd: whether the observation of any living opponent has the agent.
  seen(target, state) { return this.sees.at(target, state) === 1; }
  // Who fires at whom: [shooter, target, steps so far]. `fire` is ordered by the first state.
  firing(state) {
    const all = [], {from, to, target, shooter} = this.fire;
    for (let k = 0; k < from.length && from[k] <= state; ++k)
      if (state <= to[k]) all.push([shooter[k], target[k], state - from[k] + 1]);
    return all;
  }
  // Agents of a team whose minds are kept.
  minded(team) { return this.crowd ? Math.min(this.teams[team], MINDS) : this.teams[team]; }
  tracks(shooter, target, state) { return this.fires.at(this.pair(target, shooter), state); }
  // Steps of unbroken fire so far, as far as they count.
  tracked(shooter, target, state) {
    const pair = this.pair(target, shooter), most = this.replay.rules.max_tracking_time;
    let count = 0;
    while (count <= most && state - count >= 0 && this.fires.at(pair, state - count)) ++count;
    return count;
  }
  // Whether `listener` hears `mate`; null where that is not kept.
  hearing(listener, mate, state) {
    if (!this.replay.rules.hearing_range) return this.alive(mate, state);
    if (!this.hears) return null;
    const team = this.team(listener), first = team * this.teams[0], n = this.teams[team];
    const row = (listener - first) * (n - 1) + mate - first - (mate > listener ? 1 : 0);
    return this.hears.at(row + (team ? this.teams[0] * (this.teams[0] - 1) : 0), state) === 1;
  }
  // Who of its team tells agent i what it sees, itself included.
  sources(i, state) {
    const all = [i], first = this.team(i) * this.teams[0];
    for (let b = first; b < first + this.teams[this.team(i)]; ++b)
      if (b !== i && this.alive(b, state) && this.hearing(i, b, state)) all.push(b);
    return all;
  }
  // Opponents that agent i knows of, as far as that is kept.
  known(i, state) {
    if (this.crowd) return [];
    const sources = this.sources(i, state), [from, to] = this.opponents(i), all = [];
    for (let a = from; a < to; ++a) if (sources.some(b => this.detects(b, a, state))) all.push(a);
    return all;
  }
  waypoint(state) { return this.head.waypoints.find(w => w.from <= state && state <= w.to); }
  value(i, state) {
    const mind = this.minds[this.team(i)], row = i - this.team(i) * this.teams[0];
    if (!mind.value.length || row >= this.minded(this.team(i))) return null;
    return mind.low + (mind.high - mind.low) * mind.value[row * this.states + state] / 31;
  }
  // The likeliest actions of agent i in a state: [action, probability]; continuous: three means.
  likely(i, state) {
    const team = this.team(i), mind = this.minds[team], rows = this.minded(team), row = i - team * this.teams[0];
    if (!mind.likely.length || row >= rows) return null;
    const at = rank => (rank * rows + row) * this.states + state;
    if (this.replay.actions !== "discrete") return [0, 1, 2].map(k => (mind.likely[at(k)] - 128) / 127);
    return [...Array(mind.top).keys()].map(rank => [mind.likely[at(rank)], mind.probability[at(rank)] / 15]);
  }
  // What agent i does in step `state`: its number, or three controls.
  actionAt(i, state) {
    if (state >= this.steps || !this.alive(i, state)) return null;
    const at = i * this.steps + state;
    return this.replay.actions === "discrete" ? this.action[at] : [...this.action.slice(3 * at, 3 * at + 3)];
  }
  // The controls of that: heading, dive, throttle, from -1 to 1.
  controls(i, state, action = this.action) {
    const at = i * this.steps + state;
    if (this.replay.actions === "discrete") return controlsOf(action[at]);
    return [0, 1, 2].map(k => Math.min(Math.max(action[3 * at + k], -1), 1));
  }
  boxes() { return this.replay.maps[this.head.map].boxes; }
}

// One that was read from a file.
class Episode extends EpisodeBase {
  constructor(replay, head, take) {
    super(replay, head);
    const {n} = this, steps = head.steps, states = steps + 1;
    this.steps = steps; this.states = states;
    if (this.crowd) this.readDeaths(take);
    const discrete = replay.actions === "discrete", actions = take(n * steps * (discrete ? 1 : 12));
    this.action = discrete ? actions : new Float32Array(actions.slice().buffer);
    this.readStates(take);
    const bytes = (states + 7) >> 3, opponents = 2 * this.teams[0] * this.teams[1] * bytes;
    const mates = n > 64 ? 0 : this.teams.reduce((sum, m) => sum + m * (m - 1), 0) * bytes;
    this.sees = new Bits(take(this.crowd ? n * bytes : opponents), states);
    this.fires = this.crowd ? null : new Bits(take(opponents), states);
    this.hears = mates || n <= 64 ? new Bits(take(mates), states) : null;
    this.minds = [0, 1].map(team => {
      const mind = head[`mind_${team}`], rows = this.minded(team) * states;
      const value = take(mind.low < mind.high ? rows : 0);
      for (let k = 0; k < value.length; ++k) if (k % states) value[k] += value[k - 1];
      return {...mind, value,
              likely: byRank(take(discrete ? mind.top * rows : mind.top ? 3 * rows : 0), rows),
              probability: byRank(take(discrete ? mind.top * rows : 0), rows)};
    });
    if (this.crowd) this.readFire(take); else this.addHits();
  }
  // What states differ by from where the actions lead.
  readStates(take) {
    const {n, states, head} = this, start = new Float32Array(take(20 * n).slice().buffer);
    const {limit_x, limit_y} = this.replay.rules;
    this.place = placeUnit(Math.max(limit_x, limit_y), this.crowd);
    const apart = FLIGHT.map(() => unfolded(take(2 * n * states), n * states));
    for (const name of FLIGHT) this[name] = new Float32Array(n * states);
    for (let i = 0; i < n; ++i) {
      const flight = new ExpectedFlight(this.replay, i, FLIGHT.map((_, c) => start[c * n + i])), {units} = flight;
      for (let s = 0, at = i * states; s < states; ++s, ++at) {
        if (s > 0 && (head.died[i] < 0 || s <= head.died[i])) flight.step(this.controls(i, s - 1));
        const expected = flight.numbers(), actual = expected.map((number, c) => (number + apart[c][at]) << 16 >> 16);
        flight.correct(expected, actual);
        FLIGHT.forEach((name, c) => { this[name][at] = actual[c] * units[c]; });
      }
    }
    const health = unfolded(take(2 * n * states), n * states), unit = healthUnit(this.replay.rules);
    this.health = new Float32Array(n * states);
    for (let at = 0, value = 0; at < n * states; ++at) {
      value = (at % states ? value : 0) + health[at];
      this.health[at] = unit * value;
    }
  }
  // Fire does damage from the step after `min_tracking_time` on.
  addHits() {
    const hits = [], most = this.replay.rules.min_tracking_time + 1;
    for (let target = 0; target < this.n; ++target) {
      const [from, to] = this.opponents(target);
      for (let shooter = from; shooter < to; ++shooter) {
        const pair = this.pair(target, shooter);
        for (let step = 0, unbroken = 0; step < this.states; ++step) {
          unbroken = this.fires.at(pair, step) ? unbroken + 1 : 0;
          if (unbroken === most) hits.push({step, what: "hit", agent: shooter, other: target});
        }
      }
    }
    this.head.events = [...this.head.events, ...hits].sort((a, b) => a.step - b.step);
  }
  // Of a crowd, these are columns: who died when, of what, and shot by whom.
  readDeaths(take) {
    const {n, head} = this, causes = ["none", "damage", "agent", "obstacle", "out_of_bounds"];
    const died = numbers(take(4 * n), n), cause = take(n), by = numbers(take(4 * n), n), deaths = [];
    head.died = Array.from(died, value => value - 1);
    head.cause = Array.from(cause, value => causes[value]);
    for (let i = 0; i < n; ++i) if (died[i]) deaths.push({step: died[i] - 1, what: "death", agent: i, other: by[i] - 1});
    head.events = [...head.events, ...deaths].sort((a, b) => a.step - b.step);
  }
  readFire(take) {
    const [count] = numbers(take(4), 1), column = () => numbers(take(4 * count), count);
    const from = column(), to = column(), target = column(), shooter = column();
    for (let k = 0; k < count; ++k) { from[k] += k ? from[k - 1] : 0; to[k] += from[k]; }
    this.fire = {from, to, target, shooter};
  }
}

// 32-bit numbers: all lowest bytes, then those above them, and so on.
function numbers(data, count) {
  const values = new Uint32Array(count);
  for (let k = 0; k < 4 * count; ++k) values[k % count] |= data[k] << 8 * Math.floor(k / count);
  return values;
}

// Low bytes, then high ones, of numbers that are folded to 0, -1, 1, -2, 2, ...
function unfolded(data, count) {
  const numbers = new Int32Array(count);
  for (let k = 0; k < count; ++k) {
    const folded = data[k] | data[count + k] << 8;
    numbers[k] = folded & 1 ? -(folded + 1) / 2 : folded / 2;
  }
  return numbers;
}

// [ranks, rows] of [rows, ranks].
const byRank = (data, rows) => data.map((_, k) => data[k % rows * (data.length / rows) + Math.floor(k / rows)]);

const FLIGHT = ["x", "y", "z", "heading", "speed"];
const nearest = number => Math.sign(number) * Math.floor(Math.abs(number) + 0.5);
const int16 = number => Math.max(-32768, Math.min(32767, nearest(number)));

// Of x and y.
const placeUnit = (longer, crowd) =>
  crowd ? Math.max(Math.fround(Math.fround(longer) / 30000), Math.fround(0.01)) : Math.fround(Math.fround(longer) / 5000);

const healthUnit = rules => Math.fround(rules.health_unit);

// Where an agent is expected next (docs/replays.md), in the order of FLIGHT. Numbers of the header are 32-bit floats.
class ExpectedFlight {
  constructor(replay, i, start) {
    const f = Math.fround, {rules, flight} = replay;
    const place = placeUnit(Math.max(rules.limit_x, rules.limit_y), replay.agents.length > PAIRED);
    this.units = [place, place, f(0.02), PI2 / 65536, f(0.05)];
    this.now = [...start];
    this.dt = f(rules.seconds_per_step); this.top = f(rules.limit_z); this.turn = f(flight.turn_rate);
    this.climb = f(flight.climb_rate); this.thrust = f(flight.thrust) * f(replay.agents[i].thrust); this.drag = f(flight.drag);
    this.gravity = f(flight.half_gravity); this.least = f(flight.min_speed) * f(flight.min_speed);
  }
  numbers() {
    const [x, y, z, heading, speed] = this.now, [place, , height, , fast] = this.units;
    return [int16(x / place), int16(y / place), int16(z / height), nearest(heading / PI2 * 1024) * 64 << 16 >> 16,
            int16(speed / fast)];
  }
  step([turn, dive, throttle]) {
    let [x, y, z, heading, speed] = this.now;
    const {dt} = this;
    heading += dt * this.turn * turn;
    const pushed = speed + dt * this.thrust * throttle, flown = pushed - this.drag * pushed * pushed;
    x += dt * flown * Math.cos(heading);
    y += dt * flown * Math.sin(heading);
    const above = Math.min(Math.max(z + dt * this.climb * dive, 0), this.top);
    speed = Math.sqrt(Math.max(flown * flown + this.gravity * (z - above), this.least));
    this.now = [x, y, above, heading, speed];
  }
  // What differs by more than a rounding becomes what is so.
  correct(expected, actual) {
    for (let c = 0; c < FLIGHT.length; ++c)
      if (Math.abs((actual[c] - expected[c]) << 16 >> 16) > (c === 3 ? 64 : 1)) this.now[c] = actual[c] * this.units[c];
  }
}

// What was clicked does not keep the keyboard: Space and Enter are keys of the game. Whoever goes from control to control
// by the keyboard has no pointer in the click (detail 0), and the control keeps it.
const leaveKeysTo = field => addEventListener("click", event => {
  const control = event.target.closest("button, summary, input[type=checkbox], label");
  if (event.detail > 0 && control && !control.querySelector("select")) field().focus({preventScroll: true});
});

// A replay that this page cannot show; the message says why.
class BadReplay extends Error {}
const OLDEST_FORMAT = 3, NEWEST_FORMAT = 4;

// What the first line of a replay announces, unpacked.
async function unpackReplay(bytes) {
  const end = bytes.indexOf(10);
  const format = /^gigastep replay ([1-9]\d*)$/.exec(new TextDecoder().decode(bytes.subarray(0, Math.max(end, 0))));
  if (!format) throw new BadReplay("a replay is damaged: its first line makes no sense");
  if (format[1] > NEWEST_FORMAT)
    throw new BadReplay(`a replay has format ${format[1]}, newer than ${NEWEST_FORMAT}, which this page reads`);
  if (format[1] < OLDEST_FORMAT)
    throw new BadReplay(`a replay has format ${format[1]}, older than ${OLDEST_FORMAT}, which this page reads`);
  if (typeof DecompressionStream === "undefined") throw new BadReplay("a browser of 2023 or later is needed");
  const stream = new Blob([bytes.subarray(end + 1)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer().catch(() => {
    throw new BadReplay("a replay is damaged: it ends too early, or its bytes were changed");
  }));
}

// What a header may leave out, as in lib/io/replay.hpp.
const RULES = {limit_x: 10, limit_y: 10, limit_z: 10, seconds_per_step: 0.1, health_unit: 0.01};

// All that is wrong with what was unpacked is told alike: programs of ours do not write it.
async function readReplay(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; ++k) bytes[k] = text.charCodeAt(k);
  const raw = await unpackReplay(bytes);
  try {
    return readColumns(raw);
  } catch {
    throw new BadReplay("a replay is damaged: its parts do not fit together");
  }
}
function readColumns(raw) {
  let at = 4 + new DataView(raw.buffer).getUint32(0, true);
  const replay = JSON.parse(new TextDecoder().decode(raw.subarray(4, at)));
  replay.rules = {...RULES, ...replay.rules};
  const numbers = [...["limit_x", "limit_y", "limit_z", "seconds_per_step"].map(key => replay.rules[key]), replay.agents.length];
  if (!numbers.every(number => number > 0 && number < 1e6)) throw new RangeError("rules without sense");
  if (!(replay.agents.reduce((sum, {count = 1}) => sum + count, 0) <= MOST)) throw new RangeError("too many agents");
  if (!replay.agents.every(({team}) => team === 0 || team === 1)) throw new RangeError("a third team");
  replay.agents = replay.agents.flatMap(({count = 1, ...agent}) => Array(count).fill(agent));  // of a crowd, alike ones
  const take = size => {
    at += size;
    if (!(size >= 0 && at <= raw.length)) throw new RangeError("a column ends behind the last byte");
    return raw.subarray(at - size, at);
  };
  replay.episodes = replay.episodes.map(head => {
    if (!(Number.isInteger(head.steps) && head.steps > 0)) throw new RangeError("no steps");
    if (!Array.isArray(replay.maps[head.map].boxes)) throw new RangeError("no map");
    return new Episode(replay, head, take);
  });
  if (at !== raw.length) throw new RangeError("something follows the columns");
  return replay;
}

// Actions in words.
const controlsOf = action =>
  typeof action === "number" ? [Math.floor(action / 3) % 3 - 1, action % 3 - 1, Math.floor(action / 9) - 1] : action;
function actionText(action) {
  const words = [["right", "left"], ["dive", "climb"], ["slower", "faster"]];
  const parts = controlsOf(action).map((control, k) => {
    if (Math.abs(control) < 0.05) return "";
    const word = words[k][control > 0 ? 1 : 0];
    return typeof action === "number" ? word : `${word} ${Math.abs(control).toFixed(2)}`;
  }).filter(part => part);
  return parts.join(", ") || "straight on";
}
function eventText(episode, event) {
  const name = i => `agent ${i}`;
  switch (event.what) {
    case "contact": return `team ${episode.team(event.agent)} detects an opponent: ${name(event.agent)} sees ${name(event.other)}`;
    case "hit": return `${name(event.agent)} hits ${name(event.other)}`;
    case "waypoint": return "a waypoint appears";
    case "collected": return `${name(event.agent)} reaches the waypoint`;
    case "end": return endText(episode);
  }
  const cause = {damage: "is shot down", agent: "collides with an agent", obstacle: "hits an obstacle",
                 out_of_bounds: "leaves the map"}[episode.head.cause[event.agent]];
  return `${name(event.agent)} ${cause}${event.other >= 0 ? ` by ${name(event.other)}` : ""}`;
}
function endText(episode) {
  const {winner, at_time_limit} = episode.head;
  return (winner === "tie" ? "a tie" : `${winner.replace("_", " ")} wins`) + (at_time_limit ? " at the time limit" : "");
}
