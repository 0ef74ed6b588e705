"""Whatever a YAML says of closures: the robot closes, or is refused in one sentence."""

import warnings

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from closure_robots import files, tie
from loopid import load_mechanism, mobility
from loopid.errors import LoopidError
from small_tree import PARTS

FUNCTION_SCOPED = [HealthCheck.function_scoped_fixture]
NAN, INF = float("nan"), float("inf")
ENDS = ("tip", "slide")
KINDS = ("3d", "6d", "hinge", "universal", "2d", "prismatic", "cylindrical", "distance")
TYPES = ("FIXED", "SPHERICAL", "UJOINT_XZ")
ODD = (0, 1e-200, 1e200, -1e308, NAN, INF, 10**400)
# Now and then a name or a number is wrong.
LINK = st.sampled_from(("arm", "hand", "tip", "palm", "slide", "egg", "ground") * 2 + ("toe", ""))
JOINT = st.sampled_from(("shoulder", "elbow", "rail", "ball") * 3 + ("wrist", "tip"))
NUMBER = st.sampled_from((1, -2, 0.5, 0.3, 1e-9, 1e9) * 5 + ODD)
FRAMES = st.tuples(LINK, LINK)
AXES = st.lists(st.lists(NUMBER, min_size=3, max_size=3), min_size=2, max_size=2)
PAIR = st.fixed_dictionaries({"type": st.sampled_from(KINDS), "frames": FRAMES})
ROD = st.fixed_dictionaries({"type": st.just("distance"), "frames": FRAMES, "length": NUMBER})
SLIDE = st.fixed_dictionaries(
    {"type": st.sampled_from(("2d", "hinge", "cylindrical")), "frames": FRAMES, "axes": AXES}
)
COUPLING = st.fixed_dictionaries(
    {
        "type": st.just("coupling"),
        "joints": st.dictionaries(JOINT, NUMBER, min_size=1, max_size=3),
    },
    optional={"offset": NUMBER},
)
TURN = st.sampled_from([[0, 0, 0, 1], [0.6, 0, 0, 0.8], [0, 0, 1], []])
# Keys in addition to the closures, one at a time.
MORE = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"identical": st.dictionaries(LINK, st.lists(LINK), max_size=1)}),
    st.fixed_dictionaries({"reference": st.dictionaries(JOINT, NUMBER | TURN, max_size=2)}),
    st.fixed_dictionaries({"name_mot": st.lists(JOINT, min_size=1, max_size=2)}),
    st.builds(
        lambda name, kind: {"joint_name": [name], "joint_type": [kind]},
        JOINT,
        st.sampled_from(TYPES),
    ),
)
CLOSURES = st.lists(PAIR | ROD | SLIDE | COUPLING | COUPLING, min_size=1, max_size=2)


@pytest.fixture
def load(tmp_path):
    """Load the tree with a description; warnings must name the file."""

    def loaded(description):
        for suffix, text in zip(("urdf", "yaml"), files(PARTS, description), strict=True):
            (tmp_path / f"robot.{suffix}").write_text(text)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=f"{tmp_path}/robot")
            return load_mechanism(tmp_path / "robot.yaml")

    return loaded


@settings(max_examples=250, suppress_health_check=FUNCTION_SCOPED)
@given(closures=CLOSURES, more=MORE)
@example(closures=[tie("2d", ENDS, axes=[[0, 0, 1e200], [0, 1e-200, 0]])], more={})
@example(closures=[tie("distance", ENDS, length=1e200)], more={})
@example(closures=[tie("distance", ENDS, length=1e-200)], more={})
@example(closures=[{"type": "coupling", "joints": {"rail": 1e-200}, "offset": 1}], more={})
@example(closures=[tie("3d", ENDS)], more={"reference": {"rail": 1e200}})
def test_any_description_closes_or_is_refused(closures, more, load, tmp_path):
    robot, refusal = None, f"{tmp_path}/robot.yaml: "
    try:
        robot = load({"closures": closures, **more})
    except LoopidError as error:
        refusal = str(error)
    assert refusal.startswith(f"{tmp_path}/robot.yaml: ")
    assert "\n" not in refusal
    if robot is not None:
        assert mobility(robot).residual < 1e-9 * max(1.0, robot.length)


def test_the_tree_itself_is_loaded(load):
    robot = load({})
    assert robot.independent == robot.actuated
    assert len(robot.actuated) == 4
