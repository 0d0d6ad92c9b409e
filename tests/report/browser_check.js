// Uses a report as a reader does and writes down what it sees, as JSON in <pre id="outcome">. browser_test.cpp puts it at
// the end of a page; `problems` are the errors since the page's beginning.
const pause = milliseconds => new Promise(done => setTimeout(done, milliseconds));

// Pixels of a colour ("#rrggbb") in a chart: all fully covered ones, at most 3 away in each channel.
const sheet = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
function pixelsOf(chart, colour) {
  const wanted = [1, 3, 5].map(k => parseInt(colour.slice(k, k + 2), 16));
  let count = 0;
  for (const canvas of chart.plot.querySelectorAll("canvas")) {
    [sheet.canvas.width, sheet.canvas.height] = [canvas.width, canvas.height];  // and empties it
    sheet.drawImage(canvas, 0, 0);
    const {data} = sheet.getImageData(0, 0, canvas.width, canvas.height);
    for (let k = 0; k < data.length; k += 4)
      if (data[k + 3] === 255 && wanted.every((v, c) => Math.abs(data[k + c] - v) <= 3)) ++count;
  }
  return count;
}
const linePixels = chart => chart.lines.map(line => pixelsOf(chart, reportCharts.style(line).color));
const charts = () => reportCharts.charts;
const chartOf = title => charts().find(chart => chart.spec.title === title);

// A mouse event over a chart at a share of its width.
function mouse(chart, type, share) {
  const canvas = chart.plot.querySelectorAll("canvas")[1], box = canvas.getBoundingClientRect();
  const area = chart.graph.getArea();
  canvas.dispatchEvent(new MouseEvent(type, {bubbles: true, cancelable: true, view: window, button: 0, detail: 1,
    clientX: box.left + area.x + share * area.w, clientY: box.top + area.y + area.h / 2}));
}
const ranges = () => [...new Set(charts().map(chart => JSON.stringify(chart.graph.xAxisRange().map(Math.round))))];

async function useReport() {
  const seen = {};
  seen.charts = charts().length;
  seen.line_pixels = charts().map(chart => Math.min(...linePixels(chart)));
  seen.full_range = ranges();
  seen.ground = getComputedStyle(document.body).backgroundColor;
  seen.text = document.body.innerText;

  const entropy = chartOf("Entropy");
  mouse(entropy, "mousemove", 0.5);
  seen.hover_at = [...new Set(charts().map(chart => chart.at.textContent))];
  seen.hover_value = entropy.buttons[0].value.textContent;
  mouse(entropy, "mouseout", 0.5);

  mouse(entropy, "mousedown", 0.25);
  mouse(entropy, "mousemove", 0.5);
  mouse(entropy, "mousemove", 0.75);
  mouse(entropy, "mouseup", 0.75);
  seen.zoomed_range = ranges();
  seen.reset_shown = !document.getElementById("reset").hidden;
  for (const type of ["mousedown", "mouseup", "mousedown", "mouseup", "dblclick"]) mouse(entropy, type, 0.5);
  seen.unzoomed_range = ranges();

  seen.pixels_before = linePixels(entropy)[0];
  entropy.buttons[0].button.click();
  seen.pixels_hidden = linePixels(entropy)[0];
  entropy.buttons[0].button.click();

  const pictures = () =>
    [...document.querySelectorAll(".picture img")].filter(image => image.offsetWidth).map(image => image.naturalWidth);
  seen.pictures = pictures();
  document.querySelector("#axis input[value=seconds]").click();
  seen.seconds_range = ranges();
  seen.seconds_pictures = pictures();
  const smoothing = document.getElementById("smoothing");
  smoothing.value = 3;
  smoothing.dispatchEvent(new Event("input"));
  seen.smoothing = document.getElementById("smoothing-text").textContent;

  for (const folded of document.querySelectorAll("details")) folded.open = true;
  await pause(200);
  seen.charts_unfolded = charts().length;
  seen.unfolded_pixels = charts().map(chart => Math.min(...linePixels(chart)));

  document.getElementById("theme").click();
  seen.other_ground = getComputedStyle(document.body).backgroundColor;
  seen.other_pixels = Math.min(...linePixels(entropy));
  seen.requests = performance.getEntriesByType("resource").map(entry => entry.name);
  seen.injected = document.querySelectorAll("#evil").length;
  return seen;
}

useReport().catch(error => { problems.push(String(error.stack || error)); return {}; }).then(seen => {
  element(document.body, "pre").id = "outcome";
  document.getElementById("outcome").textContent = JSON.stringify({...seen, problems});
});
