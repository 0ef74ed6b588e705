"""Whether a rank depends on anything but the robot.

    python benchmarks/ranks.py [--seeds N] [--only PATTERN] [--json FILE]

Full models; each row is a robot, asked with some seeds and three numbers of samples: the ranks that
were found, the least gap of singular values, and processor time. Robots are the bundled ones, those
of others in ../shared where this is there, two and four copies side by side, and some whose poses
come as near to singularities as they like.
"""

from __future__ import annotations

import argparse
import os

import loopid

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

from lxml import etree
from ruamel.yaml import YAML

from loopid import bundled_robots
from loopid.base_parameters.structure import analyse
from loopid.kinematics import SamplingOptions
from loopid.loading.files import bundled_directory
from loopid.regressors import structural_observation
from tables import show, write_json

SHARED = Path(__file__).parents[2] / "shared"
SAMPLES = (100, 500, 2000)
CLEAR = 1e4  # gap of exact files
ANYWHERE = SamplingOptions(singularity_threshold=0.0)
OWN_NAMES = ("urdf", "platform", "identical")  # keys of a robot file that copies do without


@dataclass(frozen=True)
class Case:
    """A robot and how its poses are drawn."""

    name: str
    file: str
    times: int = 1  # the rank of as many robots
    options: SamplingOptions | None = None


def main() -> None:
    """Print the table and write it on request; the program fails where a rank is not one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", default="*", metavar="PATTERN", help="names, such as 'digit*'")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # of files that are what they are
    with TemporaryDirectory() as folder:
        wanted = [case for case in cases(Path(folder)) if fnmatch(case.name, arguments.only)]
        rows = []
        for case in wanted:
            rows.append(row(case, arguments.seeds))
            print(" ".join(map(str, rows[-1].values())), flush=True)
    show("ranks", rows)
    if arguments.json:
        write_json(arguments.json, {"ranks": rows})
    if any(one["ranks"].count(",") or one["least_gap"] < CLEAR for one in rows):
        raise SystemExit("some rank is not one number, or has no gap")


def cases(folder: Path) -> Iterator[Case]:
    """All robots; copies are written to a folder."""
    for name in bundled_robots():
        yield Case(name, name)
    files = sorted(SHARED.glob("models/*/*/robot.yaml")) + sorted(SHARED.glob("models/*/*.xml"))
    for file in [*files, *sorted(SHARED.glob("models/*/*.urdf"))]:
        yield Case(file.parent.name if file.stem == "robot" else file.stem, str(file))
    legs = SHARED / "field" / "digit_like_2legs" / "robot.yaml"
    if legs.is_file():
        yield Case("digit_like_2legs", str(legs))
    for name, count in (("five_bar", 2), ("five_bar", 4), ("delta", 2)):
        own = bundled_directory() / f"{name}.yaml"
        yield Case(f"{count} {name}", str(copies(own, count, folder / f"{name}{count}")), count)
    yield Case("five_bar, any pose", "five_bar", options=ANYWHERE)
    yield Case("3rrr, any pose", "3rrr", options=ANYWHERE)


def row(case: Case, seeds: int) -> dict[str, Any]:
    """What all draws of a robot show."""
    mechanism, found, start = loopid.load(case.file), [], process_time()
    for samples in SAMPLES:
        for seed in range(seeds):
            observed = structural_observation(
                mechanism, "full", samples=samples, seed=seed, options=case.options
            )
            found.append(analyse(observed))
    return {
        "robot": case.name,
        "ranks": ", ".join(map(str, sorted({one.rank for one in found}))),
        "least_gap": min(one.rank_gap for one in found),
        "doubtful": max(len(one.doubtful) for one in found),
        "seconds_each": (process_time() - start) / len(found),
    }


def copies(file: Path, count: int, folder: Path) -> Path:
    """Write a robot this many times beside itself; the path of its file.

    The copies have nothing in common: together they have as many times the rank.
    """
    description = YAML(typ="safe").load(file)
    tree = etree.parse(file.with_name(description.get("urdf", f"{file.stem}.urdf"))).getroot()
    parts = [part for part in tree if part.tag in ("link", "joint")]
    names = {part.get("name") for part in tree.iter() if part.get("name")}
    children = {child.get("link") for child in tree.iter("child")}
    (root,) = {part.get("name") for part in parts if part.tag == "link"} - children
    robot = etree.fromstring('<robot name="copies"><link name="floor"/></robot>')
    together: dict[str, Any] = {"urdf": "robot.urdf"}
    for k in range(count):

        def renamed(value: Any, prefix: str = f"copy{k}_") -> Any:
            if isinstance(value, dict):
                return {renamed(key): renamed(each) for key, each in value.items()}
            if isinstance(value, list):
                return [renamed(each) for each in value]
            return prefix + value if value in names else value

        for part in parts:
            own = etree.fromstring(etree.tostring(part))
            for element in own.iter(etree.Element):
                for key in ("name", "link", "joint"):
                    if element.get(key):
                        element.set(key, renamed(element.get(key)))
            robot.append(own)
        robot.append(
            etree.fromstring(
                f'<joint name="place{k}" type="fixed"><parent link="floor"/><child '
                f'link="{renamed(root)}"/><origin xyz="0 {2 * k} 0" rpy="0 0 0"/></joint>'
            )
        )
        for key, value in description.items():
            if key not in OWN_NAMES:
                own = renamed(value)
                kept = together.setdefault(key, type(own)())
                together[key] = {**kept, **own} if isinstance(own, dict) else kept + own
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_bytes(etree.tostring(robot))
    with (folder / "robot.yaml").open("w") as out:
        YAML(typ="safe").dump(together, out)
    return folder / "robot.yaml"


if __name__ == "__main__":
    main()
