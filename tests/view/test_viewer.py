"""The viewer without a browser, and in one where it is installed."""

import base64
import gc
import importlib
import io
import shutil
import socket
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid.errors import DataError, MissingExtraError, OptionError

viser = pytest.importorskip("viser")
msgspec = pytest.importorskip("msgspec")
from loopid.view import open_viewer  # noqa: E402
from loopid.view.viewer import BROWSERS, CLOSED, OPEN, Viewer  # noqa: E402

LOG = Path(__file__).parents[2] / "urdf" / "logs" / "five_bar.csv"
PROGRAM = next(filter(None, map(shutil.which, BROWSERS)), None)
IN_A_BROWSER = pytest.mark.skipif(PROGRAM is None, reason=f"needs one of {', '.join(BROWSERS)}")
WAIT = 60e3  # ms, on a busy machine
TRIES = 100
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def five_bar(load_once):
    return load_once("five_bar")


@pytest.fixture(scope="module")
def fit_file(five_bar, tmp_path_factory):
    with warnings.catch_warnings(action="ignore"):
        model = loopid.force_model(five_bar, "full")
        recording = loopid.prepare(five_bar, loopid.read_log(LOG, five_bar))
        found = loopid.identify(model, [recording])
    return found.fit.save(tmp_path_factory.mktemp("fit") / "fit.yaml")


def test_files_of_all_kinds_are_known(five_bar, fit_file):
    with open_viewer(five_bar, [LOG, fit_file]) as viewer:
        assert len(viewer.motion) > 100
        np.testing.assert_array_equal(viewer.pose.configuration, viewer.motion.configurations[0])
    with open_viewer(five_bar, ["five_bar"]) as viewer:
        assert viewer.motion is not None
    with pytest.raises(OptionError):
        open_viewer(five_bar, [LOG, "five_bar"])


def test_the_fit_of_another_robot_is_refused(load_once, fit_file):
    with pytest.raises(DataError):
        open_viewer(load_once("four_bar"), [fit_file])


def test_only_this_machine_is_served_and_a_taken_port_is_no_problem(five_bar):
    with Viewer(five_bar, port=8137) as first, Viewer(five_bar, port=8137) as second:
        assert first.url != second.url
        assert all(viewer.url.startswith("http://127.0.0.1:") for viewer in (first, second))


@pytest.mark.parametrize("port", [-1, 0, 80, 65_536])
def test_a_port_that_cannot_be_had_is_refused(five_bar, port):
    with pytest.raises(OptionError, match=r"port must be .* or (more|less), not"):
        open_viewer(five_bar, port=port)


def test_without_viser_or_a_browser_one_sentence_says_what_to_install(five_bar, monkeypatch):
    with Viewer(five_bar) as viewer, monkeypatch.context() as patch:
        patch.setenv("PATH", "/nowhere")
        with pytest.raises(OptionError, match="install"):
            next(viewer.pictures())
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.delitem(sys.modules, "loopid.view.viewer")
    with pytest.raises(MissingExtraError):
        importlib.import_module("loopid.view.viewer")


def coloured(image, colour):
    """Pixels of a hue, however bright or faint it is drawn."""
    pixels = image.reshape(-1, 3) - image.min(axis=2).reshape(-1, 1)
    hue = np.array(colour, float) - min(colour)
    size = np.linalg.norm(pixels, axis=1)
    return int((pixels @ hue / np.maximum(size, 40) / np.linalg.norm(hue) > 0.97).sum())


@IN_A_BROWSER
@pytest.mark.validate
def test_pictures_show_the_poses_and_whether_loops_are_closed(five_bar):
    from PIL import Image

    motion = loopid.motion.joint_motion(
        five_bar, loopid.motion.read_motion_program("five_bar").motion(rate=5.0)
    )
    with Viewer(five_bar, motion=motion) as viewer:
        closed, later, _ = (
            np.array(Image.open(io.BytesIO(png)), float)
            for png in viewer.pictures(3, height=300, width=400)
        )
    broken = motion.configurations[0].copy()
    broken[five_bar.joint("left_crank_joint").idx_q] += 0.3
    with Viewer(five_bar) as viewer:
        viewer.show(broken)
        (png,) = viewer.pictures(height=300, width=400)
        opened = np.array(Image.open(io.BytesIO(png)), float)
    assert closed.shape == (300, 400, 3)
    assert np.abs(closed - later).max() > 50  # it moves
    assert coloured(closed, CLOSED) > 100 > 10 > coloured(closed, OPEN)
    assert coloured(opened, OPEN) > 50


@IN_A_BROWSER
def test_a_hand_on_a_slider_moves_whole_loops_and_nothing_leaves_the_machine(five_bar, fit_file):
    pytest.importorskip("playwright")
    from playwright.sync_api import sync_playwright

    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with open_viewer(five_bar, [LOG, fit_file]) as viewer, sync_playwright() as play:
        browser = play.chromium.launch(executable_path=PROGRAM, args=options)
        page = browser.new_page(viewport={"width": 900, "height": 600})
        page.set_default_timeout(WAIT)
        asked, said = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(viewer.url)
        slider = page.get_by_role("slider").first
        slider.wait_for()
        before = viewer.pose
        for _ in range(TRIES):  # the page still moves its parts while it loads
            box = slider.bounding_box()
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + 5, y, steps=5)
            page.mouse.up()
            page.wait_for_timeout(300)
            if viewer.pose.values[0] != before.values[0]:
                break
        after = viewer.pose
        page.get_by_label("Play").check()
        for _ in range(TRIES):
            page.wait_for_timeout(100)
            if (viewer.pose.values != after.values).all():
                break
        played = viewer.pose
        browser.close()
    assert after.values[0] != before.values[0]
    assert after.values[1] == pytest.approx(before.values[1])
    assert np.abs(after.origins - before.origins).max(axis=1).min() == 0.0  # the fixed frame
    assert (np.abs(after.closures - before.closures) > 1e-4).any()
    assert max(after.residual, played.residual) <= 1e-9
    assert (played.values != after.values).all()
    assert said == []
    assert all(url.startswith((viewer.url, "data:", "blob:")) for url in asked)


class RawClient:
    """A WebSocket without a browser."""

    def __init__(self, viewer, *headers, version=viser.__version__):
        self.port = int(viewer.url.rpartition(":")[2])
        self.socket = socket.create_connection(("127.0.0.1", self.port), timeout=10)
        lines = ["GET / HTTP/1.1", *headers, f"Sec-WebSocket-Protocol: viser-v{version}"]
        if any(line.startswith("Upgrade") for line in headers):
            key = base64.b64encode(bytes(16)).decode()
            lines += [
                "Connection: Upgrade",
                f"Sec-WebSocket-Key: {key}",
                "Sec-WebSocket-Version: 13",
            ]
        self.socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        self.status = self.socket.recv(4096).split(b"\r\n")[0].decode()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def send(self, content, code=2):
        """One masked frame: 1 is text, 2 bytes."""
        size = len(content)
        length = bytes([128 | size]) if size < 126 else bytes([254]) + size.to_bytes(2, "big")
        self.socket.sendall(bytes([128 | code]) + length + bytes(4) + content)


UPGRADE = "Upgrade: websocket"
CAMERA = {"type": "ViewerCameraMessage", "wxyz": [1.0, 0, 0, 0], "position": [1.0, 1, 1],
          "fov": 0.8, "near": 0.1, "far": 10.0, "image_height": 9, "image_width": 9,
          "look_at": [0.0, 0, 0], "up_direction": [0.0, 0, 1]}  # fmt: skip


@pytest.mark.parametrize(
    ("host", "origin", "allowed"),
    [
        ("127.0.0.1:{}", "http://127.0.0.1:{}", True),
        ("localhost:{}", "http://localhost:{}", True),
        ("127.0.0.1:{}", "http://evil.example", False),
        ("evil.example", "http://evil.example", False),
        ("evil.example:{}", "http://127.0.0.1:{}", False),
        ("127.0.0.1:{}", "http://127.0.0.1", False),
        ("127.0.0.1:{}", "http://127.0.0.1:{}.evil.example", False),
        ("127.0.0.1:{}", "null", False),
        ("127.0.0.1:{}", None, False),
    ],
)
def test_only_the_viewers_own_page_gets_the_scene(five_bar, host, origin, allowed):
    with Viewer(five_bar) as viewer:
        port = viewer.url.rpartition(":")[2]
        headers = [f"Host: {host.format(port)}", UPGRADE]
        headers += [] if origin is None else [f"Origin: {origin.format(port)}"]
        with RawClient(viewer, *headers) as client:
            assert client.status.split()[1] == ("101" if allowed else "403")
            got = b"" if not allowed else client.socket.recv(2**16)
        assert bool(got) == allowed
        with RawClient(viewer, f"Host: {host.format(port)}") as page:
            assert ("200" in page.status) == (host in ("127.0.0.1:{}", "localhost:{}"))


def test_malformed_messages_are_dropped_and_the_next_one_is_heard(five_bar, capfd, caplog):
    with Viewer(five_bar) as viewer:
        port, (first, *_) = viewer.url.rpartition(":")[2], viewer._sliders
        start, uuid = first.value, first._impl.uuid

        def update(value, **more):
            content = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
            return msgspec.msgpack.encode(content | more)

        own = [f"Host: 127.0.0.1:{port}", f"Origin: http://127.0.0.1:{port}", UPGRADE]
        with RawClient(viewer, *own) as client:
            client.send(b"text", code=1)
            client.send(msgspec.msgpack.encode(CAMERA))  # viser hears who has one
            bad = [b"", b"\xff" * 9, msgspec.msgpack.encode({"type": "Unknown"}), b"\x93\1\2\3",
                   msgspec.msgpack.encode({"type": "GuiUpdateMessage"}), update("far"),
                   update(float("nan")), update([1, 2]), update(0.0, uuid="gone"),
                   update(0.0, updates={"colour": 3}), update(0.0, updates=7)]  # fmt: skip
            for content in bad:
                client.send(content)
            client.send(update(start + 0.05))
            for _ in range(TRIES):
                if abs(viewer.pose.values[0] - start - 0.05) < 1e-3:
                    break
                time.sleep(0.05)
        assert viewer.pose.values[0] == pytest.approx(start + 0.05, abs=1e-3)
    gc.collect()
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
    assert not [record for record in caplog.records if record.exc_info]
