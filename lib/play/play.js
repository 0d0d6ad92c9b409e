// Connects the page: choices, time, keys, touch, gamepads. `play` is what tests look at.

const $ = id => document.getElementById(id);
const KEYS = {KeyA: [0, 1], ArrowLeft: [0, 1], KeyD: [0, -1], ArrowRight: [0, -1], KeyW: [2, 1], ArrowUp: [2, 1],
              KeyS: [2, -1], ArrowDown: [2, -1], Space: [1, 1], ShiftLeft: [1, -1], ShiftRight: [1, -1]};

// What the person wants: heading, dive and throttle, each from -1 to 1, out of all devices.
class Controls {
  constructor() {
    this.keys = new Set();
    this.touch = [0, 0, 0];
    this.asked = {flies: false, start: false};
    this.connectTouch();
    addEventListener("blur", () => this.keys.clear());
  }
  now() {
    const sum = [...this.touch], pad = this.ofGamepad();
    for (const code of this.keys) { const [control, sign] = KEYS[code]; sum[control] += sign; }
    return sum.map((control, k) => Math.max(-1, Math.min(1, control + pad[k])));
  }
  get gamepad() { return navigator.getGamepads ? [...navigator.getGamepads()].find(one => one) : undefined; }
  ofGamepad() {
    const pad = this.gamepad;
    const axis = k => Math.abs(pad?.axes[k] ?? 0) > 0.15 ? pad.axes[k] : 0, pressed = k => pad?.buttons[k]?.pressed ? 1 : 0;
    return [-axis(0), pressed(0) - pressed(1) - axis(3), -axis(1)];
  }
  // A gamepad tells nothing by itself: what it has begun to do since it was asked last.
  newOfGamepad() {
    const {flies, start} = this.asked;
    this.asked = {flies: this.ofGamepad().some(control => control !== 0), start: this.gamepad?.buttons[9]?.pressed ?? false};
    return {flies: this.asked.flies && !flies, start: this.asked.start && !start};
  }
  connectTouch() {
    const stick = $("stick"), knob = stick.querySelector("i");
    let finger = null;
    const move = event => {
      const box = stick.getBoundingClientRect(), half = box.width / 2;
      const away = [event.clientX - box.left - half, event.clientY - box.top - half].map(d => Math.max(-1, Math.min(1, d / half / 0.8)));
      this.touch[0] = -away[0]; this.touch[2] = -away[1];
      knob.style.transform = `translate(${40 * away[0]}px, ${40 * away[1]}px)`;
    };
    const end = event => {
      if (event.pointerId !== finger) return;
      finger = null; this.touch[0] = this.touch[2] = 0; knob.style.transform = "";
    };
    stick.addEventListener("pointerdown", event => { finger = event.pointerId; stick.setPointerCapture(finger); move(event); });
    stick.addEventListener("pointermove", event => { if (event.pointerId === finger) move(event); });
    for (const type of ["pointerup", "pointercancel"]) stick.addEventListener(type, end);
    for (const [id, sign] of [["climb", 1], ["dive", -1]]) {
      $(id).addEventListener("pointerdown", () => { this.touch[1] = sign; });
      for (const type of ["pointerup", "pointercancel", "pointerleave"]) $(id).addEventListener(type, () => { this.touch[1] = 0; });
    }
  }
}

class Play {
  // `data`: what the program wrote; `scenarios` there hold compiled scenarios, unpacked when they are played.
  static async open(data, module) {
    const play = new Play();
    play.data = data;
    play.game = await GameModule.load(module);
    play.networks = [];
    for (const network of data.networks) play.networks.push(play.game.network(await unpack(network)));
    play.options = {view: "top", side: 0, trails: true, weapon: true, fire: true, names: false, hide: true, eyes: -1};
    play.controls = new Controls();
    play.tally = [0, 0, 0];
    if (matchMedia("(max-width: 640px)").matches) $("choices").open = $("help").open = false;
    play.fillList("scenario", data.scenarios.map(scenario => [scenario.name, scenario.name]));
    play.connect();
    await play.openScenario(0);
    return play;
  }
  fillList(id, entries) { $(id).replaceChildren(...entries.map(([value, text]) => new Option(text, value))); }
  get side() { return Number($("side").value); }
  get scenario() { return this.data.scenarios[$("scenario").selectedIndex]; }
  get person() { return Number($("agent").value); }
  get playing() { return this.running && !this.episode.over; }

  async openScenario(number) {
    $("scenario").selectedIndex = number;
    const {scenario} = this;
    scenario.bytes ??= await unpack(scenario.spec);
    if (this.scenario !== scenario) return;  // another one was chosen in the meantime
    this.game.scenario(scenario.bytes);
    this.checked = this.game.hash(this.data.self_check) === scenario.hash;
    $("checked").textContent = this.checked ? "Checked: it computes the same numbers as the trainer."
      : "Beware: this browser computes other numbers than the trainer.";
    this.fillList("map", [["", "any"], ...scenario.frame.maps.map((map, k) => [k, map.name])]);
    $("map").parentElement.hidden = scenario.frame.maps.length < 2;
    this.openSide();
  }
  // Who can play on which side of the scenario.
  openSide() {
    const {scenario, side} = this, {agents} = scenario.frame, first = agents.findIndex(agent => agent.team === side);
    const mates = agents.filter(agent => agent.team === side);
    this.fillList("agent", [...mates.map((agent, k) => [first + k, `${first + k}, ${agent.kind}`]), [-1, "none, watch"]]);
    $("mates").parentElement.hidden = mates.length < 2;
    const list = (id, team) => {
      const chosen = $(id).value || String(this.data[id]), able = this.data.players.map((player, k) => [k, player.name]).filter(([k]) => scenario.players[team].includes(k));
      this.fillList(id, able);
      if (able.some(([k]) => String(k) === chosen)) $(id).value = chosen;
    };
    list("mates", side); list("opponents", 1 - side);
    this.start();
  }

  // A new game. `seed`: its draws, as digits; another each time where none is given.
  start(seed) {
    const {scenario, side, person} = this, map = $("map").value;
    const who = [0, 1].map(team => {
      const player = this.data.players[Number($(team === side ? "mates" : "opponents").value)].who[team];
      return player < 0 ? player : this.networks[player];
    });
    // The map is drawn from the seed, so a seed is looked for that draws it.
    for (let k = 0; k < 1000; ++k) {
      this.seed = String(BigInt.asUintN(64, BigInt(seed ?? crypto.getRandomValues(new Uint32Array(1))[0])));
      this.game.start(BigInt(this.seed), who, person);
      if (seed !== undefined || map === "" || this.game.field("map", Int32Array, 1)[0] === Number(map)) break;
    }
    if (map !== "") $("map").value = String(this.game.field("map", Int32Array, 1)[0]);
    this.who = who;
    this.episode = new LiveEpisode(scenario.frame, scenario.most_states, scenario.waypoint_unseen_time,
                                   scenario.dead_collect);
    this.episode.noteState(this.game, false);
    this.options.side = side;
    if (this.scene) this.scene.show(this.episode); else this.scene = new Scene($("field"), this.episode, this.options);
    const {limit_x, limit_y} = scenario.frame.rules;
    $("field").style.aspectRatio = String(Math.max(0.8, Math.min(1.6, limit_x / limit_y)));
    this.running = false; this.share = 0; this.last = undefined; this.counted = false; this.shown = -1;
    $("save").disabled = true;
    this.say(person < 0 ? "Press Start to watch" : `You are agent ${person}: press a key or Start`);
    this.look();
    this.redraw();
  }
  // What is seen: what the agent knows; once it is dead, what its team does; or everybody.
  look() {
    const {options, episode, person} = this, all = $("all").checked;
    const lives = person >= 0 && episode.alive(person, episode.steps);
    options.hide = !all;
    options.side = all ? -1 : this.side;
    options.eyes = !all && lives ? person : -1;
    options.pilot = lives ? person : -1;
    options.own = person;
  }

  // Takes steps of the game, with the controls of now or those that are given.
  advance(steps, controls) {
    for (let k = 0; k < steps && !this.episode.over; ++k) {
      const over = this.game.step(controls ?? this.controls.now());
      this.episode.noteActions(this.game);
      this.episode.noteState(this.game, over);
    }
    const {person, episode} = this, lived = this.options.pilot >= 0;
    this.look();
    if (episode.over) this.finish();
    else if (lived && !episode.alive(person, episode.steps)) {
      const death = episode.head.events.find(event => event.what === "death" && event.agent === person);
      this.say(`You are dead: ${eventText(episode, death)}. Enter: a new game, F: to the end`);
    }
  }
  finish() {
    if (this.counted) return;
    this.counted = true; this.running = false;
    const {winner} = this.episode.head, result = winner === "tie" ? 2 : winner === `team_${this.side}` ? 0 : 1;
    ++this.tally[result];
    $("save").disabled = false;
    const [won, lost, ties] = this.tally;
    $("tally").textContent = `Won ${won}, lost ${lost}, tied ${ties}.`;
    this.say(`${["You win", "You lose", "A tie"][result]}${this.episode.head.at_time_limit ? " at the time limit" : ""}. Enter: a new game`);
  }
  say(text) {
    $("message").classList.toggle("aside", this.running);
    $("pause").textContent = this.running ? "Pause" : "Start";
    $("message").textContent = $("spoken").textContent = text;
    $("message").hidden = text === "";
  }
  run(on) {
    if (on && this.episode.over) return this.start();
    this.running = on; this.last = undefined;
    this.say(on ? "" : "Paused");
    this.redraw();
  }
  toTheEnd() {
    this.advance(this.episode.states, [0, 0, 0]);
    this.redraw();
  }
  names() {
    const own = this.data.players[Number($("mates").value)].name, other = this.data.players[Number($("opponents").value)].name;
    const alone = this.episode.teams[this.side] === 1;
    const mine = this.person < 0 ? own : `a person (agent ${this.person})${alone ? "" : ` and ${own}`}`;
    return this.side === 0 ? [mine, other] : [other, mine];
  }
  file() { return this.episode.file(this.seed, this.names()); }
  async save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([await this.file()], {type: "application/octet-stream"}));
    link.download = `play_${this.seed}.replay`;
    link.click();
    URL.revokeObjectURL(link.href);
  }

  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(now => { this.asked = false; this.frame(now); });
  }
  frame(now) {
    this.followGamepad();
    const {episode} = this, step = episode.replay.rules.seconds_per_step;
    if (this.playing) {
      const seconds = this.last === undefined ? 0 : Math.min(0.25, (now - this.last) / 1000);
      this.last = now;
      this.share += seconds * Number($("speed").value) / step;
      const steps = Math.floor(this.share);
      this.share -= steps;
      this.advance(steps);
    }
    // Between the last two states, so that it moves smoothly.
    const time = episode.over || !this.running ? episode.steps : Math.max(0, episode.steps - 1 + this.share);
    this.scene.draw(time, this.person);
    if (this.shown !== episode.steps) this.describe();
    if (this.playing || this.controls.gamepad) this.redraw();
  }
  // What flies starts a game, as keys do; the button Start pauses it, and begins a new one where it is over.
  followGamepad() {
    const {flies, start} = this.controls.newOfGamepad(), {over} = this.episode;
    if (start && over) { this.start(); this.run(true); } else if (start) this.run(!this.running);
    else if (flies && !this.running && !over) this.run(true);
  }
  describe() {
    const {episode, person} = this, state = episode.steps, rules = episode.replay.rules;
    this.shown = state;
    const points = team => rules.waypoints ? `, ${episode.head.score[team]} waypoints` : "";
    $("score").replaceChildren(...[0, 1].map(team => {
      const line = document.createElement("span"), name = document.createElement("b");
      name.textContent = `team ${team}${team === this.side ? " (yours)" : ""}`;
      name.style.color = `var(--team-${team}-text)`;
      line.append(name, ` ${episode.living(team, state)} of ${episode.teams[team]} alive${points(team)}`);
      return line;
    }), `${(state * rules.seconds_per_step).toFixed(1)} s${rules.max_episode_length ? ` of ${(rules.max_episode_length * rules.seconds_per_step).toFixed(0)}` : ""}`);
    const own = [], add = (tag, text) => { const part = document.createElement(tag); part.textContent = text; own.push(part); return part; };
    if (person < 0) add("p", "You watch; what your team sees is shown.");
    else if (!episode.alive(person, state))
      add("p", `You are dead: ${eventText(episode, episode.head.events.find(v => v.what === "death" && v.agent === person))}. What your team sees is shown.`);
    else {
      const at = person * episode.states + state, full = episode.replay.agents[person].max_health, share = Math.max(0, episode.health[at] / full);
      add("div", `health ${(100 * share).toFixed(0)} %`);
      const bar = add("div", ""), fill = bar.appendChild(document.createElement("i"));
      bar.className = "bar"; fill.style.width = `${100 * share}%`;
      fill.style.background = share < 0.35 ? "var(--fire)" : `var(--team-${this.side})`;
      add("div", `speed ${episode.speed[at].toFixed(1)}, altitude ${episode.z[at].toFixed(1)} of ${rules.limit_z}`);
      const known = episode.known(person, state);
      add("div", known.length ? `knows of ${known.length} ${known.length === 1 ? "opponent" : "opponents"}` : "sees no opponent");
      if (known.some(a => episode.tracks(person, a, state))) add("div", "aims");
    }
    $("own").replaceChildren(...own);
    $("field").setAttribute("aria-label", `The field after ${state} steps: ${$("score").innerText.replace(/\s+/g, " ")}`);
  }

  // What stands behind # in the address: scenario=NAME&side=1&agent=7&seed=5&steps=30&view=3d&all=1. In these steps the
  // person does nothing.
  async follow(address) {
    const wanted = new URLSearchParams(address.replace(/^#/, "")), named = this.data.scenarios.findIndex(s => s.name === wanted.get("scenario"));
    if (named >= 0) await this.openScenario(named);
    const choose = (id, name = id) => {
      const known = [...$(id).options].some(option => option.value === wanted.get(name));
      if (known) $(id).value = wanted.get(name);
      return known;
    };
    if (choose("side")) this.openSide();
    const other = choose("agent"), seed = /^\d{1,20}$/.test(wanted.get("seed") ?? "") ? wanted.get("seed") : undefined;
    if (other || seed !== undefined) this.start(seed);
    if (choose("view")) this.options.view = $("view").value;
    if (wanted.get("all") === "1") $("all").checked = true;
    if (wanted.has("steps")) { this.advance(Number(wanted.get("steps")), [0, 0, 0]); this.say(this.episode.over ? $("message").textContent : ""); }
    this.look();
    this.redraw();
  }

  setTheme(dark) {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    $("theme").textContent = dark ? "Light" : "Dark";
    this.redraw();
  }
  connect() {
    $("scenario").addEventListener("change", event => this.openScenario(event.target.selectedIndex));
    $("side").addEventListener("change", () => this.openSide());
    for (const id of ["map", "agent", "mates", "opponents"]) $(id).addEventListener("change", () => this.start());
    $("view").addEventListener("change", event => { this.options.view = event.target.value; this.redraw(); });
    $("all").addEventListener("change", () => { this.look(); this.redraw(); });
    $("pause").addEventListener("click", () => this.run(!this.running));
    $("restart").addEventListener("click", () => { this.start(); this.run(true); });
    $("finish").addEventListener("click", () => this.toTheEnd());
    $("save").addEventListener("click", () => this.save());
    $("theme").addEventListener("click", () => this.setTheme(document.documentElement.dataset.theme !== "dark"));
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", event => this.setTheme(event.matches));
    document.documentElement.dataset.theme = dark.matches ? "dark" : "light";
    $("theme").textContent = dark.matches ? "Light" : "Dark";
    $("field").addEventListener("pointermove", event => {
      const {camera} = this.scene;
      if (!event.buttons || !camera.solid) return;
      camera.yaw += event.movementX * 0.008;
      camera.tilt = Math.max(0.05, Math.min(1.5, camera.tilt - event.movementY * 0.006));
      this.redraw();
    });
    $("stick").addEventListener("pointerdown", () => { if (!this.running && !this.episode.over) this.run(true); });
    addEventListener("gamepadconnected", () => this.redraw());
    addEventListener("resize", () => this.redraw());
    addEventListener("keydown", event => this.key(event, true));
    leaveKeysTo(() => $("field"));
    addEventListener("keyup", event => this.key(event, false));
  }
  key(event, down) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const onControl = /^(SELECT|BUTTON|SUMMARY|INPUT)$/.test(event.target.tagName);
    if (KEYS[event.code]) {
      if (!down) { this.controls.keys.delete(event.code); return; }
      if (onControl && event.code === "Space") return;
      if (event.target.tagName === "SELECT") event.target.blur();
      event.preventDefault();
      this.controls.keys.add(event.code);
      if (!this.running && !this.episode.over && !event.repeat) this.run(true);
      return;
    }
    const tick = id => { $(id).checked = !$(id).checked; this.look(); this.redraw(); };
    const acts = {KeyP: () => this.run(!this.running), KeyF: () => this.toTheEnd(), KeyX: () => tick("all"),
                  Enter: () => { if (!onControl) { this.start(); this.run(true); } },
                  KeyV: () => { this.options.view = $("view").value = this.options.view === "3d" ? "top" : "3d"; this.redraw(); }};
    if (!down || !acts[event.code] || event.repeat) return;
    acts[event.code]();
  }
}

// In one file all lies in the page; in a folder beside it.
async function openPage() {
  const inside = $("game").textContent.trim();
  const data = inside ? JSON.parse(inside) : await (await fetch("game.json")).json();
  const module = inside ? await unpack(data.module) : new Uint8Array(await (await fetch("play.wasm")).arrayBuffer());
  window.play = await Play.open(data, module);
  $("about").textContent = data.about;
  await play.follow(location.hash);
}
openPage().catch(error => {
  const inFolder = !$("game").textContent.trim() && location.protocol === "file:";
  const why = inFolder ? "this folder is for a web server, as python3 -m http.server --directory FOLDER"
    : typeof DecompressionStream === "undefined" || typeof WebAssembly === "undefined" ? "a browser of 2023 or later is needed"
    : `the page is damaged, cut off or changed (${error.message})`;
  $("about").textContent = `The game cannot be played: ${why}.`;
  console.error(error);
});
