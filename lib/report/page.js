// Connects the controls of the page.

function usesDark() { return document.documentElement.dataset.theme === "dark"; }

function setTheme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  document.getElementById("theme").textContent = dark ? "Light" : "Dark";
}

// The charts follow at once; pictures by the style of the page.
function setAxis(axis, charts) {
  document.documentElement.dataset.axis = axis;
  charts.setAxis(axis);
}

function connectControls(charts) {
  const reset = document.getElementById("reset"), smoothing = document.getElementById("smoothing");
  charts.onZoom = zoomed => { reset.hidden = !zoomed; };
  reset.addEventListener("click", () => charts.zoom(null));
  document.getElementById("axis").addEventListener("change", event => setAxis(event.target.value, charts));
  document.getElementById("colour").hidden = charts.groups.length < 2;
  document.querySelector(`#colour input[value="${document.documentElement.dataset.colour}"]`).checked = true;
  document.getElementById("colour").addEventListener("change", event => {
    document.documentElement.dataset.colour = event.target.value;
  });
  smoothing.addEventListener("input", () => {
    charts.reach = Number(smoothing.value);
    document.getElementById("smoothing-text").textContent =
      charts.reach ? `mean of ${2 * charts.reach + 1} points` : "off";
    charts.redraw();
  });
  document.getElementById("theme").addEventListener("click", () => setTheme(!usesDark()));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", event => setTheme(event.matches));
}

setTheme(matchMedia("(prefers-color-scheme: dark)").matches);
document.documentElement.dataset.axis = "agent_steps";
const reportCharts = new ReportCharts(JSON.parse(document.getElementById("axes").textContent),
                                      document.getElementsByClassName("chart"));
connectControls(reportCharts);
