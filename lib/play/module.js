// The game itself: the WebAssembly module, and its memory as arrays. It is the simulator of the trainer, number for number.

const unpack = async base64 => {
  const bytes = Uint8Array.from(atob(base64), letter => letter.charCodeAt(0));
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
};

class GameModule {
  static async load(bytes) {
    // It is compiled in some hundredths of a second; older browsers refuse to do that at once and do it beside.
    let compiled;
    try { compiled = new WebAssembly.Module(bytes); } catch { compiled = await WebAssembly.compile(bytes); }
    const game = new GameModule();
    const imports = {page: {fail: (at, size) => { throw new Error(new TextDecoder().decode(game.bytes(at, size))); }}};
    // Calls to an operating system, of which there is none here; they answer so (52 is ENOSYS).
    for (const {module, name} of WebAssembly.Module.imports(compiled)) (imports[module] ??= {})[name] ??= () => 52;
    game.calls = (await WebAssembly.instantiate(compiled, imports)).exports;
    game.calls._initialize();
    game.fields = game.names(k => game.calls.play_field_name(k));
    game.stats = game.names(k => game.calls.play_stat_name(k));
    return game;
  }
  bytes(at, size) { return new Uint8Array(this.calls.memory.buffer, at, size); }
  text(at) { const all = this.bytes(at); return new TextDecoder().decode(all.subarray(0, all.indexOf(0))); }
  // Names by their numbers, to numbers by their names.
  names(name) {
    const numbers = new Map();
    for (let k = 0, at; (at = name(k)) !== 0; ++k) numbers.set(this.text(at), k);
    return numbers;
  }
  hand(bytes, call) {
    const at = this.calls.play_allocate(bytes.length);
    this.bytes(at, bytes.length).set(bytes);
    const result = call(at, bytes.length);
    this.calls.play_release(at);
    return result;
  }
  scenario(bytes) { this.hand(bytes, this.calls.play_scenario); }
  network(bytes) { return this.hand(bytes, this.calls.play_network); }
  // `seed`: a BigInt; `who`: by team, numbers of networks, or -1 - that of a script; `person`: an agent, or -1.
  start(seed, who, person) { this.calls.play_start(seed, who[0], who[1], person); }
  step([heading, dive, throttle]) { return this.calls.play_step(heading, dive, throttle) === 1; }
  // The array of the state's field, as it is now.
  field(name, Type, count) { return new Type(this.calls.memory.buffer, this.calls.play_field(this.fields.get(name)), count); }
  stat(name) { return this.field("stats", Float32Array, this.stats.size)[this.stats.get(name)]; }
  actions(team, Type, count) { return new Type(this.calls.memory.buffer, this.calls.play_actions(team), count); }
  hash(steps) { return BigInt.asUintN(64, this.calls.play_hash(steps)).toString(16).padStart(16, "0"); }
}
