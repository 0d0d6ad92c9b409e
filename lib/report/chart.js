// ReportCharts: what a reader does with the charts of a report, which come drawn (lib/chart/curve_plot.cpp): reads
// values, hides lines, zooms, smooths, changes the x axis. All charts share x axis, zoom and the place of the pointer.
"use strict";

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

// Round places of an axis, about `count` of them; those of time at whole seconds, minutes and hours.
function axisTicks(from, to, count, isTime) {
  const rough = (to - from) / count, power = 10 ** Math.floor(Math.log10(rough));
  const times = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
  const round = [1, 2, 5, 10].map(factor => factor * power).find(step => step >= 0.8 * rough);
  const step = (isTime && rough > 0.5 && times.find(time => time >= rough)) || round;
  const ticks = [];
  for (let k = Math.ceil(from / step); k * step <= to; ++k) ticks.push(k * step);
  return ticks;
}

// Values averaged over `reach` neighbours to each side, fewer at the ends, so that these do not lean.
function smoothed(values, reach) {
  if (reach === 0) return values;
  return values.map((_, k) => {
    const r = Math.min(reach, k, values.length - 1 - k), near = values.slice(k - r, k + r + 1);
    return near.reduce((a, b) => a + b) / near.length;
  });
}

// A line of a chart: its name, what is drawn of it, and its points as they were drawn: `rows` in the x of its group,
// and values, those of the band where it has one. `edges`: the values of the upper and the lower edge of the drawing.
function readLine(button, drawn, group, size, edges) {
  const [curve, band, dots] = ["curve", "band", "dots"].map(name => drawn.getElementsByClassName(name)[0]);
  const step = (edges.high - edges.low) / size, digit = 10 ** Math.ceil(Math.log10(step));  // what the drawing resolves
  const value = y => Math.round((edges.high - step * y) / digit) * digit;
  const values = path => path.getAttribute("d").slice(1).split(" ").filter((_, k) => k % 2).map(value);
  const mean = values(curve), n = mean.length, both = band ? values(band) : [...mean, ...mean.slice().reverse()];
  const rows = drawn.dataset.rows ? drawn.dataset.rows.split(" ").map(Number) : mean.map((_, k) => k);
  return {button, value: button.querySelector(".value"), drawn, curve, band, dots, group, rows, mean,
          high: both.slice(0, n), low: both.slice(n).reverse()};
}

class ReportCharts {
  constructor(groups, cards) {
    this.groups = groups;
    this.axis = "agent_steps";
    this.reach = 0;      // of smoothing
    this.window = null;  // of x; null = all
    this.onZoom = () => {};
    this.charts = [...cards].map(card => this.connect(card));
    this.placePoints();
    this.tell(null);
  }

  xText(x) { return this.axis === "seconds" ? clockText(x) : shortNumber(x) + " agent-steps"; }

  // The first and the last x that are shown.
  range() {
    if (this.window) return this.window;
    const from = Math.min(...this.groups.map(group => group[this.axis][0]));
    const to = Math.max(...this.groups.map(group => group[this.axis].at(-1)));
    return from < to ? [from, to] : [from - 1, to + 1];
  }

  connect(card) {
    const plot = card.querySelector(".plot"), [axes, curves, selection, hairline] = plot.children;
    const edges = {low: Number(plot.dataset.low), high: Number(plot.dataset.high)}, size = curves.viewBox.baseVal.width;
    const lines = [...card.querySelectorAll(".names button")].map((button, k) =>
      readLine(button, curves.children[k], this.groups[button.dataset.group], size, edges));
    const chart = {title: card.querySelector("h3").textContent, at: card.querySelector(".at"), lines, edges, size,
                   isFixed: Boolean(card.dataset.fixed), plot, axes, selection, hairline};
    for (const {button, drawn} of lines) {
      button.addEventListener("click", () => {
        const shown = drawn.style.display === "none";
        drawn.style.display = shown ? "" : "none";
        button.setAttribute("aria-pressed", shown);
        this.draw(chart);
      });
    }
    this.follow(plot.parentElement, chart);
    return chart;
  }

  // Pointer and zoom of one chart are those of all.
  follow(frame, chart) {
    let start = null;
    const share = event => {
      const box = chart.plot.getBoundingClientRect();
      return Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    };
    const xAt = place => { const [from, to] = this.range(); return from + place * (to - from); };
    const select = (from, to) => {
      chart.selection.setAttribute("x", 100 * from + "%");
      chart.selection.setAttribute("width", 100 * (to - from) + "%");
    };
    frame.addEventListener("pointermove", event => {
      const here = share(event);
      if (start !== null) select(Math.min(start, here), Math.max(start, here));
      this.tell(xAt(here));
    });
    frame.addEventListener("pointerdown", event => { start = event.button === 0 ? share(event) : null; });
    for (const end of ["pointerup", "pointercancel"]) {
      addEventListener(end, event => {
        if (start === null) return;
        const [from, to] = [start, share(event)].sort((a, b) => a - b);
        start = null;
        select(0, 0);
        if (end === "pointerup" && to - from > 0.01) this.zoom([xAt(from), xAt(to)]);
      });
    }
    frame.addEventListener("pointerleave", () => this.tell(null));
    frame.addEventListener("dblclick", () => this.zoom(null));
  }

  // Shows the range [from, to] of x in all charts; null = all of it.
  zoom(range) {
    this.window = range;
    this.redraw();
    this.onZoom(range !== null);
  }

  setAxis(axis) {
    this.axis = axis;
    this.zoom(null);
  }

  // Draws all again after a change of axis, zoom or smoothing.
  redraw() {
    this.placePoints();
    for (const chart of this.charts) this.draw(chart);
    this.tell(null);
  }

  placePoints() {
    for (const line of this.charts.flatMap(chart => chart.lines)) {
      line.x = line.rows.map(row => line.group[this.axis][row]);
      line.now = {};
      for (const key of ["mean", "low", "high"]) line.now[key] = smoothed(line[key], this.reach);
    }
  }

  // The values between which a chart shows what is in its range of x.
  limits(chart, from, to) {
    const shown = chart.lines.filter(line => line.drawn.style.display !== "none");
    const values = shown.flatMap(({x, now}) => {
      const inside = (_, k) => x[k] >= from && x[k] <= to;
      return [...now.low.filter(inside), ...now.high.filter(inside)];
    });
    if (chart.isFixed || values.length === 0) return [chart.edges.low, chart.edges.high];
    const low = values.reduce((a, b) => Math.min(a, b)), high = values.reduce((a, b) => Math.max(a, b));
    const edge = 0.04 * (high - low) || Math.abs(high) / 10 || 1e-9;
    return [low - edge, high + edge];
  }

  draw(chart) {
    const {size} = chart, [from, to] = this.range(), [low, high] = this.limits(chart, from, to);
    for (const {x, now, curve, band, dots} of chart.lines) {
      const points = values => values.map((value, k) =>
        Math.round(size * (x[k] - from) / (to - from)) + " " + Math.round(size * (high - value) / (high - low)));
      const mean = points(now.mean);
      curve.setAttribute("d", "M" + mean.join(" "));
      if (band) band.setAttribute("d", "M" + [...points(now.high), ...points(now.low).reverse()].join(" "));
      if (dots) dots.setAttribute("d", mean.map(point => `M${point}h0`).join(""));
    }
    const isTime = this.axis === "seconds", text = isTime ? clockText : shortNumber;
    const rows = axisTicks(low, high, 6, false).map(y => {
      const at = 100 * (high - y) / (high - low) + "%";
      return `<line x2="100%" y1="${at}" y2="${at}"/><text class="y" x="-8" y="${at}">${shortNumber(y)}</text>`;
    });
    const columns = axisTicks(from, to, 8, isTime).map(x =>
      `<text class="x" x="${100 * (x - from) / (to - from)}%" y="100%" dy="17">${text(x)}</text>`);
    chart.axes.innerHTML = rows.join("") + columns.join("");
  }

  // Values beside the names: those at the point that is nearest to x, or the last ones.
  tell(x) {
    const [from, to] = this.range();
    if (x !== null) {
      const known = this.groups.map(group => group[this.axis]).map(xs => xs[nearest(xs, x)]);
      x = known.reduce((a, b) => Math.abs(b - x) < Math.abs(a - x) ? b : a);
    }
    for (const {at, hairline, lines} of this.charts) {
      at.textContent = x === null ? "" : "at " + this.xText(x);
      hairline.setAttribute("visibility", x === null ? "hidden" : "visible");
      for (const end of ["x1", "x2"]) hairline.setAttribute(end, 100 * ((x ?? from) - from) / (to - from) + "%");
      for (const {value, x: xs, now: {mean, low, high}} of lines) {
        const k = x === null ? mean.length - 1 : nearest(xs, x);
        value.textContent = shortNumber(mean[k]);
        if (low[k] === high[k]) continue;
        const spread = value.appendChild(document.createElement("small"));
        spread.textContent = ` ${shortNumber(low[k])} to ${shortNumber(high[k])}`;
      }
    }
  }
}

// Where the nearest of some growing numbers stands.
function nearest(numbers, x) {
  let low = 0, high = numbers.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= x) low = middle; else high = middle;
  }
  return x - numbers[low] <= numbers[high] - x ? low : high;
}
