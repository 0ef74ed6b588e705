"""Whatever a URDF says: it is read, or refused in one sentence that names the file."""

import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from broken_robots import FAMILY, KNEE, mutilated
from loopid.errors import LoopidError
from loopid.loading.urdf import read_urdf


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    file = tmp_path_factory.mktemp("fuzzed") / "robot.urdf"

    def outcome(text, floating_base=False):
        file.write_text(text, encoding="utf-8")
        source, refusal = None, f"{file}: "
        try:
            source = read_urdf(file, floating_base)
        except LoopidError as error:
            refusal = str(error)
        assert refusal.startswith(f"{file}: ")
        assert "\n" not in refusal
        if source is not None:
            check(source)
        return source

    return outcome


def check(source):
    model = source.model
    bodies = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    assert set(source.inertial_links) <= bodies
    assert set(list(model.names)[1:]) <= set(source.child_links)
    assert set(source.description.name_mot or ()) <= set(model.names)
    for closure in source.description.closures:
        assert all(model.existFrame(frame) for frame in closure.frames or ())
        assert all(model.existJointName(joint) for joint in closure.joints or ())


def test_the_whole_family_is_read(read):
    source = read(FAMILY)
    kinds = [closure.type for closure in source.description.closures]
    assert kinds == ["3d", "hinge", "coupling", "coupling"]
    assert source.description.name_mot == ["motor"]


@settings(max_examples=150)
@given(text=mutilated(FAMILY), floating_base=st.booleans())
def test_a_mutilated_family_is_read_or_refused(read, text, floating_base):
    read(text, floating_base)


@settings(max_examples=50)
@given(text=mutilated(KNEE))
def test_a_mutilated_knee_robot_is_read_or_refused(read, text):
    read(text)


@settings(max_examples=60)
@given(data=st.data())
def test_a_cut_or_patched_text_is_read_or_refused(read, data):
    at = data.draw(st.integers(0, len(FAMILY)))
    length = data.draw(st.integers(0, 8))
    patch = data.draw(st.text(max_size=4))
    text = FAMILY[:at] + patch + FAMILY[at + length :]
    read(text.encode("utf-8", "ignore").decode())
