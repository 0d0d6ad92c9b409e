// Uses the page of a replay as a person does.
const press = key => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true}));
const value = id => document.getElementById(id).value;

// The colour in the middle of an agent on the first canvas.
function colorAt(i) {
  const {canvas, places} = watch.panes[0].scene, ratio = devicePixelRatio;
  const [x, y] = places[i];
  return [...canvas.getContext("2d").getImageData(Math.round(x * ratio), Math.round(y * ratio), 1, 1).data.slice(0, 3)].join(" ");
}

// The game from above and, in the dark, in three dimensions, without what depends on fonts.
async function comparePictures(seen) {
  watch.pause();
  document.getElementById("beside").value = "-1";
  document.getElementById("beside").dispatchEvent(new Event("change"));
  const [pane] = watch.panes, {canvas} = pane.scene, look = async () => { watch.redraw(); await frame(); await frame(); };
  watch.setTheme(false);
  for (const name of ["sight", "weapon", "trails", "fire", "contacts"]) watch.setOption(name, true);
  watch.setOption("names", false); watch.setOption("view", "top"); watch.setOption("side", -1);
  watch.choose(0, pane);
  pin(canvas, 300, 240);
  watch.seek(2);
  await look(); await notePicture(seen, canvas, "top");
  const wrong = async what => { await look(); await noteWrong(seen, canvas, "top", what); };
  watch.seek(3); await wrong("another step");
  watch.seek(2);
  const root = document.documentElement, [box] = pane.game.episode.boxes();
  root.style.setProperty("--team-1", "#0072b2"); await wrong("another colour");
  root.style.removeProperty("--team-1");
  box[0] -= 1; await wrong("another map"); box[0] += 1;
  watch.setOption("view", "3d"); await wrong("another view");
  watch.setTheme(true);
  await look(); await notePicture(seen, canvas, "solid");
}

async function usePage() {
  for (let k = 0; k < 200 && !window.watch; ++k) await new Promise(done => setTimeout(done, 20));
  if (!window.watch) return {about: document.getElementById("about").textContent};
  const seen = {};
  await frame();
  seen.games = document.getElementById("game").options.length;
  seen.panes = watch.panes.length;
  seen.title = document.querySelector("h1").textContent;
  seen.injected = document.querySelectorAll("b#evil, h1 b").length;

  // Scrubbing to step k shows step k.
  seen.scrubbed = [];
  for (let k = 0; k <= Number(document.getElementById("scrub").max); ++k) {
    const scrub = document.getElementById("scrub");
    scrub.value = k;
    scrub.dispatchEvent(new Event("input"));
    await frame();
    const {x, y} = watch.panes[0].scene.place(0, watch.time);
    seen.scrubbed.push(`${text("now").split(" of ")[0]}: ${x.toFixed(2)} ${y.toFixed(2)} ${watch.panes[0].score.innerText.replace(/\s+/g, " ")}`);
  }
  watch.seek(1); await frame();
  watch.setOption("weapon", false); watch.setOption("trails", false); await frame();
  seen.color = colorAt(0);

  press("ArrowRight"); await frame(); seen.right = value("scrub");
  press("Home"); await frame(); seen.home = value("scrub");
  press("n"); await frame(); seen.next_event = value("scrub");
  seen.spoken = text("spoken");
  press("v"); await frame(); seen.view = value("view");
  press("v"); press("0"); await frame(); seen.side = value("side");
  seen.known_by_0 = [...watch.panes[0].scene.facts(watch.step).known].join("");
  press("e");

  // Choose an agent by a click.
  watch.seek(1); await frame();
  const {canvas, places} = watch.panes[0].scene, box = canvas.getBoundingClientRect();
  for (const type of ["pointerdown", "pointerup"])
    canvas.dispatchEvent(new PointerEvent(type, {bubbles: true, pointerId: 1, clientX: box.left + places[0][0], clientY: box.top + places[0][1]}));
  await frame();
  seen.chosen = watch.chosen;
  seen.agent = document.getElementById("agent").innerText.replace(/\s+/g, " ");
  seen.curve_shown = !document.getElementById("curve").hidden;
  watch.choose(1); watch.seek(4); await frame();
  seen.dead = text("agent-facts");

  // Playing moves on and stops at the end.
  watch.seek(0); press(" ");
  const before = watch.frames;
  for (let k = 0; k < 400 && watch.playing; ++k) await frame();
  seen.played_to = value("scrub"); seen.played_frames = watch.frames - before; seen.stopped = !watch.playing;

  const ground = () => getComputedStyle(document.body).backgroundColor;
  seen.grounds = [ground()];
  document.getElementById("theme").click(); await frame();
  seen.grounds.push(ground());
  seen.events = [...document.querySelectorAll("#events li")].map(item => item.textContent);
  seen.unnamed = unnamed();
  seen.wide = document.documentElement.scrollWidth <= innerWidth;

  document.getElementById("beside").value = "0";
  document.getElementById("beside").dispatchEvent(new Event("change")); await frame();
  seen.panes_beside = watch.panes.length;
  seen.requests = performance.getEntriesByType("resource").map(entry => entry.name);
  if (REFERENCES) await comparePictures(seen);
  return seen;
}
