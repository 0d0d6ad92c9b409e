// Uses the page of play as a person does. PART says what.
const key = (type, code) => document.body.dispatchEvent(new KeyboardEvent(type, {code, bubbles: true, cancelable: true}));
const choose = (id, value) => {
  document.getElementById(id).value = value;
  document.getElementById(id).dispatchEvent(new Event("change"));
};
const person = () => { const {done, discrete} = play.episode, size = discrete ? 1 : 3; return [...done.at(-1).slice(play.person * size, (play.person + 1) * size)].join(" "); };

async function hashes(seen) {
  seen.hashes = [];
  for (const scenario of play.data.scenarios) {
    play.game.scenario(await unpack(scenario.spec));
    seen.hashes.push(`${scenario.name} ${play.game.hash(HASH_STEPS)}`);
  }
}

// By a module that has the simulator of crowds too.
async function crowdHashes(seen) {
  const game = await GameModule.load(await unpack(MODULE));
  seen.hashes = [];
  for (const [name, steps, spec] of CROWDS) {
    game.scenario(await unpack(spec));
    seen.hashes.push(`${name} ${steps} ${game.hash(steps)}`);
  }
}

// A finger on the stick and on the buttons. The browser has no finger of its own here, so it is the mouse's pointer.
async function touch(seen, steps) {
  play.start("5");
  const pointer = (id, type, x = 0.5, y = 0.5) => {
    const element = document.getElementById(id), box = element.getBoundingClientRect();
    element.dispatchEvent(new PointerEvent(type, {bubbles: true, pointerId: 1, pointerType: "touch", buttons: 1,
      clientX: box.left + x * box.width, clientY: box.top + y * box.height}));
  };
  seen.touch_shown = getComputedStyle(document.getElementById("touch")).display;
  pointer("stick", "pointerdown");
  seen.touch = [play.running];
  const note = async () => { await steps(2); seen.touch.push(person()); };
  await note();
  pointer("stick", "pointermove", 0.05, 0.05); await note();
  pointer("climb", "pointerdown"); await note();
  pointer("stick", "pointerup"); await note();
  pointer("climb", "pointerup"); await note();
  pointer("dive", "pointerdown"); await note();
  pointer("dive", "pointerleave"); await note();
}

async function gamepad(seen, steps) {
  play.start("5");
  const pad = {axes: [0, 0, 0, 0], buttons: Array.from({length: 16}, () => ({pressed: false}))}, own = navigator.getGamepads;
  navigator.getGamepads = () => [null, pad];
  dispatchEvent(new Event("gamepadconnected"));
  const pictures = async () => { for (let k = 0; k < 3; ++k) await frame(); };
  const press = async (button, down) => { pad.buttons[button].pressed = down; await pictures(); };
  pad.axes[0] = 0.1;  // hands rest on it
  await pictures();
  seen.gamepad = [play.running];
  pad.axes[0] = 0.9; pad.axes[1] = -0.9;
  await pictures();
  seen.gamepad.push(play.running);
  const note = async () => { await steps(2); seen.gamepad.push(person()); };
  await note();
  await press(1, true); await note();
  pad.axes[0] = pad.axes[1] = 0;
  await press(1, false); await press(0, true); await note();
  await press(0, false); pad.axes[3] = 1; await note();
  pad.axes[3] = 0;
  await press(9, true); seen.gamepad.push(play.running); await press(9, false);
  await press(9, true); seen.gamepad.push(play.running); await press(9, false);
  play.toTheEnd(); await pictures();
  await press(9, true); seen.gamepad.push(play.episode.over);
  navigator.getGamepads = own;
}

// The field from above and in three dimensions after some steps, as the agent knows it.
async function comparePictures(seen) {
  const canvas = document.getElementById("field"), look = async () => { play.redraw(); await frame(); await frame(); };
  const open = async steps => { play.start("6"); play.advance(steps, [0.5, 0, 1]); play.say(""); await look(); };
  play.setTheme(false);
  pin(canvas, 300, 240);
  await open(25); await notePicture(seen, canvas, "top");
  const wrong = async what => { await look(); await noteWrong(seen, canvas, "top", what); };
  document.getElementById("all").click(); await wrong("everybody is shown");
  document.getElementById("all").click();
  const root = document.documentElement, map = play.episode.head.map, {maps} = play.episode.replay;
  root.style.setProperty("--team-0", "#d55e00"); await wrong("another colour");
  root.style.removeProperty("--team-0");
  play.episode.head.map = (map + 1) % maps.length; await wrong("another map"); play.episode.head.map = map;
  await open(27); await wrong("another step");
  await open(25); play.options.view = "3d"; await look(); await notePicture(seen, canvas, "solid");
  play.options.view = "top"; canvas.style.cssText = "";
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
  await touch(seen, steps);
  await gamepad(seen, steps);

  // Partial sight: a game in which somebody is not known.
  const drawn = () => { const facts = play.scene.facts(play.episode.steps); return [...facts.known]; };
  play.start("6"); await frame();
  seen.eyes = play.options.eyes;
  const known = new Set([...play.episode.sources(0, 0), ...play.episode.known(0, 0)]);
  seen.hidden = known.size < play.episode.n && drawn().every((shown, i) => (shown === 1) === known.has(i));
  document.getElementById("all").click(); await frame();
  seen.shown = drawn().every(shown => shown === 1);
  document.getElementById("all").click(); await frame();

  // Straight on, until it is dead.
  play.start("5");
  while (!play.episode.over && play.episode.alive(0, play.episode.steps)) play.advance(1, [0, 0, 1]);
  seen.dead = text("message");

  seen.map = play.episode.head.map < play.episode.replay.maps.length;
  play.start("5");
  play.advance(20, [1, 0, 1]);
  play.toTheEnd();
  await frame();
  seen.over = play.episode.over;
  seen.discrete = hex(await play.file());
  await comparePictures(seen);
  await play.openScenario(1);
  play.start("18446744073709551615");
  play.advance(15, [0.5, -0.25, 1]);
  play.toTheEnd();
  seen.continuous = hex(await play.file());
  seen.unnamed = unnamed();
}

async function watchNetworks(seen) {
  choose("agent", "-1");
  play.start("7");
  play.toTheEnd();
  await frame();
  seen.discrete = hex(await play.file());
  play.start("7");  // what the networks remember is forgotten
  play.toTheEnd();
  seen.again = seen.discrete === hex(await play.file());
  seen.wide = document.documentElement.scrollWidth <= innerWidth;
}

async function usePage() {
  for (let k = 0; k < 400 && !window.play; ++k) await new Promise(done => setTimeout(done, 20));
  const seen = {};
  await {hash: hashes, crowds: crowdHashes, play: fly, watch: watchNetworks}[PART](seen);
  seen.requests = performance.getEntriesByType("resource").map(entry => entry.name);
  return seen;
}
