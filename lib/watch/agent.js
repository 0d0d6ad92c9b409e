// What an agent observes, in words and as a picture, and what its critic expects.

const CURVE_COLORS = ["team-0", "team-1"];

const degrees = radians => Math.round(radians * 180 / Math.PI);
function bearingText(turn) {
  turn -= PI2 * Math.round(turn / PI2);
  return Math.abs(turn) < 0.09 ? "straight ahead" : `${degrees(Math.abs(turn))}° to the ${turn > 0 ? "left" : "right"}`;
}
// How far from a place one can fly in a direction before the border or an obstacle.
function wayAhead(episode, x, y, z, heading) {
  const {limit_x, limit_y, obstacle_heights} = episode.replay.rules, dx = Math.cos(heading), dy = Math.sin(heading);
  const until = (at, d, low, high) => d > 0 ? (high - at) / d : d < 0 ? (low - at) / d : Infinity;
  let way = Math.min(until(x, dx, 0, limit_x), until(y, dy, 0, limit_y));
  for (const [x1, y1, x2, y2, z1, z2] of episode.boxes()) {
    if (obstacle_heights && (z < z1 || z > z2)) continue;
    const a = [(x1 - x) / dx, (x2 - x) / dx].sort((p, q) => p - q), b = [(y1 - y) / dy, (y2 - y) / dy].sort((p, q) => p - q);
    const enter = Math.max(a[0], b[0]), leave = Math.min(a[1], b[1]);
    if (enter < leave && leave > 0) way = Math.min(way, Math.max(0, enter));
  }
  return Math.max(0, way);
}
// Whom agent i knows of, hears, shoots at, and who shoots at it.
function pairsText(episode, i, state, list) {
  const at = i * episode.states + state, x = episode.x[at], y = episode.y[at], heading = episode.heading[at];
  const other = b => {
    const to = b * episode.states + state, dx = episode.x[to] - x, dy = episode.y[to] - y, dz = episode.z[to] - episode.z[at];
    const height = Math.abs(dz) < 0.15 ? "as high" : `${Math.abs(dz).toFixed(1)} ${dz > 0 ? "higher" : "lower"}`;
    return `agent ${b}: ${Math.hypot(dx, dy).toFixed(1)} away, ${bearingText(Math.atan2(dy, dx) - heading)}, ${height}, ` +
      `flies ${bearingText(episode.heading[to] - heading)}, health ${episode.health[to].toFixed(2)}`;
  };
  const near = (a, b) => distance(episode, i, a, state) - distance(episode, i, b, state);
  const known = episode.known(i, state).sort(near), mates = episode.sources(i, state).slice(1).sort(near);
  const own = known.filter(a => episode.detects(i, a, state));
  const [from, to] = episode.opponents(i), opponents = [...Array(to - from).keys()].map(k => from + k);
  const seenBy = opponents.filter(b => episode.detects(b, i, state)), shotBy = opponents.filter(b => episode.tracks(b, i, state));
  const shootsAt = opponents.filter(a => episode.tracks(i, a, state));
  const hears = episode.hearing(i, i + 1 < episode.n && episode.team(i + 1) === episode.team(i) ? i + 1 : i - 1, state) === null
    ? "Whom it hears is not kept of so many agents." : `Hears ${list(mates)}.`;
  const parts = [[`Knows of ${known.length} of ${opponents.filter(a => episode.alive(a, state)).length} living opponents, ` +
    `${own.length} by itself${known.length ? ":" : "."}`, known.slice(0, 8).map(other)], [hears], [`Shoots at ${list(shootsAt)}.`]];
  if (seenBy.length) parts.push([`What it is not told: ${list(seenBy)} detected it; it is shot at by ${list(shotBy)}.`]);
  return parts;
}
// What agent i observes, as paragraphs [text, items].
function observationText(episode, i, state) {
  const at = i * episode.states + state, {head, replay} = episode;
  const x = episode.x[at], y = episode.y[at], z = episode.z[at], heading = episode.heading[at];
  if (!episode.alive(i, state))
    return [[`Dead since step ${head.died[i]}: ${eventText(episode, head.events.find(v => v.what === "death" && v.agent === i))}.`]];
  const list = agents => agents.length ? agents.map(a => `agent ${a}`).join(", ") : "nobody";
  const waypoint = episode.waypoint(state), parts = [];
  parts.push([`Health ${episode.health[at].toFixed(2)} of ${replay.agents[i].max_health}; at (${x.toFixed(1)}, ${y.toFixed(1)}), ` +
    `altitude ${z.toFixed(1)}, heading ${(degrees(heading) + 360) % 360}°, speed ${episode.speed[at].toFixed(1)}; ` +
    `${wayAhead(episode, x, y, z, heading).toFixed(1)} to the next wall ahead.`]);
  if (episode.crowd) {
    const firing = episode.firing(state), targets = firing.filter(([b]) => b === i).map(([, a]) => a);
    const shooters = firing.filter(([, a]) => a === i).map(([b]) => b);
    parts.push(["Whom it sees and hears is not kept of so many agents."], [`Shoots at ${list(targets)}.`]);
    parts.push([`What it is not told: ${episode.seen(i, state) ? "opponents see" : "no opponent sees"} it; ` +
      `it is shot at by ${list(shooters)}.`]);
    if (i - episode.team(i) * episode.teams[0] >= episode.minded(episode.team(i)))
      parts.push([`What networks say is kept of the first ${MINDS} agents of a team.`]);
  } else {
    parts.push(...pairsText(episode, i, state, list));
  }
  if (waypoint) {
    const dx = (waypoint.x1 + waypoint.x2) / 2 - x, dy = (waypoint.y1 + waypoint.y2) / 2 - y;
    parts.push([`The waypoint is ${Math.hypot(dx, dy).toFixed(1)} away, ${bearingText(Math.atan2(dy, dx) - heading)}.`]);
  }
  return parts;
}
function distance(episode, i, b, state) {
  const p = i * episode.states + state, q = b * episode.states + state;
  return Math.hypot(episode.x[p] - episode.x[q], episode.y[p] - episode.y[q]);
}

// What agent i knows, with its heading upwards: obstacles, mates that it hears, opponents that it knows of.
function drawEgo(canvas, scene, i, state) {
  const {episode} = scene, ratio = window.devicePixelRatio || 1, side = 220, pen = canvas.getContext("2d");
  canvas.width = canvas.height = side * ratio;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = scene.color("field");
  pen.fillRect(0, 0, side, side);
  const at = i * episode.states + state, {limit_x, limit_y, sight_depth} = episode.replay.rules;
  const reach = Math.min(Math.max(1.5 * sight_depth, 4), Math.hypot(limit_x, limit_y)), scale = side / 2 / reach;
  const cos = Math.cos(episode.heading[at]), sin = Math.sin(episode.heading[at]);
  const place = (x, y) => {
    const dx = x - episode.x[at], dy = y - episode.y[at], ahead = dx * cos + dy * sin, left = dy * cos - dx * sin;
    return [side / 2 - left * scale, side / 2 - ahead * scale];
  };
  const polygon = points => { pen.beginPath(); points.forEach(([x, y]) => pen.lineTo(...place(x, y))); pen.closePath(); };
  const rectangle = (x1, y1, x2, y2) => polygon([[x1, y1], [x2, y1], [x2, y2], [x1, y2]]);
  rectangle(0, 0, limit_x, limit_y);
  pen.strokeStyle = scene.color("quiet"); pen.lineWidth = 1; pen.stroke();
  pen.fillStyle = scene.color("wall");
  for (const [x1, y1, x2, y2] of episode.boxes()) { rectangle(x1, y1, x2, y2); pen.fill(); }
  const waypoint = episode.waypoint(state);
  if (waypoint) { rectangle(waypoint.x1, waypoint.y1, waypoint.x2, waypoint.y2); pen.fillStyle = scene.color("waypoint"); pen.fill(); }
  const draw = b => {
    const to = b * episode.states + state, turn = episode.heading[to] - episode.heading[at] + Math.PI / 2;
    const [px, py] = place(episode.x[to], episode.y[to]), c = Math.cos(turn), s = Math.sin(turn);
    pen.beginPath();
    for (const [a, l] of scene.shape(episode.replay.agents[b].kind)) pen.lineTo(px + 8 * (a * c - l * s), py - 8 * (a * s + l * c));
    pen.closePath();
    pen.fillStyle = scene.color(CURVE_COLORS[episode.team(b)]); pen.fill();
    pen.fillStyle = scene.color("ink"); pen.font = "11px system-ui, sans-serif"; pen.fillText(String(b), px + 9, py - 6);
  };
  if (!episode.alive(i, state)) return;
  [...episode.sources(i, state), ...episode.known(i, state)].forEach(draw);
}

// The value of the chosen agent over the game; false where there is none.
function drawCurve(canvas, episode, i, state, scene) {
  if (episode.value(i, 0) === null) return false;
  canvas.hidden = false;
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = 90, pen = canvas.getContext("2d");
  canvas.width = width * ratio; canvas.height = height * ratio;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const {low, high} = episode.minds[episode.team(i)], last = episode.head.died[i] < 0 ? episode.steps : episode.head.died[i] - 1;
  const x = k => 4 + (width - 8) * k / episode.steps, y = v => 16 + (height - 26) * (high - v) / (high - low);
  pen.strokeStyle = scene.color("line"); pen.lineWidth = 1;
  if (low < 0 && high > 0) { pen.beginPath(); pen.moveTo(4, y(0)); pen.lineTo(width - 4, y(0)); pen.stroke(); }
  pen.beginPath();
  for (let k = 0; k <= last; ++k) pen.lineTo(x(k), y(episode.value(i, k)));
  pen.strokeStyle = scene.color(CURVE_COLORS[episode.team(i)]); pen.lineWidth = 1.6; pen.stroke();
  pen.fillStyle = scene.color("ink");
  pen.fillRect(x(state) - 0.5, 12, 1, height - 14);
  pen.fillStyle = scene.color("quiet"); pen.font = "11px system-ui, sans-serif";
  pen.fillText(`value over time, ${low.toFixed(1)} to ${high.toFixed(1)}`, 6, 11);
  return true;
}
