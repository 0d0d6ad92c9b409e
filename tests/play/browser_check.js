// Uses the page of play as a person does and writes down what it sees, as JSON in <pre id="outcome">. PART says what.
const frame = () => new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)));
const key = (type, code) => document.body.dispatchEvent(new KeyboardEvent(type, {code, bubbles: true, cancelable: true}));
const text = id => document.getElementById(id).textContent;
const choose = (id, value) => {
  document.getElementById(id).value = value;
  document.getElementById(id).dispatchEvent(new Event("change"));
};
const hex = bytes => [...bytes].map(byte => byte.toString(16).padStart(2, "0")).join("");
const person = () => { const {done, discrete} = play.episode, size = discrete ? 1 : 3; return [...done.at(-1).slice(play.person * size, (play.person + 1) * size)].join(" "); };

async function hashes(seen) {
  seen.hashes = [];
  for (const scenario of play.data.scenarios) {
    play.game.scenario(await unpack(scenario.spec));
    seen.hashes.push(`${scenario.name} ${play.game.hash(HASH_STEPS)}`);
  }
}

async function fly(seen) {
  seen.checked = text("checked");
  seen.injected = document.querySelectorAll("b#evil, h1 b").length;
  const lists = ["mates", "opponents"].map(id => document.getElementById(id));
  seen.players = lists.map(list => list.options.length).join(" ");
  seen.chosen = lists.map(list => list.selectedOptions[0].text).join(" ");
  play.start("5");
  for (let k = 0; k < 20; ++k) await frame();
  seen.waits = play.episode.steps === 0;

  // Keys.
  const heading = () => play.game.field("heading", Float32Array, 1)[0], before = heading();
  const steps = async count => { const until = play.episode.steps + count; for (let k = 0; k < 300 && play.episode.steps < until; ++k) await frame(); };
  key("keydown", "KeyA");
  seen.runs = play.running;
  await steps(3);
  seen.actions = [person()];
  seen.turned = Math.sin(heading() - before) > 0.5;
  key("keydown", "KeyW"); key("keydown", "Space");
  await steps(2);
  seen.actions.push(person());
  for (const code of ["KeyA", "KeyW", "Space"]) key("keyup", code);
  await steps(2);
  seen.actions.push(person());
  key("keydown", "KeyP");
  const stopped = play.episode.steps;
  for (let k = 0; k < 20; ++k) await frame();
  seen.paused = play.episode.steps === stopped && !play.running;

  // Partial sight: a game in which somebody is not known.
  const drawn = () => { const facts = play.scene.facts(play.episode.steps); return [...facts.known]; };
  play.start("6"); await frame();
  seen.eyes = play.options.eyes;
  const known = new Set([...play.episode.sources(0, 0), ...play.episode.known(0, 0)]);
  seen.hidden = known.size < play.episode.n && drawn().every((shown, i) => (shown === 1) === known.has(i));
  document.getElementById("all").click(); await frame();
  seen.shown = drawn().every(shown => shown === 1);
  document.getElementById("all").click(); await frame();

  seen.map = play.episode.head.map < play.episode.replay.maps.length;
  play.start("5");
  play.advance(20, [1, 0, 1]);
  play.toTheEnd();
  await frame();
  seen.over = play.episode.over;
  seen.discrete = hex(await play.file());
  await play.openScenario(1);
  play.start("18446744073709551615");
  play.advance(15, [0.5, -0.25, 1]);
  play.toTheEnd();
  seen.continuous = hex(await play.file());
  seen.unnamed = [...document.querySelectorAll("button, select, input, canvas")].filter(e =>
    !e.getAttribute("aria-label") && !e.closest("label") && !e.textContent.trim()).length;
}

async function watchNetworks(seen) {
  choose("agent", "-1");
  play.start("7");
  play.toTheEnd();
  await frame();
  seen.discrete = hex(await play.file());
  seen.wide = document.documentElement.scrollWidth <= innerWidth;
}

async function usePage() {
  for (let k = 0; k < 400 && !window.play; ++k) await new Promise(done => setTimeout(done, 20));
  const seen = {};
  await {hash: hashes, play: fly, watch: watchNetworks}[PART](seen);
  seen.requests = performance.getEntriesByType("resource").map(entry => entry.name);
  return seen;
}

usePage().catch(error => { problems.push(String(error.stack || error)); return {}; }).then(seen => {
  const outcome = document.body.appendChild(document.createElement("pre"));
  outcome.id = "outcome";
  outcome.textContent = JSON.stringify({...seen, problems});
});
