// Uses a report as a reader does.
const pause = milliseconds => new Promise(done => setTimeout(done, milliseconds));

// How many pixels wide a line is drawn; 0 where it is hidden or has no colour.
function widthOf(line) {
  const {stroke} = getComputedStyle(line.curve), [red, green, blue] = stroke.match(/\d+/g) ?? [];
  return blue === undefined || stroke === getComputedStyle(document.body).backgroundColor
    ? 0 : line.curve.getBoundingClientRect().width;
}
const lineWidths = chart => chart.lines.map(widthOf);
const charts = () => reportCharts.charts.filter(chart => !chart.plot.closest("details:not([open])"));
const chartOf = title => charts().find(chart => chart.title === title);

// An event of the pointer over a chart at a share of its width.
function point(chart, type, share) {
  const box = chart.plot.getBoundingClientRect();
  chart.plot.dispatchEvent(new PointerEvent(type, {bubbles: true, cancelable: true, view: window, button: 0,
    clientX: box.left + share * box.width, clientY: box.top + box.height / 2}));
}

// What is shown of the x axis, and the labels that all charts have there.
const ranges = () => [JSON.stringify(reportCharts.range().map(Math.round))];
const labels = () =>
  [...new Set(charts().map(chart => [...chart.axes.querySelectorAll(".x")].map(text => text.textContent).join(" ")))];

async function usePage() {
  const seen = {};
  seen.charts = charts().length;
  seen.line_pixels = charts().map(chart => Math.min(...lineWidths(chart)));
  seen.full_range = ranges();
  seen.full_labels = labels();
  seen.ground = getComputedStyle(document.body).backgroundColor;
  seen.text = document.body.innerText;

  const entropy = chartOf("Entropy");
  point(entropy, "pointermove", 0.5);
  seen.hover_at = [...new Set(charts().map(chart => chart.at.textContent))];
  seen.hover_value = entropy.lines[0].value.textContent;
  point(entropy, "pointerleave", 0.5);

  point(entropy, "pointerdown", 0.25);
  point(entropy, "pointermove", 0.5);
  point(entropy, "pointermove", 0.75);
  point(entropy, "pointerup", 0.75);
  seen.zoomed_range = ranges();
  seen.zoomed_labels = labels();
  seen.reset_shown = !document.getElementById("reset").hidden;
  for (const type of ["pointerdown", "pointerup", "pointerdown", "pointerup", "dblclick"]) point(entropy, type, 0.5);
  seen.unzoomed_range = ranges();
  seen.unzoomed_labels = labels();

  seen.pixels_before = lineWidths(entropy)[0];
  entropy.lines[0].button.click();
  seen.pixels_hidden = lineWidths(entropy)[0];
  entropy.lines[0].button.click();

  const pictures = () =>
    [...document.querySelectorAll(".picture img")].filter(image => image.offsetWidth).map(image => image.naturalWidth);
  seen.pictures = pictures();
  document.querySelector("#axis input[value=seconds]").click();
  seen.seconds_range = ranges();
  seen.seconds_labels = labels();
  seen.seconds_pictures = pictures();
  const smoothing = document.getElementById("smoothing");
  smoothing.value = 3;
  smoothing.dispatchEvent(new Event("input"));
  seen.smoothing = document.getElementById("smoothing-text").textContent;

  for (const folded of document.querySelectorAll("details")) folded.open = true;
  await pause(200);
  seen.charts_unfolded = charts().length;
  seen.unfolded_pixels = charts().map(chart => Math.min(...lineWidths(chart)));

  document.getElementById("theme").click();
  seen.other_ground = getComputedStyle(document.body).backgroundColor;
  seen.other_pixels = Math.min(...lineWidths(entropy));
  seen.requests = performance.getEntriesByType("resource").map(entry => entry.name);
  seen.injected = document.querySelectorAll("#evil").length;
  return seen;
}
