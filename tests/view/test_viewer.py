"""The viewer without a browser, and in one where it is installed."""

import importlib
import io
import shutil
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid.errors import DataError, LogError, MissingExtraError, OptionError

viser = pytest.importorskip("viser")
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
    model = loopid.force_model(five_bar, "full", None)
    fit = replace(loopid.Fit.of(model, model.prior), standard_parameters=model.standard_prior)
    return fit.save(tmp_path_factory.mktemp("fit") / "fit.yaml")


def test_files_of_all_kinds_are_known(five_bar, fit_file, tmp_path):
    with open_viewer(five_bar, [LOG, fit_file]) as viewer:
        assert len(viewer.motion) > 100
        np.testing.assert_array_equal(viewer.pose.configuration, viewer.motion.configurations[0])
    with open_viewer(five_bar, ["five_bar"]) as viewer:
        assert viewer.motion is not None
    (tmp_path / "parameters.yaml").write_bytes(fit_file.read_bytes())
    with open_viewer(five_bar, [tmp_path]) as viewer:
        assert viewer.motion is None
    with pytest.raises(OptionError):
        open_viewer(five_bar, [LOG, "five_bar"])


def test_a_log_in_other_words_is_played_by_its_mapping(five_bar, tmp_path):
    log, mapping = tmp_path / "run.csv", tmp_path / "run.yaml"
    rows = LOG.read_text().splitlines()[1:300]
    log.write_text("\n".join(["ticks,a,b,c,d", *rows]))
    mapping.write_text(
        "time: {column: ticks}\nposition: {columns: [a, b]}\nforce: {columns: [c, d]}"
    )
    with pytest.raises(LogError):
        open_viewer(five_bar, [log])
    with open_viewer(five_bar, [log], mapping=mapping) as viewer:
        assert viewer.motion is not None


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
    assert (closed.max(axis=2) < 100).sum() > 100  # motors are dark, and nothing else is


def control(viewer, label):
    """A slider or a box of the viewer's page, by how its label begins."""
    handles = viewer._server.gui._gui_input_handle_from_uuid.values()
    return next(each for each in handles if each.label.startswith(label))


def test_a_slider_moves_whole_loops_and_a_motion_is_played(five_bar, fit_file):
    """As viser calls what a browser sends; in one ``make validate`` tries it."""
    with open_viewer(five_bar, [LOG, fit_file]) as viewer:
        before, slider = viewer.pose, control(viewer, viewer.scene.sliders[0].joint)
        slider.value += 0.1
        np.testing.assert_array_equal(viewer.pose.values, before.values)  # no hand has done it
        for follow in slider._impl.update_cb:
            follow(viser.GuiEvent(client=viewer, client_id=0, target=slider))
        after = viewer.pose
        play = control(viewer, "Play")
        playing = threading.Thread(target=setattr, args=(play, "value", True), daemon=True)
        playing.start()  # until the viewer is closed
        for _ in range(TRIES):
            time.sleep(0.05)
            if (viewer.pose.values != after.values).all():
                break
        played = viewer.pose
    playing.join(10)
    assert not playing.is_alive()
    np.testing.assert_allclose(after.values - before.values, [0.1, 0.0], atol=1e-9)
    assert np.abs(after.origins - before.origins).max(axis=1).min() == 0.0  # the fixed frame
    assert (np.abs(after.closures - before.closures) > 1e-4).any()
    assert max(after.residual, played.residual) <= 1e-9
    assert (played.values != after.values).all()


@IN_A_BROWSER
@pytest.mark.validate
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
