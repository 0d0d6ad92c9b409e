// Draws one state of an episode on a canvas: from above, or in three dimensions by a camera that goes round the field.

class Camera {
  constructor(rules) {
    this.rules = rules; this.solid = false; this.yaw = -0.5; this.tilt = 0.95; this.zoom = 1; this.moved = [0, 0];
  }
  fit(width, height) {
    const {limit_x, limit_y} = this.rules, margin = 14;
    this.width = width; this.height = height;
    const flat = Math.min((width - 2 * margin) / limit_x, (height - 2 * margin) / limit_y);
    this.scale = this.zoom * (this.solid ? 0.93 * Math.min(width, height * 1.3) / Math.hypot(limit_x, limit_y) : flat);
    this.cos = Math.cos(this.yaw); this.sin = Math.sin(this.yaw);
    this.up = Math.cos(this.tilt); this.flat = Math.sin(this.tilt);
    this.distance = 2.2 * Math.hypot(limit_x, limit_y);
  }
  // A place of the game -> [pixels right, pixels down, distance behind the middle, pixels of a unit].
  at(x, y, z) {
    const {limit_x, limit_y, limit_z} = this.rules, dx = x - limit_x / 2, dy = y - limit_y / 2;
    const middle = [this.width / 2 + this.moved[0], this.height / 2 + this.moved[1]];
    if (!this.solid) return [middle[0] + dx * this.scale, middle[1] - dy * this.scale, -z, this.scale];
    // Altitudes go from 0 to 10 on any map; they are drawn at a third of the map's height.
    const dz = (z / limit_z - 0.25) * Math.max(limit_x, limit_y) / 3;
    const right = dx * this.cos - dy * this.sin, away = dx * this.sin + dy * this.cos;
    const depth = away * this.flat - dz * this.up, down = -away * this.up - dz * this.flat;
    const near = this.distance / (this.distance + depth) * this.scale;
    return [middle[0] + right * near, middle[1] + down * near, depth, near];
  }
}

const TRAIL = 30;               // steps
const MANY = 100, CROWD = 200;  // of more agents less is drawn; and what is drawn, at once

class Scene {
  constructor(canvas, episode, options) {
    this.canvas = canvas; this.pen = canvas.getContext("2d"); this.options = options;
    this.camera = new Camera(episode.replay.rules);
    this.show(episode);
  }
  show(episode) {
    this.episode = episode; this.camera.rules = episode.replay.rules; this.cache = null; this.places = [];
    this.kinds = [...new Set(episode.replay.agents.map(agent => agent.kind))];
  }

  // A number between states: positions and headings lie between them too.
  place(i, time) {
    const e = this.episode, k = Math.min(Math.floor(time), e.steps), next = Math.min(k + 1, e.steps), share = time - k;
    const a = i * e.states + k, b = i * e.states + next, mix = column => column[a] + share * (column[b] - column[a]);
    let turn = e.heading[b] - e.heading[a];
    turn -= PI2 * Math.round(turn / PI2);
    return {x: mix(e.x), y: mix(e.y), z: mix(e.z), heading: e.heading[a] + share * turn};
  }

  // What depends on the whole step alone: who is known to the chosen side, who fires at whom. options.eyes: an agent, of
  // whose knowledge alone all is drawn; options.hide: who is not known is not drawn.
  facts(state) {
    const {side, eyes = -1} = this.options, e = this.episode;
    if (this.cache && this.cache.state === state && this.cache.side === side && this.cache.eyes === eyes) return this.cache;
    const contacts = [], fire = [], known = new Uint8Array(e.n).fill(side < 0 ? 1 : 0);
    if (e.crowd) {
      for (let a = 0; a < e.n; ++a) if (e.team(a) === side || e.seen(a, state)) known[a] = 1;
      for (const [b, a, steps] of e.firing(state)) fire.push([b, a, steps > e.replay.rules.min_tracking_time]);
      return this.cache = {state, side, eyes, contacts, fire, known};
    }
    for (let a = 0; a < e.n; ++a) {
      if (e.team(a) === side) known[a] = 1;
      if (!e.alive(a, state)) continue;
      const [from, to] = e.opponents(a);
      for (let b = from; b < to; ++b) {
        if (e.detects(b, a, state)) {
          if (side < 0 || e.team(b) === side) { contacts.push([b, a]); known[a] = 1; }
        }
        if (e.tracks(b, a, state)) fire.push([b, a, e.tracked(b, a, state) > e.replay.rules.min_tracking_time]);
      }
    }
    if (eyes < 0) return this.cache = {state, side, eyes, contacts, fire, known};
    known.fill(0);
    for (const i of [...e.sources(eyes, state), ...e.known(eyes, state)]) known[i] = 1;
    const both = ([a, b]) => known[a] && known[b];
    return this.cache = {state, side, eyes, contacts: contacts.filter(both), fire: fire.filter(both), known};
  }

  draw(time, chosen) {
    const {canvas, pen, camera, episode: e, options} = this, ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    camera.solid = options.view === "3d";
    camera.fit(width, height);
    const style = getComputedStyle(document.documentElement), colors = {};  // asking is slow, and thousands of agents ask
    this.color = name => colors[name] ??= style.getPropertyValue(`--${name}`);
    this.teamColor = [this.color("team-0"), this.color("team-1")];
    this.crowd = e.n > CROWD;
    const state = Math.min(Math.floor(time + 1e-6), e.steps), facts = this.facts(state);
    const places = [];
    for (let i = 0; i < e.n; ++i) places.push(this.place(i, time));
    this.places = places.map(p => camera.at(p.x, p.y, p.z));

    pen.fillStyle = this.color("field");
    pen.fillRect(0, 0, width, height);
    this.drawGround(state);
    if (options.sight || chosen >= 0) this.drawCones(places, state, facts, "sight", chosen);
    if (options.weapon) this.drawCones(places, state, facts, "weapon", chosen);
    if (options.trails) this.drawTrails(time, state, facts);
    if (camera.solid) this.drawPoles(places, state, facts);
    this.drawBoxes();
    if (options.contacts) this.drawLines(facts.contacts, ([b]) => this.teamColor[e.team(b)], 1, [2, 4], 0.7);
    if (options.fire) {
      this.drawLines(facts.fire.filter(([, , hits]) => !hits), () => this.color("fire"), 1, [5, 4], 0.8);
      this.drawLines(facts.fire.filter(([, , hits]) => hits), () => this.color("fire"), 2.6, [], 0.95);
    }
    if (chosen >= 0) this.drawChosen(chosen, state);
    if (options.pilot >= 0) this.drawCourse(options.pilot, places, state);
    this.drawAgents(places, state, facts, chosen);
  }

  path(points, closed = true) { this.pen.beginPath(); this.extend(points, closed); }
  extend(points, closed) {
    const {pen} = this;
    for (let k = 0; k < points.length; ++k) k ? pen.lineTo(points[k][0], points[k][1]) : pen.moveTo(points[k][0], points[k][1]);
    if (closed) pen.closePath();
  }
  // Paths by team, in its colour: each by itself, so that they add up; those of a crowd at once, which takes a third less.
  paint(paths, closed, paint) {
    paths.forEach((all, team) => {
      this.pen.strokeStyle = this.pen.fillStyle = this.teamColor[team];
      if (this.crowd) this.pen.beginPath();
      for (const points of all) this.crowd ? this.extend(points, closed) : (this.path(points, closed), paint());
      if (this.crowd) paint();
    });
  }
  rectangle(x1, y1, x2, y2, z) {
    return [[x1, y1], [x2, y1], [x2, y2], [x1, y2]].map(([x, y]) => this.camera.at(x, y, z));
  }

  drawGround(state) {
    const {pen, camera, episode: e} = this, {limit_x, limit_y} = e.replay.rules;
    pen.lineWidth = 1;
    pen.strokeStyle = this.color("grid");
    const step = Math.max(limit_x, limit_y) / 10;
    for (let x = 0; x <= limit_x + 1e-6; x += step) { this.path([camera.at(x, 0, 0), camera.at(x, limit_y, 0)], false); pen.stroke(); }
    for (let y = 0; y <= limit_y + 1e-6; y += step) { this.path([camera.at(0, y, 0), camera.at(limit_x, y, 0)], false); pen.stroke(); }
    this.path(this.rectangle(0, 0, limit_x, limit_y, 0));
    pen.strokeStyle = this.color("quiet");
    pen.stroke();
    const waypoint = this.options.hide && e.shownWaypoint ? e.shownWaypoint(state) : e.waypoint(state);
    if (!waypoint) return;
    this.path(this.rectangle(waypoint.x1, waypoint.y1, waypoint.x2, waypoint.y2, 0));
    pen.globalAlpha = 0.35; pen.fillStyle = this.color("waypoint"); pen.fill();
    pen.globalAlpha = 1; pen.lineWidth = 2; pen.strokeStyle = this.color("waypoint"); pen.stroke();
  }

  // Faces far away first; a box hides what is behind it only roughly, as the field is to be seen.
  drawBoxes() {
    const {pen, camera, episode: e} = this;
    if (!camera.solid) {
      for (const [x1, y1, x2, y2] of e.boxes()) { this.path(this.rectangle(x1, y1, x2, y2, 0)); pen.fillStyle = this.color("wall"); pen.fill(); }
      return;
    }
    const faces = [];
    for (const [x1, y1, x2, y2, z1, z2] of e.boxes()) {
      const low = this.rectangle(x1, y1, x2, y2, z1), high = this.rectangle(x1, y1, x2, y2, z2);
      for (let k = 0; k < 4; ++k) faces.push([[low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]], "wall"]);
      faces.push([high, "wall-top"]);
    }
    const depth = face => face.reduce((sum, point) => sum + point[2], 0) / face.length;
    faces.sort((a, b) => depth(b[0]) - depth(a[0]));
    for (const [face, color] of faces) {
      this.path(face);
      pen.globalAlpha = 0.32; pen.fillStyle = this.color(color); pen.fill();
      pen.globalAlpha = 0.6; pen.lineWidth = 1; pen.strokeStyle = this.color("wall"); pen.stroke();
    }
    pen.globalAlpha = 1;
  }

  drawCones(places, state, facts, kind, chosen) {
    const {pen, camera, episode: e} = this, rules = e.replay.rules;
    const far = Math.hypot(rules.limit_x, rules.limit_y), cones = [[], []];
    for (let i = 0; i < e.n; ++i) {
      if (!e.alive(i, state) || !facts.known[i]) continue;
      if (kind === "sight" && !this.options.sight && i !== chosen) continue;
      const agent = e.replay.agents[i], factor = kind === "sight" ? agent.range : agent.damage_range;
      const depth = Math.min(rules[`${kind}_depth`] * Math.sqrt(factor), far), angle = Math.min(rules[`${kind}_angle`], Math.PI);
      if (!(depth > 0) || !(angle > 0)) continue;
      const {x, y, z, heading} = places[i], points = angle < Math.PI ? [camera.at(x, y, z)] : [];
      const parts = e.n > MANY ? 6 : 20;
      for (let k = 0; k <= parts; ++k) {
        const at = heading + angle * (2 * k / parts - 1);
        points.push(camera.at(x + depth * Math.cos(at), y + depth * Math.sin(at), z));
      }
      cones[e.team(i)].push(points);
    }
    pen.globalAlpha = kind === "sight" ? 0.07 : 0.14;
    this.paint(cones, true, () => pen.fill());
    pen.globalAlpha = 1;
  }

  drawTrails(time, state, facts) {
    const {pen, camera, episode: e} = this, from = Math.max(0, state - TRAIL);
    // Two pieces of each, the older one fainter.
    const pieces = [[[], []], [[], []]];
    pen.lineWidth = e.n > MANY ? 1 : 1.6;
    for (let i = 0; i < e.n; ++i) {
      // Where an opponent was before it was seen is nobody's to know.
      if (!facts.known[i] || (this.options.hide && e.team(i) !== this.options.side)) continue;
      const end = e.alive(i, state) ? state : e.head.died[i];
      if (end <= from) continue;
      const middle = (from + end) >> 1;
      for (const [piece, a, b] of [[0, from, middle], [1, middle, end]]) {
        const points = [];
        for (let k = a; k <= b; ++k) { const at = i * e.states + k; points.push(camera.at(e.x[at], e.y[at], e.z[at])); }
        if (b === state) points.push(this.places[i]);
        pieces[piece][e.team(i)].push(points);
      }
    }
    pieces.forEach((paths, piece) => { pen.globalAlpha = [0.22, 0.55][piece]; this.paint(paths, false, () => pen.stroke()); });
    pen.globalAlpha = 1;
  }

  drawPoles(places, state, facts) {
    const {pen, camera, episode: e} = this;
    pen.lineWidth = 1; pen.globalAlpha = 0.5;
    for (let i = 0; i < e.n; ++i) {
      if (!facts.known[i] || !e.alive(i, state)) continue;
      const {x, y} = places[i], foot = camera.at(x, y, 0);
      this.path([foot, this.places[i]], false);
      pen.strokeStyle = this.teamColor[e.team(i)]; pen.stroke();
      pen.beginPath(); pen.ellipse(foot[0], foot[1], 4, 2, 0, 0, PI2); pen.fillStyle = this.color("quiet"); pen.fill();
    }
    pen.globalAlpha = 1;
  }

  drawLines(pairs, color, width, dashes, alpha) {
    const {pen} = this;
    pen.lineWidth = width; pen.setLineDash(dashes); pen.globalAlpha = alpha;
    for (const pair of pairs) { this.path([this.places[pair[0]], this.places[pair[1]]], false); pen.strokeStyle = color(pair); pen.stroke(); }
    pen.setLineDash([]); pen.globalAlpha = 1;
  }

  // Whom the chosen agent hears, and of whom it knows.
  drawChosen(chosen, state) {
    const {episode: e} = this;
    if (!e.alive(chosen, state)) return;
    this.drawLines(e.sources(chosen, state).slice(1).map(b => [chosen, b]), () => this.color("quiet"), 1, [1, 4], 1);
    this.drawLines(e.known(chosen, state).map(a => [chosen, a]), () => this.teamColor[e.team(chosen)], 1.2, [], 0.8);
  }

  // Where an agent is in a second if it flies straight on.
  drawCourse(i, places, state) {
    const {camera, episode: e} = this, {x, y, z, heading} = places[i], way = e.speed[i * e.states + state];
    this.pen.lineWidth = 1.6; this.pen.strokeStyle = this.color("ink"); this.pen.globalAlpha = 0.6;
    this.path([this.places[i], camera.at(x + way * Math.cos(heading), y + way * Math.sin(heading), z)], false);
    this.pen.stroke();
    this.pen.globalAlpha = 1;
  }

  // Each kind has a shape of its own: points [ahead, left] of a size of 1.
  shape(kind) {
    const shapes = [
      [[1, 0], [-0.8, 0.65], [-0.45, 0], [-0.8, -0.65]],
      [[1, 0], [0, 0.7], [-0.9, 0], [0, -0.7]],
      [[1, 0], [0.2, 0.7], [-0.8, 0.7], [-0.8, -0.7], [0.2, -0.7]],
      [[1, 0], [-0.2, 0.8], [-0.6, 0.35], [-0.9, 0.35], [-0.9, -0.35], [-0.6, -0.35], [-0.2, -0.8]],
    ];
    return shapes[this.kinds.indexOf(kind) % shapes.length];
  }

  drawAgents(places, state, facts, chosen) {
    const {pen, camera, episode: e, options} = this, {limit_z} = e.replay.rules;
    const order = [...places.keys()].sort((a, b) => this.places[b][2] - this.places[a][2]);
    const many = [[], []];
    const usual = Math.max(3.2, Math.min(10, 0.32 * Math.min(camera.width, camera.height) / Math.sqrt(e.n) / 4.5));
    for (const i of order) {
      if (options.hide && !facts.known[i]) continue;
      const {x, y, z, heading} = places[i], [px, py, , unit] = this.places[i], alive = e.alive(i, state);
      const agent = e.replay.agents[i], color = this.teamColor[e.team(i)];
      // From above the higher is the larger; in three dimensions the nearer is.
      const size = usual * (camera.solid ? unit / camera.scale : 0.75 + 0.5 * z / limit_z);
      if (!alive) {
        pen.globalAlpha = 0.5; pen.strokeStyle = color; pen.lineWidth = 1.5;
        const r = 0.55 * usual;
        this.path([[px - r, py - r], [px + r, py + r]], false); pen.stroke();
        this.path([[px - r, py + r], [px + r, py - r]], false); pen.stroke();
        pen.globalAlpha = 1;
        continue;
      }
      // The direction on the screen.
      const step = 0.01 * Math.max(e.replay.rules.limit_x, e.replay.rules.limit_y);
      const ahead = camera.at(x + step * Math.cos(heading), y + step * Math.sin(heading), z);
      const angle = Math.atan2(ahead[1] - py, ahead[0] - px), cos = Math.cos(angle), sin = Math.sin(angle);
      const outline = this.shape(agent.kind).map(([a, l]) => [px + size * (a * cos + l * sin), py + size * (a * sin - l * cos)]);
      if (this.crowd && facts.known[i] && i !== chosen && options.side < 0) { many[e.team(i)].push(outline); continue; }
      this.path(outline);
      pen.lineWidth = 1.4; pen.strokeStyle = color;
      pen.fillStyle = facts.known[i] ? color : this.color("field");
      pen.globalAlpha = facts.known[i] ? 1 : 0.55;
      pen.fill(); pen.stroke();
      const health = Math.max(0, Math.min(1, e.health[i * e.states + state] / agent.max_health));
      if (!this.crowd && health < 0.995) {
        pen.lineWidth = 2.2;
        pen.strokeStyle = this.color("grid"); pen.beginPath(); pen.arc(px, py, size + 4, 0, PI2); pen.stroke();
        pen.strokeStyle = health < 0.35 ? this.color("fire") : color;
        pen.beginPath(); pen.arc(px, py, size + 4, -Math.PI / 2, -Math.PI / 2 + PI2 * health); pen.stroke();
      }
      pen.globalAlpha = 1;
      if (i === options.own) {
        pen.fillStyle = this.color("own"); pen.strokeStyle = this.color("ink"); pen.lineWidth = 1;
        pen.beginPath(); pen.arc(px, py, Math.max(3.8, 0.42 * size), 0, PI2); pen.fill(); pen.stroke();
      }
      // Opponents that the chosen side has in sight.
      if (options.side >= 0 && e.team(i) !== options.side && facts.known[i]) {
        pen.lineWidth = 1.4; pen.strokeStyle = this.color("ink"); pen.setLineDash([3, 3]);
        pen.beginPath(); pen.arc(px, py, size + 7.5, 0, PI2); pen.stroke(); pen.setLineDash([]);
      }
      if (i === chosen) {
        pen.lineWidth = 2; pen.strokeStyle = this.color("ink");
        pen.beginPath(); pen.arc(px, py, size + 7.5, 0, PI2); pen.stroke();
      }
      // How much higher or lower than the pilot: who is on a level may collide with it.
      if (options.pilot >= 0 && i !== options.pilot && e.n <= MANY) {
        const apart = z - places[options.pilot].z, level = Math.abs(apart) < 0.5;
        pen.fillStyle = this.color(level ? "ink" : "quiet"); pen.font = "11px system-ui, sans-serif"; pen.textAlign = "left";
        pen.fillText(level ? "=" : `${apart > 0 ? "↑" : "↓"}${Math.abs(apart).toFixed(0)}`, px + size + 4, py + 4);
      }
      if (options.names && e.n <= MANY) {
        pen.fillStyle = this.color("ink"); pen.font = "11px system-ui, sans-serif"; pen.textAlign = "left";
        pen.fillText(String(i), px + size + 5, py - size - 1);
      }
    }
    this.paint(many, true, () => { if (this.crowd) pen.fill(); });
  }

  // The agent at a place of the canvas; -1: nobody is near.
  agentAt(px, py) {
    let best = -1, nearest = 22 * 22;
    this.places.forEach(([x, y], i) => {
      const away = (x - px) ** 2 + (y - py) ** 2;
      if (away < nearest) { nearest = away; best = i; }
    });
    return best;
  }
}
