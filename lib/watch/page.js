// Connects the page: time, games, the chosen agent, keys. `watch` is what tests look at.

const $ = id => document.getElementById(id);

class Watch {
  constructor(replays) {
    this.games = replays.flatMap((replay, r) => replay.episodes.map((episode, k) => ({
      episode, replay, name: `${replay.players[0]} against ${replay.players[1]}`, number: k, file: r})));
    this.options = {view: "top", side: -1};
    // Of very many agents there is enough to draw and to see without these; a click shows them.
    const many = replays[0].agents.length > 500, less = ["trails", "weapon"];
    for (const box of $("layers").querySelectorAll("input"))
      this.options[box.name] = box.checked &&= !(many && less.includes(box.name));
    if (replays.every(replay => replay.agents.length > PAIRED)) {  // of a crowd that is not kept
      this.options.contacts = false;
      $("layers").querySelector("[name=contacts]").closest("label").hidden = true;
    }
    this.time = 0; this.chosen = -1; this.playing = false; this.speed = 1; this.dirty = true; this.frames = 0;
    this.panes = [new Pane($("panes"), this)];
    const [first] = replays, origins = [...new Set(replays.flatMap(replay => replay.origins))].filter(text => text);
    $("about").textContent = `${first.scenario_name}, ${this.games.length} ${this.games.length === 1 ? "game" : "games"}` +
      (origins.length ? `; ${origins.join("; ")}` : "");
    this.fillLists();
    this.connect();
    const beside = replays.length > 1 ? this.games.findIndex(game => game.file === 1) : -1;
    this.open(0, beside);
  }
  get step() { return Math.floor(this.time + 1e-6); }
  get steps() { return Math.max(...this.panes.map(pane => pane.game.episode.steps)); }

  fillLists() {
    const several = new Set(this.games.map(game => game.file)).size > 1;
    const name = game => `${several ? game.name + ", " : ""}${game.number}: ${endText(game.episode)}, ${game.episode.steps} steps`;
    $("game").replaceChildren(...this.games.map((game, k) => new Option(name(game), k)));
    $("beside").replaceChildren(new Option("nothing", -1), ...this.games.map((game, k) => new Option(name(game), k)));
  }
  open(game, beside) {
    const numbers = [game, beside].filter(k => k >= 0);
    while (this.panes.length > numbers.length) this.panes.pop().root.remove();
    while (this.panes.length < numbers.length) this.panes.push(new Pane($("panes"), this));
    numbers.forEach((k, index) => this.panes[index].show(this.games[k]));
    $("game").value = game; $("beside").value = beside;
    this.pane = this.panes[0];
    this.chosen = -1;
    $("scrub").max = this.steps;
    this.listEvents();
    this.seek(0);
  }

  // Events of all games that are shown, by step.
  listEvents() {
    this.events = this.panes.flatMap((pane, k) => {
      const {episode} = pane.game;
      const all = [...episode.head.events, {step: episode.steps, what: "end", agent: -1, other: -1}];
      return all.map(event => ({...event, episode, prefix: this.panes.length > 1 ? (k ? "right: " : "left: ") : ""}));
    }).sort((a, b) => a.step - b.step);
    const most = 400, all = this.events.filter(event => event.what !== "hit");
    const shown = all.filter((event, k) => k < most || event.what === "end"), left = all.length - shown.length;
    const item = (text, step) => {
      const entry = document.createElement("li"), button = entry.appendChild(document.createElement("button"));
      button.type = "button";
      button.textContent = `${this.clock(step)}  ${text}`;
      button.addEventListener("click", () => this.seek(step));
      return entry;
    };
    const items = shown.map(event => item(event.prefix + eventText(event.episode, event), event.step));
    if (left > 0) items.splice(most, 0, item(`and ${left} more, which are not listed`, all[most].step));
    $("events").querySelector("ol").replaceChildren(...items);
    this.drawMarks();
  }
  clock(step) { return `${(step * this.games[0].replay.rules.seconds_per_step).toFixed(1)} s`; }

  seek(time) {
    this.time = Math.max(0, Math.min(this.steps, time));
    this.redraw();
  }
  pause() { this.play(false); }
  play(on) {
    if (on && this.time >= this.steps) this.time = 0;
    this.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) $("spoken").textContent = this.panes.map(pane => this.summary(pane.game, this.step)).join(" ");
    this.last = undefined;
    this.redraw();
  }
  setSpeed(speed) { this.speed = speed; $("speed").value = speed; }
  choose(agent, pane = this.pane) {
    this.pane = pane;
    this.chosen = agent;
    this.redraw();
  }
  toEvent(direction) {
    const events = this.events.filter(event => direction > 0 ? event.step > this.step : event.step < this.step);
    const next = direction > 0 ? events[0] : events.at(-1);
    if (!next) return;
    this.pause();
    this.seek(next.step);
    $("spoken").textContent = eventText(next.episode, next);
  }
  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(now => { this.asked = false; this.frame(now); });
  }
  frame(now) {
    if (this.playing) {
      const seconds = this.last === undefined ? 0 : Math.min(0.25, (now - this.last) / 1000);
      this.last = now;
      this.time = Math.min(this.steps, this.time + this.speed * seconds / this.games[0].replay.rules.seconds_per_step);
      if (this.time >= this.steps) this.play(false);
    }
    ++this.frames;
    for (const pane of this.panes) pane.draw(this.time, pane === this.pane ? this.chosen : -1);
    $("scrub").value = this.step;
    $("scrub").setAttribute("aria-valuetext", `step ${this.step} of ${this.steps}`);
    $("now").textContent = `step ${this.step} of ${this.steps}, ${this.clock(this.step)}`;
    const before = this.events.filter(event => event.step <= this.step).at(-1);
    $("last-event").textContent = before ? `${this.clock(before.step)}: ${before.prefix}${eventText(before.episode, before)}` : "";
    if (this.shown !== `${this.step} ${this.chosen} ${this.pane.game.name} ${this.pane.game.number}`) this.describe();
    this.drawHand();
    if (this.playing) this.redraw();
  }

  // A state in words.
  summary(game, state) {
    const {episode} = game;
    const teams = [0, 1].map(team => `team ${team} has ${episode.living(team, state)} of ${episode.teams[team]} agents`);
    return `${game.name}, step ${state} of ${episode.steps}: ${teams.join(", ")}${state >= episode.steps ? "; over: " + endText(episode) : ""}.`;
  }

  // What the chosen agent observes, does and expects.
  describe() {
    const {episode} = this.pane.game, state = Math.min(this.step, episode.steps), i = this.chosen;
    this.shown = `${this.step} ${i} ${this.pane.game.name} ${this.pane.game.number}`;
    const known = i >= 0 && i < episode.n;
    $("ego").hidden = $("curve").hidden = !known;
    $("agent-mind").replaceChildren();
    if (!known) {
      $("agent-name").textContent = "Click an agent";
      $("agent-facts").innerHTML = '<p class="quiet">or press the key a: what it knows, does and expects is shown here.</p>';
      return;
    }
    $("agent-name").textContent = `Agent ${i}, team ${episode.team(i)}, ${episode.replay.agents[i].kind}`;
    $("agent-facts").replaceChildren(...observationText(episode, i, state).map(([text, items]) => {
      const part = document.createElement("div"), p = part.appendChild(document.createElement("p"));
      p.textContent = text;
      if (items && items.length) {
        const list = part.appendChild(document.createElement("ul"));
        for (const item of items) list.appendChild(document.createElement("li")).textContent = item;
      }
      return part;
    }));
    this.describeMind(episode, i, state);
    drawEgo($("ego"), this.pane.scene, i, state);
    $("curve").hidden = !drawCurve($("curve"), episode, i, state, this.pane.scene);
  }
  describeMind(episode, i, state) {
    if (!episode.alive(i, state)) return;
    const parts = [], add = text => { const p = document.createElement("p"); p.textContent = text; parts.push(p); };
    const action = episode.actionAt(i, state), likely = episode.likely(i, state), value = episode.value(i, state);
    if (action !== null) add(`Does: ${actionText(action)}`);
    if (value !== null) add(`Expects a return of ${value.toFixed(2)} (mean of its critic, which may see more)`);
    if (likely && episode.replay.actions === "discrete") {
      add("Likeliest actions:");
      for (const [number, probability] of likely) {
        const row = document.createElement("div");
        row.className = number === action ? "likely done" : "likely";
        row.innerHTML = "<b></b><span></span><div class=bar><i></i></div>";
        row.querySelector("b").textContent = actionText(number);
        row.querySelector("span").textContent = `${Math.round(100 * probability)} %`;
        row.querySelector("i").style.width = `${100 * probability}%`;
        parts.push(row);
      }
    } else if (likely) {
      add(`Mean of its actions: ${actionText(likely)}`);
    }
    $("agent-mind").replaceChildren(...parts);
  }

  // Marks of events under the time line; deaths and ends are the tallest.
  drawMarks() {
    const ratio = window.devicePixelRatio || 1, width = $("marks").clientWidth;
    const canvas = this.marks = document.createElement("canvas"), pen = canvas.getContext("2d");
    canvas.width = Math.max(1, Math.round(width * ratio)); canvas.height = Math.round(22 * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(document.documentElement), color = name => style.getPropertyValue(`--${name}`);
    const looks = {contact: [9, "quiet"], hit: [6, "fire"], death: [18, ""], waypoint: [6, "waypoint"],
                   collected: [13, "waypoint"], end: [20, "ink"]};
    for (const event of this.events) {
      const [height, name] = looks[event.what];
      pen.fillStyle = color(name || `team-${event.episode.team(event.agent)}`);
      pen.fillRect(this.markAt(event.step, width) - 1, 20 - height, 2, height);
    }
  }
  // The thumb of the slider is 16 pixels wide in most browsers.
  markAt(step, width) { return 8 + (width - 16) * step / Math.max(1, this.steps); }
  drawHand() {
    const canvas = $("marks"), ratio = window.devicePixelRatio || 1, pen = canvas.getContext("2d");
    if (this.marks.width !== Math.max(1, Math.round(canvas.clientWidth * ratio))) this.drawMarks();
    canvas.width = this.marks.width; canvas.height = this.marks.height;
    pen.drawImage(this.marks, 0, 0);
    pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--ink");
    pen.globalAlpha = 0.5;
    pen.fillRect(this.markAt(this.time, canvas.clientWidth) * ratio, 0, ratio, canvas.height);
  }

  setOption(name, value) {
    this.options[name] = value;
    const box = $("layers").querySelector(`[name=${name}]`);
    if (box) box.checked = value; else $(name).value = value;
    this.redraw();
  }
  nextAgent(direction) {
    const {n} = this.pane.game.episode;
    this.choose(this.chosen < 0 ? (direction > 0 ? 0 : n - 1) : (this.chosen + direction + n) % n);
    $("spoken").textContent = $("agent-name").textContent;
  }
  setTheme(dark) {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    $("theme").textContent = dark ? "Light" : "Dark";
    if (this.events) this.drawMarks();
    this.shown = "";
    this.redraw();
  }

  connect() {
    const numbers = () => [Number($("game").value), Number($("beside").value)];
    for (const id of ["game", "beside"]) $(id).addEventListener("change", () => this.open(...numbers()));
    $("view").addEventListener("change", event => this.setOption("view", event.target.value));
    $("side").addEventListener("change", event => this.setOption("side", Number(event.target.value)));
    $("layers").addEventListener("change", event => this.setOption(event.target.name, event.target.checked));
    $("play").addEventListener("click", () => this.play(!this.playing));
    $("back").addEventListener("click", () => { this.pause(); this.seek(this.step - 1); });
    $("forward").addEventListener("click", () => { this.pause(); this.seek(this.step + 1); });
    $("previous-event").addEventListener("click", () => this.toEvent(-1));
    $("next-event").addEventListener("click", () => this.toEvent(1));
    $("next-agent").addEventListener("click", () => this.nextAgent(1));
    $("speed").addEventListener("change", event => this.setSpeed(Number(event.target.value)));
    $("scrub").addEventListener("input", event => { this.pause(); this.seek(Number(event.target.value)); });
    $("marks").addEventListener("pointerdown", event => {
      const width = $("marks").clientWidth;
      this.seek(Math.round((event.offsetX - 8) / (width - 16) * this.steps));
    });
    $("theme").addEventListener("click", () => this.setTheme(document.documentElement.dataset.theme !== "dark"));
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", event => this.setTheme(event.matches));
    this.setTheme(dark.matches);
    addEventListener("resize", () => this.redraw());
    addEventListener("keydown", event => this.key(event));
    leaveKeysTo(() => this.pane.canvas);
  }
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const inControl = /^(SELECT|INPUT)$/.test(event.target.tagName) && event.target.type !== "checkbox";
    const onButton = /^(BUTTON|SUMMARY)$/.test(event.target.tagName) || event.target.type === "checkbox";
    if (inControl || (onButton && (event.key === " " || event.key === "Enter"))) return;
    const flip = name => this.setOption(name, !this.options[name]);
    const by = steps => { this.pause(); this.seek(this.step + steps); };
    const speeds = [...$("speed").options].map(option => Number(option.value));
    const faster = direction => this.setSpeed(speeds[Math.max(0, Math.min(speeds.length - 1, speeds.indexOf(this.speed) + direction))]);
    const keys = {
      " ": () => this.play(!this.playing), ArrowLeft: () => by(event.shiftKey ? -10 : -1), ArrowRight: () => by(event.shiftKey ? 10 : 1),
      Home: () => by(-this.steps), End: () => by(this.steps), n: () => this.toEvent(1), p: () => this.toEvent(-1),
      "+": () => faster(1), "=": () => faster(1), "-": () => faster(-1), a: () => this.nextAgent(1), A: () => this.nextAgent(-1),
      Escape: () => this.choose(-1), v: () => this.setOption("view", this.options.view === "3d" ? "top" : "3d"),
      0: () => this.setOption("side", 0), 1: () => this.setOption("side", 1), e: () => this.setOption("side", -1),
      t: () => flip("trails"), s: () => flip("sight"), w: () => flip("weapon"), f: () => flip("fire"), d: () => flip("contacts"),
    };
    const act = keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
  // What stands behind # in the address: game=1&beside=2&step=30&agent=4&view=3d&side=0.
  follow(address) {
    const wanted = new URLSearchParams(address.replace(/^#/, "")), number = name => Number(wanted.get(name));
    const game = name => wanted.has(name) && this.games[number(name)] ? number(name) : -1;
    if (wanted.has("game") || wanted.has("beside")) this.open(Math.max(0, game("game")), game("beside"));
    if (wanted.get("view") === "3d") this.setOption("view", "3d");
    if (wanted.has("side")) this.setOption("side", number("side"));
    for (const box of $("layers").querySelectorAll("input"))
      if (wanted.has(box.name)) this.setOption(box.name, wanted.get(box.name) === "1");
    if (wanted.has("agent")) this.choose(number("agent"));
    if (wanted.has("step")) this.seek(number("step"));
  }
}

async function start() {
  const packed = JSON.parse($("replays").textContent);
  window.watch = new Watch(await Promise.all(packed.map(readReplay)));
  watch.follow(location.hash);
  addEventListener("hashchange", () => watch.follow(location.hash));
}
start().catch(error => {
  $("about").textContent = `The games cannot be shown: ${error.message}.`;
  if (!(error instanceof BadReplay)) console.error(error);
});
