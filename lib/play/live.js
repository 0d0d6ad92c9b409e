// A game that is being played: an episode as replays have them, which grows, and the file that it becomes. What is noted,
// and in which order, is what the program's recorder does (lib/eval/recorded_world.cpp); `record --verify` compares all of it.

const CRC_TABLE = Uint32Array.from({length: 256}, (_, n) => {
  for (let k = 0; k < 8; ++k) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});
const crc32 = (bytes, before = 0) => {
  let crc = ~before;
  for (const byte of bytes) crc = CRC_TABLE[(crc ^ byte) & 255] ^ (crc >>> 8);
  return ~crc >>> 0;
};

const CAUSES = ["none", "damage", "agent", "obstacle", "out_of_bounds"];
const STATES = {x: "x", y: "y", z: "z", speed: "v", heading: "heading", health: "health"};

class LiveEpisode extends EpisodeBase {
  // `states`: the most that it may come to have. `frame`: a replay without games. `unseen`: agents are shown a waypoint
  // while it stays longer than so many seconds. `deadCollect`: waypoints, as under the original's rules.
  constructor(frame, states, unseen, deadCollect) {
    const n = frame.agents.length;
    super(frame, {map: 0, steps: 0, winner: "tie", at_time_limit: false, returns: [0, 0], score: [0, 0], died: Array(n).fill(-1),
                  cause: Array(n).fill("none"), events: [], waypoints: []});
    this.deadCollect = deadCollect; this.unseen = unseen; this.shownTo = -1;  // the last state at which agents are shown the waypoint that is there
    this.states = states; this.steps = -1; this.over = false; this.check = 0; this.contact = [false, false];
    for (const column of Object.keys(STATES)) this[column] = new Float32Array(n * states);
    const bits = pairs => new Bits(new Uint8Array(pairs * ((states + 7) >> 3)), states), [n0, n1] = this.teams;
    this.sees = bits(2 * n0 * n1);
    this.fires = bits(2 * n0 * n1);
    this.hears = n <= 64 ? bits(n0 * (n0 - 1) + n1 * (n1 - 1)) : null;
    this.discrete = frame.actions === "discrete";
    this.done = [];  // by step: the actions of all agents
  }
  mates(listener, mate) {
    const team = this.team(listener), first = team * this.teams[0], n = this.teams[team];
    const row = (listener - first) * (n - 1) + mate - first - (mate > listener ? 1 : 0);
    return row + (team ? this.teams[0] * (this.teams[0] - 1) : 0);
  }
  // What agents know of a waypoint, near the present.
  shownWaypoint(state) { return state <= this.shownTo ? this.waypoint(state) : undefined; }
  event(what, agent = -1, other = -1) { this.head.events.push({step: this.steps, what, agent, other}); }

  // What was done in the step that was taken last.
  noteActions(game) {
    const size = this.discrete ? 1 : 3, all = new (this.discrete ? Uint8Array : Float32Array)(this.n * size);
    for (const team of [0, 1])
      all.set(game.actions(team, this.discrete ? Int32Array : Float32Array, this.teams[team] * size), team * this.teams[0] * size);
    this.done.push(all);
  }
  // The state as it is now.
  noteState(game, over) {
    const {n, head, states} = this, state = ++this.steps, words = (n + 31) >> 5, rules = this.replay.rules;
    const field = (name, Type, count = n) => game.field(name, Type, count);
    const add = array => { this.check = crc32(new Uint8Array(array.buffer, array.byteOffset, array.byteLength), this.check); };
    for (const name of ["x", "y", "z", "v", "heading", "health"]) add(field(name, Float32Array));
    const alive = field("alive", Uint8Array), death = field("death", Uint8Array);
    add(alive);
    head.map = field("map", Int32Array, 1)[0];
    head.steps = state;
    for (const [column, name] of Object.entries(STATES)) {
      const now = field(name, Float32Array);
      for (let i = 0; i < n; ++i) this[column][i * states + state] = now[i];
    }
    const tracked = field("tracked", Uint8Array, n * n), detected = field("detected", Uint32Array, n * words);
    const seen = field("seen", Uint32Array, n * words), bit = (rows, a, b) => rows[a * words + (b >> 5)] >>> (b & 31) & 1;
    const set = (bits, pair) => { bits.data[pair * bits.row + (state >> 3)] |= 1 << (state & 7); };
    for (let a = 0; a < n; ++a) {
      let shooter = -1;
      for (let b = 0; b < n; ++b) {
        if (this.team(a) === this.team(b)) {
          if (a !== b && this.hears && alive[a] && bit(seen, a, b)) set(this.hears, this.mates(a, b));
          continue;
        }
        const steps = tracked[a * n + b];
        if (steps > 0) set(this.fires, this.pair(a, b));
        if (steps === rules.min_tracking_time + 1) this.event("hit", b, a);
        if (steps > rules.min_tracking_time) shooter = b;
        if (!bit(detected, a, b)) continue;
        set(this.sees, this.pair(a, b));
        if (!this.contact[this.team(b)]) { this.contact[this.team(b)] = true; this.event("contact", b, a); }
      }
      if (alive[a] || head.died[a] >= 0) continue;
      head.died[a] = state;
      head.cause[a] = CAUSES[death[a]];
      this.event("death", a, head.cause[a] === "damage" ? shooter : -1);
    }
    this.over = over;
    const score = field("score", Float32Array, 2), last = head.waypoints.at(-1);
    for (const team of [0, 1]) {
      const now = over ? game.stat(`score_${team}`) : score[team];
      head.returns[team] = game.stat(`return_${team}`);
      if (now > head.score[team] && last)
        for (let i = team * this.teams[0]; i < team * this.teams[0] + this.teams[team]; ++i) {
          const x = this.x[i * states + state], y = this.y[i * states + state];
          if (!this.deadCollect && head.died[i] >= 0 && head.died[i] < state) continue;
          if (x < last.x1 || x > last.x2 || y < last.y1 || y > last.y2) continue;
          this.event("collected", i);
          break;
        }
      head.score[team] = now;
    }
    this.noteWaypoint(field("waypoint", Float32Array, 4), field("waypoint_time", Float32Array, 1)[0]);
    if (!over) return;
    head.at_time_limit = game.stat("truncated") > 0;
    head.winner = game.stat("wins_0") > 0 ? "team_0" : game.stat("wins_1") > 0 ? "team_1" : "tie";
  }
  noteWaypoint([x1, y1, x2, y2], time) {
    const {waypoints} = this.head, last = waypoints.at(-1), state = this.steps;
    if (!this.replay.rules.waypoints || !(time > 0)) return;
    if (time > this.unseen) this.shownTo = state;
    if (last && last.to === state - 1 && last.x1 === x1 && last.y1 === y1) { last.to = state; return; }
    waypoints.push({from: state, to: state, x1, y1, x2, y2});
    this.event("waypoint");
  }

  // The first state, what states differ by from where the actions lead, and health.
  stateColumns(action) {
    const {n} = this, states = this.steps + 1, at = (i, s) => i * this.states + s, f = Math.fround;
    const unit = healthUnit(this.replay.rules);
    const start = new Float32Array(5 * n);
    FLIGHT.forEach((name, c) => { for (let i = 0; i < n; ++i) start[c * n + i] = this[name][at(i, 0)]; });
    const columns = Array.from({length: 6}, () => new Uint8Array(2 * n * states));
    const put = (column, k, number) => {
      const apart = number << 16 >> 16, folded = apart < 0 ? -2 * apart - 1 : 2 * apart;
      columns[column][k] = folded;
      columns[column][n * states + k] = folded >> 8;
    };
    for (let i = 0; i < n; ++i) {
      const flight = new ExpectedFlight(this.replay, i, FLIGHT.map((_, c) => start[c * n + i])), {units} = flight;
      for (let s = 0, health = 0; s < states; ++s) {
        if (s > 0 && (this.head.died[i] < 0 || s <= this.head.died[i])) flight.step(this.controls(i, s - 1, action));
        const expected = flight.numbers(), actual = FLIGHT.map((name, c) => {
          const value = this[name][at(i, s)];
          return c === 3 ? nearest(value * (1024 / PI2)) * 64 << 16 >> 16 : int16(f(value / units[c]));
        });
        flight.correct(expected, actual);
        for (let c = 0; c < 5; ++c) put(c, i * states + s, actual[c] - expected[c]);
        const now = int16(f(this.health[at(i, s)] / unit));
        put(5, i * states + s, now - health);
        health = now;
      }
    }
    return [new Uint8Array(start.buffer), ...columns];
  }

  // The game as a file, once it is over.
  async file(seed, players) {
    const {n, head} = this, steps = this.steps, states = steps + 1, parts = [];
    // The dead do nothing.
    const size = this.discrete ? 1 : 3, action = new (this.discrete ? Uint8Array : Float32Array)(n * steps * size);
    for (let i = 0; i < n; ++i)
      for (let t = 0; t < steps; ++t)
        for (let k = 0; k < size; ++k)
          action[(i * steps + t) * size + k] = this.alive(i, t) ? this.done[t][i * size + k] : this.discrete ? 13 : 0;
    const actions = new Uint8Array(action.buffer), row = (states + 7) >> 3;
    parts.push(actions, ...this.stateColumns(action));
    for (const bits of [this.sees, this.fires, this.hears]) {
      if (!bits) continue;
      const pairs = bits.data.length / bits.row, cut = new Uint8Array(pairs * row);
      for (let pair = 0; pair < pairs; ++pair) cut.set(bits.data.subarray(pair * bits.row, pair * bits.row + row), pair * row);
      parts.push(cut);
    }
    const nothing = {low: 0, high: 0, top: 0}, text = new TextEncoder();
    const events = head.events.filter(event => event.what !== "hit");  // as `fires` tells them
    const episode = {...head, events, mind_0: nothing, mind_1: nothing, action_check: crc32(actions, crc32(text.encode(seed))),
                     state_check: this.check};
    const header = text.encode(JSON.stringify({...this.replay, seed, players, origins: ["", ""], episodes: [episode]}));
    const length = new Uint8Array(4);
    new DataView(length.buffer).setUint32(0, header.length, true);
    const packed = new Blob([length, header, ...parts]).stream().pipeThrough(new CompressionStream("deflate"));
    return new Uint8Array(await new Response(new Blob(["gigastep replay 3\n", await new Response(packed).arrayBuffer()])).arrayBuffer());
  }
}
