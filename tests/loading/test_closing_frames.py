"""Pairs of frames that close loops by their names."""

import pytest
from small_urdf import BRANCHES, frame, robot

from loopid.errors import RobotFileError
from loopid.loading.urdf import read_urdf


@pytest.fixture
def closures(tmp_path):
    def of(*frames):
        file = tmp_path / "robot.urdf"
        file.write_text(robot(*BRANCHES, *frames))
        return read_urdf(file).description.all_closures

    return of


def test_two_frames_of_one_name_meet(closures):
    (closure,) = closures(frame("closing_pin_2", "wheel"), frame("closing_pin_1", "hand"))
    assert closure.type == "3d"
    assert closure.frames == ("closing_pin_1", "closing_pin_2")


def test_a_second_pair_along_the_axis_makes_a_hinge(closures):
    ends = (("1", "hand"), ("2", "wheel"))
    pairs = [frame(f"closing_pin_{k}{z}", link) for k, link in ends for z in ("", "_z")]
    (closure,) = closures(*pairs)
    assert closure.type == "hinge"
    assert closure.frames == ("closing_pin_1", "closing_pin_2")
    assert closure.axes == ((0, 0, 1), (0, 0, 1))


def test_names_may_hold_numbers_of_their_own(closures):
    pairs = [frame(f"closing_{k}_1_{side}", "hand") for k in (1, 2) for side in (1, 2)]
    assert [closure.frames[0] for closure in closures(*pairs)] == ["closing_1_1_1", "closing_2_1_1"]


def test_other_frames_close_nothing(closures):
    names = ("closing", "closing_1", "closing__1", "closing_pin_3", "closing_pin", "my_closing_x_1")
    assert closures(*(frame(name, "hand") for name in names)) == ()


@pytest.mark.parametrize(("there", "missing"), [(1, 2), (2, 1)])
def test_a_frame_without_its_partner_is_refused(closures, refusal, there, missing):
    with pytest.raises(RobotFileError) as failure:
        closures(frame(f"closing_pin_{there}", "hand"))
    refusal(failure, "robot.urdf: ", f"link closing_pin_{there}", f"'closing_pin_{missing}'")
