"use strict";
// Charts: the values under the pointer; a span that is dragged along time is zoomed to, in all lanes
// of that time, and a double click shows all again. Positions are in the square of chart.py.
const WIDE = 10000, HIGH = 1000;

function points(path) { // of a line in whole numbers, from point to point
  let x = 0, y = 0;
  return path.points ??= path.getAttribute("d").split("M").slice(1).flatMap(part => {
    const numbers = part.match(/-?\d+/g).map(Number), found = [];
    x = y = 0;
    for (let k = 0; k + 1 < numbers.length; k += 2) found.push([x += numbers[k], y += numbers[k + 1]]);
    return found;
  });
}

function text(value, step) {
  return Number(value.toFixed(Math.max(0, Math.min(9, 1 - Math.floor(Math.log10(step)))))).toString();
}

function setUp(figures) {
  const panels = figures.flatMap(figure => [...figure.querySelectorAll(".panel")]).map(panel => ({
    panel,
    svg: panel.querySelector("svg"),
    plot: panel.querySelector(".plot"),
    across: panel.querySelector(".across"),
    output: panel.querySelector("output"),
    lines: [...panel.querySelectorAll("path.line")].filter(path => path.querySelector("title")),
    x: panel.dataset.x.split(" ").map(Number),
    y: panel.dataset.y.split(" ").map(Number),
  }));
  const shade = document.createElement("div");
  let start = null;
  shade.className = "drag";

  function show(ends) { // in seconds; all of each panel without any
    for (const one of panels) {
      const { svg, across, x } = one, [low, high] = ends ?? x, wide = WIDE / (x[1] - x[0]);
      one.view = [(low - x[0]) * wide, (high - x[0]) * wide];
      svg.setAttribute("viewBox", `${one.view[0]} 0 ${one.view[1] - one.view[0]} ${HIGH}`);
      if (!across) continue;
      const power = 10 ** Math.floor(Math.log10((high - low) / 5));
      const step = power * [1, 2, 5, 10].find(k => (high - low) / (k * power) <= 6);
      across.replaceChildren();
      for (let k = Math.ceil(low / step); k * step <= high; k++) {
        const tick = document.createElement("span"), at = 100 * (k * step - low) / (high - low);
        tick.style.left = `${at}%`;
        tick.className = at < 5 ? "start" : at > 95 ? "end" : "";
        tick.textContent = text(k * step, step);
        across.append(tick);
      }
    }
  }

  for (const one of panels) {
    const { plot, output, lines, x, y } = one;
    one.view = [0, WIDE];
    const share = event => {
      const box = plot.getBoundingClientRect();
      return Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    };
    const place = event => one.view[0] + share(event) * (one.view[1] - one.view[0]);
    plot.addEventListener("pointerdown", event => {
      start = share(event);
      plot.setPointerCapture(event.pointerId);
      plot.append(shade);
      shade.style.width = "0";
    });
    plot.addEventListener("pointermove", event => {
      const here = place(event), range = x[1] - x[0];
      const found = lines.map(line => {
        const near = points(line).reduce((best, each) =>
          Math.abs(each[0] - here) < Math.abs(best[0] - here) ? each : best, [Infinity, 0]);
        if (Math.abs(near[0] - here) > 0.01 * (one.view[1] - one.view[0])) return "";
        const value = y[1] + (y[0] - y[1]) * near[1] / HIGH;
        return `${line.querySelector("title").textContent} ${text(value, Math.abs(y[1] - y[0]) / 100)}`;
      });
      output.textContent = [text(x[0] + range * here / WIDE, range / 100), ...found].filter(Boolean).join(" · ");
      if (start !== null) {
        const ends = [start, share(event)].sort((a, b) => a - b);
        shade.style.left = `${100 * ends[0]}%`;
        shade.style.width = `${100 * (ends[1] - ends[0])}%`;
      }
    });
    plot.addEventListener("pointerup", event => {
      if (start !== null) {
        const [a, b] = [start, share(event)].sort((p, q) => p - q), [left, right] = one.view;
        const time = part => x[0] + (x[1] - x[0]) * (left + part * (right - left)) / WIDE;
        if (b - a > 0.02 && (right - left) * (b - a) > WIDE / 1000) show([time(a), time(b)]);
      }
      start = null;
      shade.remove();
    });
    plot.addEventListener("pointercancel", () => { start = null; shade.remove(); });
    plot.addEventListener("pointerleave", () => { output.textContent = ""; });
    plot.addEventListener("dblclick", () => show(null));
  }
}

const times = Map.groupBy(document.querySelectorAll("figure[data-zoom]"), figure => figure.dataset.zoom);
times.forEach(setUp);

// A print shows what is folded, and folds it again.
const folds = () => document.querySelectorAll("details");
addEventListener("beforeprint", () => folds().forEach(each => { each.was = each.open; each.open = true; }));
addEventListener("afterprint", () => folds().forEach(each => { each.open = each.was; }));
