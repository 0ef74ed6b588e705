"""A scene in a browser, by viser: sliders that move whole loops, playback, pictures."""

from __future__ import annotations

import io
import logging
import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from loopid.arguments import FloatArray, checked, spread_rows
from loopid.errors import OptionError, optional
from loopid.identification.result import Fit, fit_file, load_fit
from loopid.logs.mapping import LogMapping
from loopid.logs.preparing import prepare
from loopid.logs.reading import read_log
from loopid.motion.files import read_motion_program
from loopid.motion.joints import JointMotion, joint_motion
from loopid.robot.robot import Robot
from loopid.view.masses import BodyMass, body_masses, fitted_masses
from loopid.view.scene import Scene, ScenePose

with optional("viser", "view"):
    import viser
    from trimesh import creation

    from loopid.view.solids import read_solids

# Of the user, with some above to go on to: the server waits for ever for one that cannot be had.
Port: TypeAlias = Annotated[int, Field(ge=1024, le=65_000)]
RATE = 25.0  # poses a second of a playback
STEPS, PAUSE = 2, 0.02  # to where a slider is, as browsers send it every 50 ms; s between them
STOPPED = "stopped by a singularity or the end of reach, "
BROWSERS = "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"
HEADLESS = ["headless=new", "use-angle=swiftshader", "enable-unsafe-swiftshader", "no-first-run"]
PATIENCE = 60.0  # s for a browser to start, or to draw
THICKNESS = 0.012  # radius of a rod, of the robot's characteristic length
BEHIND = np.array([1.0, -1.3, 0.8])  # from where one looks
FIELD = 0.8  # rad, the height of what one sees
ROD, OPEN, CLOSED = (120, 144, 156), (213, 94, 0), (0, 158, 115)
MOTOR, PASSIVE = (30, 36, 42), (250, 250, 250)
BALL, CUBE = creation.icosphere(1), creation.box()
LEGEND = (
    "Dark cubes: motors. White balls: passive joints. Green: loops that are closed; orange: open."
)
MASSES = (0, 114, 178), (230, 159, 0), (204, 121, 167), (86, 180, 233)  # of the file, then fits


@checked
class Viewer:
    """A robot in a browser, at ``url`` of this machine alone; a context manager.

    Parameters
    ----------
    robot : Robot
    motion : JointMotion, optional
        What can be played.
    fits : mapping
        Saved fits by the names that are shown, whose masses stand beside those of the robot file.
    port : int
        From 1024 to 65,000; the next free one where it is taken.

    Attributes
    ----------
    scene : Scene
    pose : ScenePose
        What is shown.

    Raises
    ------
    MissingExtraError
        When viser is not installed.

    Examples
    --------
    >>> import loopid
    >>> with loopid.view.Viewer(loopid.load("five_bar")) as viewer:
    ...     viewer.move([1.2, 1.9])
    True
    """

    def __init__(
        self,
        robot: Robot,
        *,
        motion: JointMotion | None = None,
        fits: Mapping[str, Fit] | None = None,
        port: Port = 8080,
    ) -> None:
        masses = {"robot file": body_masses(robot)}
        masses |= {name: fitted_masses(robot, fit) for name, fit in (fits or {}).items()}
        self.scene, self.motion = Scene(robot), motion
        self._lock, self._closed = threading.RLock(), threading.Event()
        self.pose = self.scene.at(robot.reference)
        logging.getLogger("websockets.server").addFilter(_is_news)
        with redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer("127.0.0.1", port, label=robot.name, verbose=False)
        self.url = f"http://127.0.0.1:{self._server.get_port()}"
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._draw()
        self._add_controls()
        self._add_masses(masses)
        if motion is not None:
            self._add_playback(motion)
        self.show(robot.reference if motion is None else motion.configurations[0])

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop serving."""
        self._closed.set()
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def wait(self) -> None:
        """Serve until the program is interrupted."""
        with suppress(KeyboardInterrupt):
            self._closed.wait()

    def show(self, configuration: FloatArray) -> None:
        """Show the robot at a configuration (nq,), closed or not."""
        self._place(self.scene.at(configuration))

    def move(self, values: FloatArray) -> bool:
        """Move the sliders to values in m or rad, as far as they get, and say if all the way."""
        with self._lock:
            pose, arrived = self.scene.moved(self.pose, values)
            self._place(pose, "" if arrived else STOPPED)
        return arrived

    def pictures(self, count: int = 1, height: int = 480, width: int = 640) -> Iterator[bytes]:
        """PNG pictures of evenly spread poses of the motion, or of the pose that is shown.

        Raises
        ------
        OptionError
            When no browser is installed, or it does not start.
        """
        import imageio.v3 as iio

        poses = [self.pose.configuration] if self.motion is None else self.motion.configurations
        x, y = np.cross(self._towards, (0, 0, 1)), -self._towards
        x /= np.linalg.norm(x)
        view = Rotation.from_matrix(np.stack([x, np.cross(-y, x), -y], 1)).as_quat(
            scalar_first=True
        )
        with self._browser(f"window-size={width},{height}") as client:
            for k in spread_rows(len(poses), count):
                self.show(poses[k])
                image = client.get_render(
                    height, width, wxyz=view, position=self._eye, fov=FIELD, timeout=PATIENCE
                )
                yield iio.imwrite("<bytes>", image, extension=".png")

    @contextmanager
    def _browser(self, *options: str) -> Iterator[Any]:
        """A browser without a window that looks at the scene, as viser's client."""
        program = next(filter(None, map(shutil.which, BROWSERS)), None)
        if program is None:
            raise OptionError(
                f"pictures need a browser, and none of {', '.join(BROWSERS)} is on the PATH: "
                "install Chromium or Chrome"
            )
        known, clients = set(self._server.get_clients()), self._server.get_clients
        root = ["no-sandbox"] if getattr(os, "geteuid", int)() == 0 else []  # else it refuses
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            words = [*HEADLESS, *root, *options, f"user-data-dir={profile}"]
            command = [program, *(f"--{word}" for word in words), self.url]
            own = os.environ | {"TMPDIR": profile}  # where it leaves files behind
            process = subprocess.Popen(command, stderr=subprocess.DEVNULL, env=own)
            try:
                end = time.monotonic() + PATIENCE
                while not (new := set(clients()) - known):
                    if process.poll() is not None or time.monotonic() > end:
                        raise OptionError(f"the browser {program} did not open {self.url}")
                    time.sleep(0.05)
                yield clients()[new.pop()]
            finally:
                process.terminate()
                process.wait()

    def _draw(self) -> None:
        """Everything that a pose places."""
        pose, draw, thick = self.pose, self._server.scene, THICKNESS * self.scene.robot.length
        # Without a graphics card, each light, mirrored surroundings and shadows take long.
        draw.configure_default_lights(False)
        draw.configure_environment_map(None)
        draw.add_light_ambient("/light", intensity=1.5)
        draw.add_light_directional("/sun", intensity=2.5, position=tuple(BEHIND))
        solids = read_solids(self.scene.robot)
        self._solids = [
            (joint, draw.add_mesh_simple(f"/solids/{k}", mesh.vertices, mesh.faces, color=color,
                                         flat_shading=True))
            for k, (joint, color, mesh) in enumerate(solids)
        ]  # fmt: skip
        rods, cuts = np.ones((len(pose.rods), 3)), np.ones((2 * len(pose.closures), 3))
        self._rods = self._batch("/rods", creation.cylinder(1.0, 1.0, sections=12), rods, ROD)
        self._ends = self._batch("/ends", BALL, thick * np.tile(rods, (2, 1)), ROD)
        self._cuts = self._batch("/cuts", BALL, 2.6 * thick * cuts, CLOSED)
        robot, sizes = self.scene.robot, thick * np.ones((len(pose.joints), 3))
        motors = np.isin(robot.joints, robot.actuated)
        self._joints = [
            (rows, self._batch(f"/{name}", shape, size * sizes[rows], color))
            for name, rows, shape, size, color in (
                ("motors", motors, CUBE, 7.0, MOTOR),
                ("passive", ~motors, BALL, 2.2, PASSIVE),
            )
        ]
        names = [closure.name for closure in self.scene.robot.closures]
        self._labels = [
            draw.add_label(f"/labels/{k}", n, visible=False) for k, n in enumerate(names)
        ]
        corners = (mesh.vertices @ pose.rotations[k].T + pose.origins[k] for k, _, mesh in solids)
        points = np.concatenate([pose.origins[1:], *pose.rods, *pose.closures, *corners])
        low, high = points.min(axis=0), points.max(axis=0)
        reach = float(np.linalg.norm(high - low)) or 1.0
        middle, self._towards = (low + high) / 2, -BEHIND / np.linalg.norm(BEHIND)
        self._eye = middle - 1.4 * reach * self._towards
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = self._eye, middle, FIELD
        floor = (*middle[:2], low[2] - 0.05 * reach)
        draw.add_grid("/grid", 2 * reach, 2 * reach, position=floor, cell_size=reach / 10)

    def _batch(self, name: str, shape: Any, sizes: FloatArray, color: Any, **look: Any) -> Any:
        """Many of one shape, with their sizes (N, 3)."""
        turns, colors = (np.tile(each, (len(sizes), 1)) for each in ((1.0, 0.0, 0.0, 0.0), color))
        return self._server.scene.add_batched_meshes_simple(
            name, shape.vertices, shape.faces, turns, np.zeros((len(sizes), 3)),
            batched_scales=sizes, batched_colors=colors, cast_shadow=False, receive_shadow=False,
            **look,
        )  # fmt: skip

    def _place(self, pose: ScenePose, said: str = "", dragged: Any = None) -> None:
        """Put everything where a pose has it, and say how the pose is.

        What a browser receives at each pose costs it more than the pose itself. Nothing is placed
        that is not shown.
        """
        with self._lock, self._server.atomic():
            self.pose = pose
            turns = _turn(pose.rotations).as_quat(scalar_first=True)
            for joint, solid in self._solids:
                solid.position, solid.wxyz = pose.origins[joint], turns[joint]
            way = pose.rods[:, 1] - pose.rods[:, 0]
            lengths = np.linalg.norm(way, axis=1, keepdims=True)
            thick = np.full((len(way), 2), THICKNESS * self.scene.robot.length)
            self._rods.batched_positions = pose.rods.mean(axis=1)
            self._rods.batched_wxyzs = _turns_of_z(way / np.maximum(lengths, 1e-12))
            self._rods.batched_scales = np.hstack([thick, lengths])
            self._ends.batched_positions = pose.rods.reshape(-1, 3)
            self._cuts.batched_positions = pose.closures.reshape(-1, 3)
            for rows, batch in self._joints:
                batch.batched_positions = pose.joints[rows]
            colours = np.where(pose.open_by[:, None] <= self.scene.closed, CLOSED, OPEN)
            self._cuts.batched_colors = np.repeat(colours, 2, axis=0)
            for box, bodies, batch in self._masses:
                batch.visible = box.value
                if box.value:
                    joints = [body.joint for body in bodies]
                    R, centres = pose.rotations[joints], np.array([b.centre for b in bodies])
                    away = np.einsum("nij,nj->ni", R, centres)
                    batch.batched_positions = pose.origins[joints] + away
                    axes = _turn(R @ np.array([body.axes for body in bodies]))
                    batch.batched_wxyzs = axes.as_quat(scalar_first=True)
            closures = zip(self._labels, self.scene.robot.closures, strict=True)
            for k, (label, closure) in enumerate(closures):
                label.visible = self._named.value
                if self._named.value:
                    label.position = pose.closures[k].mean(axis=0)
                    label.text = f"{closure.name}: {pose.open_by[k]:.1e} m"
            for slider, value in zip(self._sliders, pose.values, strict=True):
                if slider is not dragged:
                    slider.value = float(np.clip(value, slider.min, slider.max))
            kept = "closed to" if pose.residual <= self.scene.closed else "open by"
            self._state.value = f"{said}{kept} {pose.residual:.0e} m"
            self._singularity.value = f"{pose.singularity:.2g}"

    def _add_controls(self) -> None:
        gui, robot = self._server.gui, self.scene.robot
        gui.add_markdown(LEGEND)
        self._state = gui.add_text("loops", "", disabled=True)
        hint = "0 where the motors lose control of the motion"
        self._singularity = gui.add_text("singularity measure", "", disabled=True, hint=hint)
        self._sliders: list[Any] = []
        for each, value in zip(self.scene.sliders, self.pose.values, strict=True):
            label, step = f"{each.joint} ({each.unit})", (each.high - each.low) / 1000 or 1e-3
            slider = gui.add_slider(label, each.low, each.high, step, float(value))
            slider.on_update(self._dragged)
            self._sliders.append(slider)
        gui.add_button("Reference").on_click(lambda _: self.show(robot.reference))
        self._named = gui.add_checkbox("Closures by name", False, visible=bool(self._labels))
        self._named.on_update(lambda _: self._place(self.pose))
        if robot.rows:
            find = gui.add_button("Find assembly modes")
            find.on_click(lambda _: self._add_modes(find))

    def _dragged(self, event: Any) -> None:
        """Follow a slider that a person drags to where it is now: old events are passed over."""
        # Set by ``_place``, or by who is no browser.
        if event.client is None or not np.isfinite(event.target.value):
            return
        with self._lock:
            goal, slider = self.pose.values.copy(), event.target
            k = self._sliders.index(slider)
            goal[k] = slider.value
            for left in range(STEPS if goal[k] != self.pose.values[k] else 0, 0, -1):
                pose, arrived = self.scene.moved(self.pose, goal, part=1 / left)
                self._place(pose, "" if arrived else STOPPED, slider if arrived else None)
                if not arrived:
                    break
                self._closed.wait(PAUSE if left > 1 else 0)

    def _add_modes(self, button: Any) -> None:
        button.disabled = True
        modes = self.scene.modes()
        names = ["reference", *(f"mode {k}" for k in range(1, len(modes)))]
        choice = self._server.gui.add_dropdown("assembly mode", names)
        choice.on_update(lambda _: self.show(modes[names.index(choice.value)]))

    def _add_masses(self, masses: Mapping[str, Sequence[BodyMass]]) -> None:
        """Centres of mass and ellipsoids of inertia, by what says so."""
        size, self._masses = 1.5 * THICKNESS * self.scene.robot.length, list[Any]()
        for n, (name, bodies) in enumerate(masses.items()):
            box = self._server.gui.add_checkbox(f"masses of {name}", len(masses) > 1)
            box.on_update(lambda _: self._place(self.pose))
            solid = [body for body in bodies if body.radii.all()]
            radii, look = np.array([body.radii for body in solid]), MASSES[n % len(MASSES)]
            centres = self._batch(f"/masses/{n}", BALL, np.full((len(bodies), 3), size), look)
            self._masses.append((box, bodies, centres))
            if solid:
                inertias = self._batch(f"/inertias/{n}", BALL, radii, look, opacity=0.35)
                self._masses.append((box, solid, inertias))

    def _add_playback(self, motion: JointMotion) -> None:
        first, last = float(motion.time[0]), float(motion.time[-1])
        play = self._server.gui.add_checkbox("Play", False)
        clock = self._server.gui.add_slider("time (s)", first, last, 1e-3, first)

        def show(_: Any) -> None:
            row = int(np.searchsorted(motion.time, clock.value))
            self.show(motion.configurations[min(row, len(motion) - 1)])

        def run(_: Any) -> None:
            while play.value and not self._closed.wait(1 / RATE):
                clock.value = first if clock.value >= last else min(clock.value + 1 / RATE, last)

        clock.on_update(show)
        play.on_update(run)


def _is_news(record: logging.LogRecord) -> bool:
    """Browsers open connections that they do not use, and others are refused."""
    said = record.getMessage()
    return said != "opening handshake failed" and not said.startswith("connection rejected")


def _turn(rotations: FloatArray) -> Rotation:
    """Rotation matrices as what SciPy turns by; older ones read no arrays that are protected."""
    return Rotation.from_matrix(np.array(rotations))


def _turns_of_z(directions: FloatArray) -> FloatArray:
    """Quaternions (R, 4) that turn z into directions (R, 3)."""
    x, y, z = directions.T
    turns = np.stack([1 + z, -y, x, np.zeros_like(x)], axis=1)
    turns[z < -1 + 1e-9] = 0.0, 1.0, 0.0, 0.0
    return np.asarray(turns / np.linalg.norm(turns, axis=1, keepdims=True))


@checked
def open_viewer(
    robot: Robot,
    files: Sequence[str | Path] = (),
    *,
    mapping: LogMapping | str | Path | None = None,
    port: Port = 8080,
) -> Viewer:
    """Show a robot with a log or a motion, which can be played, and with saved fits.

    Parameters
    ----------
    robot : Robot
    files : sequence of path
        Saved fits or their folders, and a log or a motion file, whose first motion is meant, or a
        bundled robot's name for its motion.
    mapping : LogMapping or path, optional
        Which columns of a log are what; see ``read_log``.
    port : int
        See ``Viewer``.

    Returns
    -------
    Viewer

    Examples
    --------
    >>> import loopid
    >>> with loopid.view.open_viewer(loopid.load("five_bar"), ["five_bar"]) as viewer:
    ...     viewer.motion is not None
    True
    """
    motions, fits = dict[str, JointMotion](), dict[str, Fit]()
    for path in map(str, files):
        saved = fit_file(path)  # a folder may be one of a log, too
        place = saved if saved.exists() else Path(path)
        text = place.suffix in (".yaml", ".yml", ".json")
        if text and "loopid fit" in place.read_text(errors="replace")[:200]:
            fits[path] = load_fit(path, robot=robot)
        elif text or not place.exists():
            planned = read_motion_program(path).motion(rate=RATE)
            motions[path] = joint_motion(robot, planned)
        else:
            motions[path] = prepare(robot, read_log(path, robot, mapping=mapping)).motion
    if len(motions) > 1:
        raise OptionError(f"only one log or motion can be played, not {', '.join(motions)}")
    return Viewer(robot, motion=next(iter(motions.values()), None), fits=fits, port=port)
