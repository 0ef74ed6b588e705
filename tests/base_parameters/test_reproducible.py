"""The same result on any processor, with any BLAS threads, time limit, names and order of tags."""

import json
import os
import re
import subprocess
import sys
import warnings
from time import sleep, thread_time

import pytest
from lxml import etree

import loopid
from bank_robots import few_of
from closure_robots import X, Y, Z, body, files, frame, joint, urdf
from loopid import bundled_robots
from loopid.base_parameters import find_base
from loopid.base_parameters.blocks import Budget, OutOfBudgetError
from loopid.regressors import structural_observation

CHOICES = """
import json, sys
import loopid
from loopid.base_parameters import ChoiceProblem, ExactSearch, PivotedQR, SearchOptions
from loopid.base_parameters import SubgroupSearch
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.structure import analyse
from loopid.regressors import structural_observation
from loopid.errors import OptionError

def choices(time_limit, *robots):
    found = {}
    for robot in robots:
        for model in ("gravity", "full"):
            structure = analyse(structural_observation(loopid.load(robot), model))
            for criterion in CRITERIA:
                problem = ChoiceProblem(structure, criterion)
                exact = ExactSearch(SearchOptions(time_limit=float(time_limit))).search(problem)
                assert exact.certified, (robot, model, criterion, exact)
                key = f"{robot} {model} {criterion}"
                found[key] = [exact.dependent, exact.ties]
                found[key + " qr"] = PivotedQR().search(problem).dependent
        if robot in ("five_bar", "3ups_rpu"):
            problem = ChoiceProblem(analyse(structural_observation(loopid.load(robot))))
            try:
                found[robot + " subgroup"] = SubgroupSearch().search(problem).dependent
            except OptionError as error:
                found[robot + " subgroup"] = str(error)
    return json.dumps(found)
"""


@pytest.fixture(scope="module")
def palletizer(tmp_path_factory):
    """An arm whose two parallelograms keep the hand level, on a turning column."""
    parts = [
        body("column", (0.02, 0.0, 0.2), 20.0),
        joint("turn", "ground", "column", (0, 0, 0.4), Z),
        body("arm", (0.0, 0.01, 0.3), 12.0),
        joint("shoulder", "column", "arm", (0.1, 0, 0.3), Y),
        body("plate", (-0.05, 0, 0.05), 2.0),
        joint("plate_joint", "arm", "plate", (0, 0, 0.7), Y),
        body("rod", (0.0, 0.0, 0.35), 1.5),
        joint("rod_joint", "column", "rod", (-0.1, 0, 0.35), Y),
        frame("rod_end", "rod", (0, 0, 0.7)),
        frame("plate_end", "plate", (-0.2, 0, 0.05)),
        body("forearm", (0.3, 0.0, 0.02), 8.0),
        joint("elbow", "arm", "forearm", (0, 0, 0.7), Y),
        body("hand", (0.05, 0, 0.0), 3.0),
        joint("hand_joint", "forearm", "hand", (0.6, 0, 0), Y),
        body("bar", (0.3, 0.0, 0.0), 1.2),
        joint("bar_joint", "plate", "bar", (0, 0, 0.15), Y),
        frame("bar_end", "bar", (0.6, 0, 0)),
        frame("hand_end", "hand", (0, 0, 0.15)),
        body("gripper", (0.0, 0.0, -0.1), 5.0),
        joint("wrist", "hand", "gripper", (0.1, 0, 0), Z),
    ]
    names = ("turn", "shoulder", "elbow", "wrist")
    passive = ("plate_joint", "rod_joint", "hand_joint", "bar_joint")
    folder = tmp_path_factory.mktemp("palletizer")
    text, description = files(
        parts,
        {
            "closed_loop": [["rod_end", "plate_end"], ["bar_end", "hand_end"]],
            "type": ["3d", "3d"],
            "name_mot": list(names),
            "reference": dict.fromkeys((*names, *passive), 0.0),
        },
    )
    (folder / "robot.urdf").write_text(text)
    (folder / "robot.yaml").write_text(description)
    return folder / "robot.yaml"


def chosen(robots, kernel=None, threads=1, time_limit=60):
    environment = os.environ | {"OPENBLAS_NUM_THREADS": str(threads)}
    environment.pop("OPENBLAS_CORETYPE", None)
    if kernel:
        environment["OPENBLAS_CORETYPE"] = kernel
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"{CHOICES}\nprint(choices(*sys.argv[1:]))",
            str(time_limit),
            *robots,
        ],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def test_a_search_that_has_to_wait_has_as_much_time():
    budget = Budget(thread_time() + 0.02)
    sleep(0.04)
    budget.check()
    with pytest.raises(OutOfBudgetError):
        for _ in budget.checking(iter(int, 1)):  # without end
            pass


def test_processors_threads_and_time_limits_do_not_change_the_choice(palletizer):
    robots, here = [str(palletizer)], {}
    exec(CHOICES, here)
    found = json.loads(here["choices"](60, *robots))
    assert chosen(robots, "Nehalem", threads=2, time_limit=20) == found


@pytest.mark.validate
@pytest.mark.parametrize(("kernel", "threads"), [("Haswell", 2), ("Nehalem", 1), ("Prescott", 1)])
def test_nor_those_of_any_bundled_robot(kernel, threads):
    assert chosen(bundled_robots(), kernel, threads) == chosen(bundled_robots())


# Robots whose files list no motors: joints that nothing but names and their order tells apart would
# be the first to be confused.


def tree():
    """Branches in which all joints differ."""
    parents = ("ground", "a", "a", "b", "b", "c", "ground", "g")
    return urdf(
        *(
            body(link, (0.02 * k, 0.01, -0.03), 1 + 0.1 * k)
            + joint(
                f"{link}_joint",
                parent,
                link,
                (0.1, 0.03 * k, 0.2),
                (X, Y, Z)[k % 3],
                "prismatic" if k == 4 else "revolute",
                (0.1 * k, 0.3, 0.2),
            )
            for k, (link, parent) in enumerate(zip("abcdefgh", parents, strict=True))
        )
    )


def coaxial():
    """A five-bar linkage whose cranks, on one axis, only differ in the rods that they carry."""
    parts = [frame(f"closing_pin_{k}", f"{side}_rod", (0.4, 0, 0)) for k, side in SIDES]
    for k, side in SIDES:
        parts += [
            body(f"{side}_crank"),
            joint(f"{side}_shoulder", "ground", f"{side}_crank", axis=Y),
            body(f"{side}_rod", mass=k),
            joint(f"{side}_elbow", f"{side}_crank", f"{side}_rod", (0.3, 0, 0), Y, rpy=(0, k, 0)),
        ]
    return urdf(*parts)


SIDES = ((1, "left"), (2, "right"))


def folded():
    """Two parallelograms, drawn folded, on a column; motors that depend on each other."""
    parts = [body("column"), joint("turn", "ground", "column", axis=Z)]
    for k, side in SIDES:
        y = 0.2 * k
        parts += [
            *(body(f"{side}_{name}") for name in ("crank", "rod", "rocker")),
            joint(f"{side}_shoulder", "column", f"{side}_crank", (0, y, 0), Y),
            joint(f"{side}_elbow", f"{side}_crank", f"{side}_rod", (y, 0, 0), Y),
            joint(f"{side}_foot", "column", f"{side}_rocker", (0.5, y, 0), Y),
            frame(f"closing_{side}_1", f"{side}_rod", (0.5, 0, 0)),
            frame(f"closing_{side}_2", f"{side}_rocker", (y, 0, 0)),
        ]
    return urdf(*parts)


def hanging():
    """An MJCF of branches, of which one hangs on a ball."""

    def link(name, inside, kind, y=0.0):
        return (
            f'<body name="{name}" pos="0.3 {y} 0"><inertial pos="0.1 0 0.02" mass="1" '
            f'diaginertia="0.02 0.03 0.04"/><joint name="{name}_joint" {kind}/>{inside}</body>'
        )

    hinge = 'axis="0 1 0"'
    left = link("left", link("low", "", hinge) + link("lower", "", 'axis="1 0 0"', 0.2), hinge)
    right = link("right", link("end", "", 'type="ball"'), hinge, 0.5)
    return f"<mujoco><worldbody>{left}{right}</worldbody></mujoco>"


def rewritten(text, names, tags):
    """The same robot with names that sort the other way, or with its tags in reverse order."""
    root = etree.fromstring(text)
    for tag in root.iter("robot", "body", "worldbody") if tags else ():
        tag[:] = tag[::-1]
    text = etree.tostring(root).decode()
    old = {tag.get("name") for tag in root.iter("link", "joint", "body")} - {"ground", None}
    old = sorted(name for name in old if "closing_" not in name)
    new = {name: f"n{len(old) - k:02}" for k, name in enumerate(old)} if names else {}
    text = re.sub(r'"(\w+)"', lambda match: f'"{new.get(match[1], match[1])}"', text)
    return text, {name: link for link, name in new.items()}


@pytest.mark.parametrize("robot", few_of([tree, coaxial, folded, hanging], tree, coaxial, hanging))
def test_names_and_the_order_of_tags_change_nothing(robot, tmp_path):
    file = tmp_path / ("robot.xml" if robot is hanging else "robot.urdf")
    if robot is hanging:
        pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    found = []
    for names, tags in ((False, False), (True, True)):
        text, before = rewritten(robot(), names, tags)
        file.write_text(text)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of motors that depend on each other, and of modes
            mechanism = loopid.load(file)
            base = find_base(structural_observation(mechanism, "full"))
        names = (name.split(".") for name in base.names)
        chosen = {f"{before.get(link, link)}.{kind}" for link, kind in names}
        found.append((chosen, [base.condition_number, base.nullspace_condition_number]))
    for chosen, conditions in found:
        assert chosen == found[0][0]
        assert conditions == pytest.approx(found[0][1], rel=1e-10, abs=0)
