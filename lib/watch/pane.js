// A game on the page: its canvas and score, and how a pointer turns it and chooses agents.

class Pane {
  constructor(parent, watch) {
    this.watch = watch;
    this.root = parent.appendChild(document.createElement("section"));
    this.root.className = "pane";
    this.title = this.root.appendChild(document.createElement("h2"));
    this.canvas = this.root.appendChild(document.createElement("canvas"));
    this.canvas.setAttribute("role", "img");
    this.canvas.tabIndex = 0;
    this.score = this.root.appendChild(document.createElement("div"));
    this.score.className = "score";
    this.connectPointers();
  }
  show(game) {
    this.game = game;
    const {episode} = game, {limit_x, limit_y} = episode.replay.rules;
    if (this.scene) this.scene.show(episode); else this.scene = new Scene(this.canvas, episode, this.watch.options);
    this.title.textContent = game.name;
    this.canvas.style.aspectRatio = String(Math.max(0.8, Math.min(1.6, limit_x / limit_y)));
  }
  draw(time, chosen) {
    const {episode} = this.game, state = Math.min(Math.floor(time + 1e-6), episode.steps);
    this.scene.draw(Math.min(time, episode.steps), chosen < episode.n ? chosen : -1);
    if (this.drawn === state && this.drawnGame === this.game) return;
    this.drawn = state; this.drawnGame = this.game;
    this.score.replaceChildren(...[0, 1].map(team => {
      const line = document.createElement("span"), name = document.createElement("b");
      name.textContent = `team ${team}`;
      name.style.color = `var(--team-${team}-text)`;
      const points = episode.replay.rules.waypoints
        ? `, ${episode.head.events.filter(v => v.what === "collected" && v.step <= state && episode.team(v.agent) === team).length} waypoints` : "";
      line.append(name, ` ${episode.living(team, state)} of ${episode.teams[team]} alive${points}`);
      return line;
    }), state >= episode.steps ? `over: ${endText(episode)}` : "");
    this.canvas.setAttribute("aria-label", this.watch.summary(this.game, state));
  }
  connectPointers() {
    const {canvas, watch} = this, touches = new Map();
    let moved = 0, apart = 0;
    const spread = () => {
      const [a, b] = [...touches.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      touches.set(event.pointerId, {x: event.clientX, y: event.clientY});
      moved = 0;
      if (touches.size === 2) apart = spread();
    });
    canvas.addEventListener("pointermove", event => {
      const last = touches.get(event.pointerId);
      if (!last) return;
      const dx = event.clientX - last.x, dy = event.clientY - last.y, {camera} = this.scene;
      moved += Math.abs(dx) + Math.abs(dy);
      touches.set(event.pointerId, {x: event.clientX, y: event.clientY});
      if (touches.size === 2) { const now = spread(); this.zoom(now / apart); apart = now; return; }
      if (camera.solid && !event.shiftKey) {
        camera.yaw += dx * 0.008;
        camera.tilt = Math.max(0.05, Math.min(1.5, camera.tilt - dy * 0.006));
      } else if (moved > 4) { camera.moved[0] += dx; camera.moved[1] += dy; }
      watch.redraw();
    });
    const end = event => {
      const alone = touches.size === 1;
      touches.delete(event.pointerId);
      if (event.type !== "pointerup" || !alone || moved > 4) return;
      const box = canvas.getBoundingClientRect();
      watch.choose(this.scene.agentAt(event.clientX - box.left, event.clientY - box.top), this);
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("wheel", event => { event.preventDefault(); this.zoom(Math.exp(-event.deltaY * 0.0015)); }, {passive: false});
    canvas.addEventListener("dblclick", () => { const {camera} = this.scene; camera.zoom = 1; camera.moved = [0, 0]; watch.redraw(); });
  }
  zoom(factor) {
    const {camera} = this.scene;
    camera.zoom = Math.max(0.5, Math.min(12, camera.zoom * factor));
    this.watch.redraw();
  }
}
