"""What a closed pose costs, and how many a browser shows while a slider is dragged.

    python benchmarks/viewer.py [ROBOT...]

Needs Chromium or Chrome on the PATH, viser and playwright.
"""

import shutil
import sys
import time
import warnings
from typing import Any

import numpy as np

import loopid
from loopid.view.scene import Pose
from loopid.view.viewer import BROWSERS, Viewer

SECONDS, STEPS = 5.0, 12  # of a drag, and its moves by two pixels to one side
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
FRAMES = (
    "() => { window.frames_ = 0; const f = () => { frames_++; requestAnimationFrame(f); }; f() }"
)


class Counting(Viewer):
    """A viewer that keeps the residual of each pose it shows."""

    residuals: list[float]

    def _place(self, pose: Pose, said: str = "") -> None:
        super()._place(pose, said)
        self.__dict__.setdefault("residuals", []).append(pose.residual)


def drag(viewer: Any, page: Any) -> tuple[float, float, float]:
    """Poses and frames of the browser a second, and the largest residual in m."""
    page.goto(viewer.url)
    slider = page.get_by_role("slider").first
    slider.wait_for()
    page.wait_for_timeout(3000)  # for all parts to be there
    page.evaluate(FRAMES)
    box = slider.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    viewer.residuals.clear()
    start, first = time.perf_counter(), page.evaluate("frames_")
    while time.perf_counter() - start < SECONDS:
        for k in (*range(STEPS), *range(STEPS, -STEPS, -1), *range(-STEPS, 0)):
            page.mouse.move(x + 2 * k, y)
            if time.perf_counter() - start > SECONDS:
                break
    took, frames = time.perf_counter() - start, page.evaluate("frames_") - first
    page.mouse.up()
    return len(viewer.residuals) / took, frames / took, max(viewer.residuals)


def cost(viewer: Any) -> float:
    """Processor time in s of a pose, from a slider to what is sent to the browser."""
    middle, count = viewer.scene.at(viewer.scene.mechanism.reference).values, 100
    start = time.process_time()
    for k in range(count):
        viewer.move(middle + np.eye(len(middle))[0] * 0.02 * np.sin(k / 10))
    return (time.process_time() - start) / count


def main() -> None:
    """Print a line a robot."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, BROWSERS)))
    print(f"{'robot':20} {'ms a pose':>9} {'poses/s':>8} {'frames/s':>9} {'closed to (m)':>14}")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=OPTIONS)
        for name in sys.argv[1:] or ("3ups_rpu", "delta"):
            with warnings.catch_warnings(action="ignore"):
                robot = loopid.load_mechanism(name)
            with Counting(robot) as viewer:
                own = 1e3 * cost(viewer)
                page = browser.new_page(viewport={"width": 480, "height": 320})
                page.set_default_timeout(120e3)
                poses, frames, residual = drag(viewer, page)
                page.close()
            print(f"{robot.name:20} {own:9.1f} {poses:8.1f} {frames:9.1f} {residual:14.0e}")
        browser.close()


if __name__ == "__main__":
    main()
