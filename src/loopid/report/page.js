"use strict";
// Charts: the values under the pointer; a span that is dragged along x is zoomed to, in all panels
// of its figure, and a double click shows all again. Positions are in the square of chart.py.
const WIDE = 20000, HIGH = 2000;

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

function setUp(figure) {
  const panels = [...figure.querySelectorAll(".panel")].map(panel => ({
    panel,
    svg: panel.querySelector("svg"),
    plot: panel.querySelector(".plot"),
    across: panel.querySelector(".across"),
    output: panel.querySelector("output"),
    lines: [...panel.querySelectorAll("path.line")].filter(path => path.querySelector("title")),
    x: panel.dataset.x.split(" ").map(Number),
    y: panel.dataset.y.split(" ").map(Number),
  }));
  let view = [0, WIDE], start = null;
  const shade = document.createElement("div");
  shade.className = "drag";

  function show([a, b]) {
    view = [a, b];
    for (const { svg, across, x } of panels) {
      svg.setAttribute("viewBox", `${a} 0 ${b - a} ${HIGH}`);
      const at = place => x[0] + (x[1] - x[0]) * place / WIDE, low = at(a), high = at(b);
      const power = 10 ** Math.floor(Math.log10((high - low) / 5));
      const step = power * [1, 2, 5, 10].find(k => (high - low) / (k * power) <= 6);
      across.replaceChildren();
      for (let k = Math.ceil(low / step); k * step <= high; k++) {
        const tick = document.createElement("span");
        tick.style.left = `${100 * (k * step - low) / (high - low)}%`;
        tick.textContent = text(k * step, step);
        across.append(tick);
      }
    }
  }

  for (const { plot, output, lines, x, y } of panels) {
    const share = event => {
      const box = plot.getBoundingClientRect();
      return Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    };
    const place = event => view[0] + share(event) * (view[1] - view[0]);
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
        if (Math.abs(near[0] - here) > 0.01 * (view[1] - view[0])) return "";
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
        const [a, b] = [start, share(event)].sort((p, q) => p - q), width = view[1] - view[0];
        if (b - a > 0.02 && width * (b - a) > WIDE / 1000) show([view[0] + a * width, view[0] + b * width]);
      }
      start = null;
      shade.remove();
    });
    plot.addEventListener("pointercancel", () => { start = null; shade.remove(); });
    plot.addEventListener("pointerleave", () => { output.textContent = ""; });
    plot.addEventListener("dblclick", () => show([0, WIDE]));
  }
}

document.querySelectorAll("figure.zoom").forEach(setUp);

// A print shows all tables.
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(each => { each.open = true; }));
