"""The same choice on every processor, with any number of BLAS threads and any time limit."""

import json
import os
import subprocess
import sys

import pytest

from closure_robots import Y, Z, body, files, frame, joint
from loopid import bundled_robots

CHOICES = """
import json, sys
from loopid.base_parameters import PivotedQR, SubgroupSearch
from loopid import ExactSearch, load_mechanism, structural_observation
from loopid.base_parameters import CRITERIA, ChoiceProblem, analyse
from loopid.errors import SearchError

def choices(time_limit, *robots):
    found = {}
    for robot in robots:
        for model in ("gravity", "full"):
            structure = analyse(structural_observation(load_mechanism(robot), model))
            for criterion in CRITERIA:
                problem = ChoiceProblem(structure, criterion)
                exact = ExactSearch(float(time_limit)).search(problem)
                assert exact.certified, (robot, model, criterion, exact)
                key = f"{robot} {model} {criterion}"
                found[key] = [exact.dependent, exact.ties]
                found[key + " qr"] = PivotedQR().search(problem).dependent
        if robot in ("five_bar", "3ups_rpu"):
            problem = ChoiceProblem(analyse(structural_observation(load_mechanism(robot))))
            try:
                found[robot + " subgroup"] = SubgroupSearch().search(problem).dependent
            except SearchError as error:
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


def test_processors_threads_and_time_limits_do_not_change_the_choice(palletizer):
    robots, here = ["five_bar", str(palletizer)], {}
    exec(CHOICES, here)
    found = json.loads(here["choices"](60, *robots))
    assert chosen(robots, "Nehalem", threads=2, time_limit=20) == found


@pytest.mark.validate
@pytest.mark.parametrize(("kernel", "threads"), [("Haswell", 2), ("Nehalem", 1), ("Prescott", 1)])
def test_nor_those_of_any_bundled_robot(kernel, threads):
    assert chosen(bundled_robots(), kernel, threads) == chosen(bundled_robots())
