"""What a shell completes: robots, joints, terms and words of options; all else it knows itself."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from contextlib import suppress
from glob import escape
from importlib import import_module
from pathlib import Path

import typer

from loopid.errors import LoopidError


def robots(incomplete: str) -> list[str]:
    """Bundled robots, and robot files and folders."""
    from loopid.loading.files import YAML, bundled_robots
    from loopid.registry import robot_formats

    folder, start = os.path.split(incomplete)
    places = [*Path(folder).glob(f"{escape(start)}*")] if Path(folder).is_dir() else []
    files = [str(place) for place in places if place.suffix in (*YAML, *robot_formats)]
    files += [f"{place}/" for place in places if place.is_dir()]
    return [name for name in bundled_robots() if name.startswith(incomplete)] + sorted(files)


def _of_robot(kind: str) -> Callable[[typer.Context, str], list[str]]:
    """What completes names of the robot that the words before name, if it can be loaded."""

    def names(context: typer.Context, incomplete: str) -> list[str]:
        from loopid.loading.robot_files import load

        # An option that waits for its value keeps the words before it from their parameters.
        robot = context.params.get("file") or next(iter(context.args), "")
        with suppress(LoopidError), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return [name for name in getattr(load(robot), kind) if name.startswith(incomplete)]
        return []

    return names


joints, links = _of_robot("joints"), _of_robot("links")


def words_of(place: str, *more: str) -> Callable[[str], list[str]]:
    """What completes a word of a registry, or of all that is listed, at ``"module:name"``."""

    def words(incomplete: str) -> list[str]:
        module, _, name = place.partition(":")
        known = getattr(import_module(f"loopid.{module}"), name)
        return [word for word in (*known, *more) if word.startswith(incomplete)]

    return words


def terms(incomplete: str) -> list[str]:
    """Terms of the joints, after those that stand there, as in ``Fc,Fv``."""
    from loopid.regressors.joint_laws import JOINT_TERMS

    before, comma, last = incomplete.rpartition(",")
    words = JOINT_TERMS if comma else ("file", "none", "auto", *JOINT_TERMS)
    return [before + comma + word for word in words if word.startswith(last)]


models = words_of("parameters:MODELS", "auto")
