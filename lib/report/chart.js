// ReportCharts: the charts of a report. All share the x axis, the zoom and the place of the pointer.
"use strict";

const DASHES = [null, [7, 4], [2, 3], [11, 4, 2, 4], [16, 5]];
const FEW_POINTS = 40;  // up to here a line shows its points

// 1234567 as "1.23M"; 0.001234 as "0.00123".
function shortNumber(value, digits = 3) {
  if (value === null || value === undefined || !isFinite(value)) return "-";
  const size = Math.abs(value);
  if (size < 1e4) {
    if (size !== 0 && size < 1e-3) return value.toExponential(digits - 1).replace(/\.?0+e/, "e");
    return String(Number(value.toPrecision(size < 1 ? digits : Math.max(digits, 4))));
  }
  const unit = Math.min(4, Math.floor(Math.log10(size) / 3));
  return Number((value / 1000 ** unit).toPrecision(4)) + ["", "k", "M", "G", "T"][unit];
}

// Seconds as 1:02:03, 2:03 or 0.5 s.
function clockText(seconds) {
  if (seconds < 10 && seconds % 1 !== 0) return Number(seconds.toPrecision(2)) + " s";
  const whole = Math.round(seconds), pad = n => String(n).padStart(2, "0");
  const h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60, s = whole % 60;
  return h > 0 ? `${h}:${pad(m)}:${pad(s)}` : `${m}:${pad(s)}`;
}

// Ticks of a time axis, at whole seconds, minutes and hours where dygraphs would take powers of ten.
function clockTicks(from, to, pixels) {
  const wanted = (to - from) / Math.max(2, pixels / 80);
  const steps = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
  const nice = 10 ** Math.ceil(Math.log10(wanted));
  const step = wanted < 0.5 || wanted > 86400 ? nice : steps.find(s => s >= wanted);
  const ticks = [];
  for (let k = Math.ceil(from / step); k * step <= to; ++k) ticks.push({v: k * step, label: clockText(k * step)});
  return ticks;
}

// Values averaged over `reach` known neighbours to each side; unknown ones stay unknown.
function smoothed(values, reach) {
  if (reach === 0) return values;
  const known = values.map((v, k) => k).filter(k => values[k] !== null);
  const out = values.slice();
  known.forEach((k, n) => {
    const r = Math.min(reach, n, known.length - 1 - n);  // as far to the left as to the right, so that ends do not lean
    let sum = 0;
    for (let j = n - r; j <= n + r; ++j) sum += values[known[j]];
    out[k] = sum / (2 * r + 1);
  });
  return out;
}

class ReportCharts {
  constructor(groups) {
    this.groups = groups;
    this.charts = [];
    this.keys = [];  // samples in the key of the groups
    this.axis = "agent_steps";
    this.colour = "team";
    this.reach = 0;
    this.window = null;  // of x; null = all
    this.onZoom = () => {};
    this.makeRows();
  }

  // The x values of all groups in one list, and where each group's points stand in it.
  makeRows() {
    this.x = [...new Set(this.groups.flatMap(group => group[this.axis]))].sort((a, b) => a - b);
    const rowOf = new Map(this.x.map((x, row) => [x, row]));
    this.rows = this.groups.map(group => group[this.axis].map(x => rowOf.get(x)));
  }

  xText(x) { return this.axis === "seconds" ? clockText(x) : shortNumber(x) + " agent-steps"; }

  style(line) {
    const css = getComputedStyle(document.documentElement), read = name => css.getPropertyValue(name).trim();
    const hue = n => read(`--hue-${n % 8}`);
    if (this.colour === "group") return {color: hue(line.group), dash: DASHES[line.index % DASHES.length]};
    const dash = DASHES[line.group % DASHES.length];
    if (line.team >= 0) return {color: read(`--team-${line.team}`), dash};
    return {color: line.alone ? read("--neutral") : hue(line.hue), dash};
  }

  // The key of the groups: where lines are told apart by group, its colour and dashes.
  styleKey(sample, group) {
    const {color, dash} = this.style({group, index: 0, team: -1, alone: true, hue: 0});
    styleSample(sample, color, dash);
  }

  // Draws a chart into an element of the page. `spec`: title, note, range, series of {label, column, team}.
  add(parent, spec) {
    const chart = {spec, lines: [], shown: []};
    const several = this.groups.length > 1, ofNoTeam = spec.series.filter(s => s.team < 0).length;
    spec.series.forEach((series, index) => {
      this.groups.forEach((group, g) => {
        const curve = group.curves[series.column];
        if (!curve) return;
        const name = several ? `${group.letter} ${spec.series.length > 1 ? series.label : ""}` : series.label;
        const hue = spec.series.length > ofNoTeam ? 5 : index;  // beside teams: grey
        chart.lines.push({name, curve, index, group: g, team: series.team, alone: spec.series.length === 1, hue});
      });
    });
    chart.shown = chart.lines.map(() => true);
    this.build(parent, chart);
    chart.graph = new Dygraph(chart.plot, this.table(chart), this.options(chart));
    this.charts.push(chart);
    this.follow(chart);
    this.tell(null);
    return chart;
  }

  // The elements around a plot.
  build(parent, chart) {
    const card = element(parent, "article", "card chart");
    const head = element(card, "div", "head");
    element(head, "h3", "", chart.spec.title);
    chart.at = element(head, "span", "at");
    element(card, "p", "note", chart.spec.note);
    const names = element(card, "div", "names");
    chart.buttons = chart.lines.map((line, k) => {
      const button = element(names, "button");
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      const sample = lineSample(button);
      if (chart.lines.length > 1 || this.groups.length > 1) element(button, "span", "name", line.name);
      const value = element(button, "span", "value");
      button.addEventListener("click", () => {
        chart.shown[k] = !chart.shown[k];
        button.setAttribute("aria-pressed", chart.shown[k]);
        chart.graph.setVisibility(k, chart.shown[k]);
      });
      return {button, value, sample};
    });
    const frame = element(card, "div", "plot-frame");
    chart.plot = element(frame, "div", "plot");
    chart.plot.setAttribute("role", "img");
    chart.plot.setAttribute("aria-label", chart.spec.title + ", a chart");
    chart.hairline = element(frame, "div", "hairline");
    chart.hairline.hidden = true;
  }

  // Rows of dygraphs: x, then [low, mean, high] per line.
  table(chart) {
    const table = this.x.map(x => [x, ...chart.lines.map(() => [null, null, null])]);
    chart.lines.forEach((line, k) => {
      const mean = smoothed(line.curve.mean, this.reach);
      const low = line.curve.low ? smoothed(line.curve.low, this.reach) : mean;
      const high = line.curve.high ? smoothed(line.curve.high, this.reach) : mean;
      line.points = [];
      this.rows[line.group].forEach((row, n) => {
        if (mean[n] === null) return;
        table[row][k + 1] = [low[n], mean[n], high[n]];
        line.points.push({x: this.x[row], mean: mean[n], low: low[n], high: high[n]});
      });
    });
    return table;
  }

  options(chart) {
    const css = getComputedStyle(document.documentElement), series = {};
    chart.lines.forEach((line, k) => {
      const {color, dash} = this.style(line);
      series["line" + k] = {color, strokePattern: dash, drawPoints: line.points.length <= FEW_POINTS};
      styleSample(chart.buttons[k].sample, color, dash);
    });
    const range = chart.spec.range, clock = this.axis === "seconds";
    return {
      labels: ["x", ...chart.lines.map((_, k) => "line" + k)],
      series,
      customBars: true,
      connectSeparatedPoints: true,
      legend: "never",
      strokeWidth: 1.8,
      pointSize: 2,
      fillAlpha: 0.16,
      highlightCircleSize: 3,
      gridLineColor: css.getPropertyValue("--grid").trim(),
      axisLineColor: css.getPropertyValue("--line").trim(),
      yRangePad: 8,
      rightGap: 12,
      dateWindow: this.window,
      valueRange: range ? [range[0] - 0.02, range[1] + 0.02] : null,
      axes: {
        x: {drawGrid: false, axisLabelFormatter: x => clock ? clockText(x) : shortNumber(x), pixelsPerLabel: 80,
            ticker: clock ? clockTicks : Dygraph.numericLinearTicks},
        y: {axisLabelWidth: 46, axisLabelFormatter: y => shortNumber(y), pixelsPerLabel: range ? 24 : 30},
      },
    };
  }

  // Zoom and pointer of one chart are those of all.
  follow(chart) {
    chart.graph.updateOptions({
      drawCallback: (graph, first) => {
        if (first || this.busy) return;
        const [from, to] = graph.xAxisRange(), all = graph.xAxisExtremes();
        this.zoom(from <= all[0] && to >= all[1] ? null : [from, to]);
      },
      highlightCallback: (event, x) => this.tell(x, chart),
      unhighlightCallback: () => this.tell(null),
    }, true);
  }

  // Shows the range [from, to] of x in all charts; null = all of it.
  zoom(range) {
    const same = range === this.window || (range && this.window && range.every((v, k) => v === this.window[k]));
    if (same) return;
    this.window = range;
    this.busy = true;
    for (const {graph} of this.charts) graph.updateOptions({dateWindow: range});
    this.busy = false;
    this.onZoom(range !== null);
  }

  // Values beside the names: those nearest to x, or the last ones.
  tell(x, source) {
    for (const chart of this.charts) {
      chart.at.textContent = x === null ? "" : "at " + this.xText(x);
      chart.hairline.hidden = x === null;
      if (x !== null) chart.hairline.style.left = chart.graph.toDomXCoord(x) + "px";
      if (x === null && chart !== source) chart.graph.clearSelection();
      chart.lines.forEach((line, k) => {
        const point = x === null ? line.points[line.points.length - 1] : nearest(line.points, x);
        const {value} = chart.buttons[k];
        value.textContent = point ? shortNumber(point.mean) : "-";
        if (point && point.low !== point.high)
          element(value, "small", "", ` ${shortNumber(point.low)} to ${shortNumber(point.high)}`);
      });
    }
  }

  // Draws all again after a change of axis, colours or smoothing.
  redraw() {
    this.busy = true;
    for (const chart of this.charts) {
      const file = this.table(chart);
      chart.graph.updateOptions({...this.options(chart), file});
    }
    this.busy = false;
    this.keys.forEach((sample, g) => this.styleKey(sample, g));
    this.tell(null);
  }

  setAxis(axis) {
    this.axis = axis;
    this.window = null;
    this.onZoom(false);
    this.makeRows();
    this.redraw();
  }
}

// The point whose x is nearest; points are in the order of x.
function nearest(points, x) {
  let low = 0, high = points.length - 1;
  if (high < 0) return null;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (points[middle].x <= x) low = middle; else high = middle;
  }
  return x - points[low].x <= points[high].x - x ? points[low] : points[high];
}

// A short line that shows colour and dashes of a curve.
function lineSample(parent) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.innerHTML = '<line x1="1" x2="29" y1="4" y2="4" stroke-width="2.5"/>';
  svg.setAttribute("class", "sample");
  svg.setAttribute("aria-hidden", "true");
  parent.appendChild(svg);
  return svg.firstChild;
}

function styleSample(sample, color, dash) {
  sample.setAttribute("stroke", color);
  sample.setAttribute("stroke-dasharray", (dash || []).join(" "));
}

// A new element at the end of another one.
function element(parent, tag, className = "", text = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text) made.textContent = text;
  parent.appendChild(made);
  return made;
}
