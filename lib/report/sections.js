// How each kind of section is drawn. All texts go in as text, never as HTML.

const SECTION_KINDS = {
  figures(parent, section) {
    for (const group of section.groups) {
      const card = element(parent, "div", "card figures");
      if (section.groups.length > 1) element(card, "h3", "", group.label);
      const facts = element(card, "dl", "facts");
      for (const [name, value] of group.facts) {
        const fact = element(facts, "div");
        element(fact, "dt", "", name);
        element(fact, "dd", "", value);
      }
      const results = element(card, "div", "results");
      results.hidden = group.results.length === 0;
      for (const result of group.results) drawResult(results, result, group.episodes);
    }
  },

  charts(parent, section, charts) {
    if (charts.charts.length === 0) drawReadings(parent, charts.groups);
    const grid = element(parent, "div", "grid");
    for (const spec of section.charts) charts.add(grid, spec);
  },

  time(parent, section) {
    const card = element(parent, "div", "card time");
    for (const group of section.groups) {
      if (section.groups.length > 1) element(card, "h3", "", group.label);
      const box = element(card, "div");
      const stack = element(box, "div", "stack"), parts = element(box, "div", "parts");
      const all = group.parts.reduce((sum, part) => sum + part.seconds, 0);
      group.parts.forEach((part, k) => {
        const colour = `var(--hue-${[0, 2, 1, 5][k % 4]})`, share = all > 0 ? part.seconds / all : 0;
        const piece = element(stack, "span");
        piece.style.cssText = `flex: ${share} 0 0; background: ${colour}`;
        const text = element(parts, "span");
        element(text, "i").style.background = colour;
        text.append(`${part.name} ${(100 * share).toFixed(1)} % `);
        element(text, "span", "", part.text);
      });
    }
  },

  // A picture is shown as an image, in which nothing is carried out; one along an axis while that one is chosen.
  pictures(parent, section) {
    for (const picture of section.pictures) {
      const card = element(parent, "div", "card picture"), image = element(card, "img");
      if (picture.along) card.dataset.along = picture.along;
      image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(picture.svg);
      image.alt = section.title;
    }
    for (const spec of section.tables) drawTable(parent, spec);
  },

  tables(parent, section) {
    for (const spec of section.tables) drawTable(parent, spec);
  },

  commands(parent, section) {
    element(parent, "pre", "card", section.lines.join("\n"));
  },
};

// How the curves are to be read, above the first of them; the key of the groups where there are several.
function drawReadings(parent, groups) {
  const list = element(parent, "ul", "readings");
  for (const group of groups) {
    const item = element(list, "li", "line");
    if (groups.length > 1) {
      item.style.cssText = group.style;
      lineSample(item);
      element(item, "b", "", group.label);
    }
    element(item, "span", "", group.reading);
  }
}

// Win rates of both teams against one opponent, as bars from 0 to 1 with the spread over the seeds.
function drawResult(parent, result, episodes) {
  const box = element(parent, "div");
  const known = result.teams.filter(team => team !== null), runs = Math.max(...known.map(team => team.runs));
  const title = element(box, "h4", "", `Won against ${result.opponent} `);
  element(title, "span", "", `in ${episodes} episodes` + (runs > 1 ? `, mean of ${runs} seeds` : ""));
  result.teams.forEach((team, index) => {
    if (team === null) return;
    const bar = element(box, "div", "bar");
    element(bar, "span", "", `team ${index}`);
    const track = element(bar, "div", "track");
    const fill = element(track, "div", "fill");
    fill.style.cssText = `width: ${100 * team.mean}%; background: var(--team-${index})`;
    const number = element(bar, "span", "number");
    element(number, "b", "", team.mean.toFixed(2));
    if (team.runs < 2) return;
    const spread = element(track, "div", "spread");
    spread.style.cssText = `left: ${100 * team.low}%; width: ${100 * (team.high - team.low)}%`;
    element(number, "span", "", `${team.low.toFixed(2)} to ${team.high.toFixed(2)}`);
  });
}

// A table with an optional caption; `folded`: opened by the reader.
function drawTable(parent, spec) {
  let place = parent;
  if (spec.folded) {
    place = element(parent, "details", "card folded");
    element(place, "summary", "", spec.caption);
  }
  const table = element(element(place, "div", spec.folded ? "scroll" : "card scroll"), "table");
  if (spec.caption && !spec.folded) element(table, "caption", "", spec.caption);
  const head = element(element(table, "thead"), "tr");
  for (const name of spec.head) element(head, "th", "", name);
  const body = element(table, "tbody");
  for (const cells of spec.rows) {
    const row = element(body, "tr");
    const isDefault = spec.head.indexOf("default");
    cells.forEach((text, k) => {
      const own = k > 0 && k < isDefault && text !== cells[isDefault];
      element(row, "td", own ? "own" : spec.head[k] === "meaning" ? "meaning" : "", text);
    });
  }
}

// A section with its title; what is folded is drawn when it is opened.
function drawSection(parent, section, charts) {
  const box = element(parent, "section", "section"), draw = SECTION_KINDS[section.kind];
  if (!draw) throw new Error("no section kind " + section.kind);
  let place = box;
  if (section.folded) {
    place = element(box, "details");
    element(element(place, "summary"), "h2", "", section.title);
    place.addEventListener("toggle", () => draw(place, section, charts), {once: true});
  } else {
    element(box, "h2", "", section.title);
  }
  if (section.note) element(place, "p", "note", section.note);
  if (!section.folded) draw(place, section, charts);
}
