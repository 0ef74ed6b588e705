"""What a closed pose costs, and how many a browser shows while a slider is dragged.

    python benchmarks/viewer.py [--json FILE] [ROBOT ...]

Needs Chromium or Chrome on the PATH, viser and playwright.
"""

import argparse
import shutil
import time
import warnings
from typing import Any

import numpy as np

import loopid
from loopid.view.scene import ScenePose
from loopid.view.viewer import BROWSERS, Viewer
from tables import show, write_json

WARM, SECONDS = 10.0, 5.0  # of a drag while shaders are compiled, and of what is counted
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# Frames, and those of them in which the browser got another pose to draw: a texture of places.
COUNT = """
window.frames_ = window.seen_ = 0;
let told = false;
for (const name of ["texSubImage2D", "texImage2D"]) {
  const own = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    told = true;
    return own.apply(this, given);
  };
}
const frame = () => {
  frames_ += 1;
  seen_ += told;
  told = false;
  requestAnimationFrame(frame);
};
requestAnimationFrame(frame);
"""
# A hand that moves 60 times a second, by 24 pixels to either side.
HAND = """([x, y]) => {
  let k = 0;
  setInterval(() => {
    const clientX = x + 24 * Math.sin(++k / 10), at = {clientX, clientY: y, bubbles: true};
    document.dispatchEvent(new MouseEvent("mousemove", at));
  }, 16);
}"""


class Counting(Viewer):
    """A viewer that keeps the residual of each pose it shows."""

    residuals: list[float]

    def _place(self, pose: ScenePose, *more: Any) -> None:
        super()._place(pose, *more)
        self.__dict__.setdefault("residuals", []).append(pose.residual)


def drag(viewer: Any, page: Any) -> tuple[float, float, float, float]:
    """Poses that are sent, seen, and frames a second, and the largest residual in m."""
    page.goto(viewer.url)
    slider = page.get_by_role("slider").first
    slider.wait_for()
    page.wait_for_timeout(5000)  # for all parts to be there
    box = slider.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate(HAND, [x, y])
    page.wait_for_timeout(1e3 * WARM)
    start, first = time.perf_counter(), page.evaluate("[seen_, frames_]")
    viewer.residuals.clear()
    time.sleep(SECONDS)
    sent, seen = len(viewer.residuals), np.subtract(page.evaluate("[seen_, frames_]"), first)
    took = time.perf_counter() - start
    return sent / took, *(seen / took), max(viewer.residuals)


def cost(viewer: Any) -> float:
    """Processor time in s of a pose, from a slider to what is sent to the browser."""
    middle, count = viewer.scene.at(viewer.scene.robot.reference).values, 100
    start = time.process_time()
    for k in range(count):
        viewer.move(middle + np.eye(len(middle))[0] * 0.02 * np.sin(k / 10))
    return (time.process_time() - start) / count


def main() -> None:
    """Print a line a robot."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("robots", nargs="*", default=["3ups_rpu", "delta"])
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    from playwright.sync_api import sync_playwright

    rows: list[dict[str, Any]] = []
    program = next(filter(None, map(shutil.which, BROWSERS)))
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=OPTIONS)
        for name in arguments.robots:
            with warnings.catch_warnings(action="ignore"):
                robot = loopid.load(name)
            with Counting(robot) as viewer:
                own = 1e3 * cost(viewer)
                page = browser.new_page(viewport={"width": 480, "height": 320})
                page.set_default_timeout(120e3)
                page.add_init_script(COUNT)
                sent, seen, frames, off = drag(viewer, page)
                page.close()
            sizes = {"ms a pose": own, "poses/s sent": sent, "seen": seen, "frames/s": frames}
            rows.append({"robot": robot.name, **sizes, "closed to (m)": float(off)})
        browser.close()
    show("poses of sliders in the viewer", rows)
    if arguments.json:
        write_json(arguments.json, {"poses": rows})


if __name__ == "__main__":
    main()
