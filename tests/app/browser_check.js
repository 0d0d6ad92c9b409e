// Uses the page of a recorded crowd: looks at some steps, plays, asks an agent.
const press = key => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true}));

// A checksum of every column, in whole units, that a test computes too.
function columns(seen) {
  const add = (sum, value) => Math.imul(sum, 31) + value | 0;
  seen.columns = watch.games.map(({episode: e}) => {
    const units = [e.place, e.place, 0.02, 2 * Math.PI / 65536, 0.05, 0.01];
    const states = [e.x, e.y, e.z, e.heading, e.speed, e.health].map((column, k) => column.reduce((sum, v) => add(sum, Math.round(v / units[k])), 0));
    const bytes = [new Uint8Array(e.action.buffer, e.action.byteOffset, e.action.byteLength), e.sees.data, e.fires.data, e.hears.data,
                   ...e.minds.flatMap(mind => [mind.value, mind.likely, mind.probability])];
    return [...states, ...bytes.map(column => column.reduce(add, 0))].join(" ");
  });
  return seen;
}

async function usePage() {
  for (let k = 0; k < 1000 && !window.watch; ++k) await new Promise(done => setTimeout(done, 20));
  const seen = {};
  if (PART === "columns") return columns(seen);
  await frame();
  const {scene} = watch.panes[0], {episode} = scene;
  seen.about = text("about");
  seen.agents = episode.n;
  seen.steps = watch.steps;
  seen.layers = ["trails", "weapon", "contacts"].filter(name => watch.options[name]);
  // What the page knows, told again by the test from the replay.
  const sum = array => array.reduce((a, b) => a + b, 0);
  seen.states = [];
  for (const step of [0, 70, watch.steps]) {
    watch.seek(step); await frame();
    watch.setOption("side", 0); await frame();
    const known = sum(scene.facts(step).known), {fire} = scene.facts(step);
    seen.states.push(`${step}: ${episode.living(0, step)} ${episode.living(1, step)} ${known} ${fire.length} ${fire.filter(([, , hits]) => hits).length}`);
    watch.setOption("side", -1);
  }
  watch.seek(70); watch.choose(0); await frame();
  seen.first = document.getElementById("agent").innerText.replace(/\s+/g, " ");
  watch.choose(999); await frame();
  seen.last = document.getElementById("agent").innerText.replace(/\s+/g, " ");
  watch.choose(-1); watch.seek(0);
  press(" ");
  const before = watch.frames;
  for (let k = 0; k < 20; ++k) await frame();
  seen.played = watch.frames - before >= 10 && watch.step > 0;
  press(" ");
  press("v"); await frame();
  seen.view = document.getElementById("view").value;
  seen.requests = performance.getEntriesByType("resource").map(entry => entry.name);
  return seen;
}
