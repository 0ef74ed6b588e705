"""Advice in Python's words, as messages and findings give it, in the options of commands.

Sentences are made where nobody knows the command line, and many are put together from others. So
advice is found in the text. Python's keywords have a form that words of English have not.
"""

from __future__ import annotations

import re
import shlex
from ast import literal_eval
from functools import partial
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from loopid.robot.robot import Robot

# Advice in Python's words, between spaces: keyword=value, a list, text, a number or a flag; of a
# motion with the function that designs it.
ADVICE = re.compile(
    r"""(?<![^\s(])(?P<caller>design_motion with )?(?P<name>[a-z]\w*)="""
    r"""(?P<value>\[[^]]*\]|"[^"]*"|'[^']*'|-?\d+(?:\.\d+)?(?:e[-+]?\d+)?|True|False)"""
    r"""(?=[,;:.)]*(?:\s|$))"""
)

# An argument that is refused, at the beginning of a sentence.
ARGUMENT = re.compile(r"^[a-z]\w*(?= must )")
# Arguments that options of other names are given to.
RENAMED = {
    "gaussian": "noise",
    "deviation": "cad_error",
    "positions": "limit",
    "speeds": "max_speed",
    "accelerations": "max_acceleration",
    "forces": "max_force",
    "mass": "known_mass",
    "references": "reference",
    "condition_limit": "cond_limit",
}

# Where a column is not found, the command that begins the file that names it.
MAPPING = "in a mapping"
BEGUN = f"{MAPPING} (loopid init FILE LOG begins one)"

# Options of ``excite`` that other commands have in the same sense.
OF_ROBOT_AND_MODEL = (
    *("lock", "rounding", "floating_base", "free_mimics", "tied", "xacro"),
    *("model", "terms", "mapping"),
)


def in_options(text: str, context: typer.Context) -> str:
    """Text whose advice to use a parameter of a command names the command's option.

    ``lock=["x", "y"]`` becomes ``--lock x --lock y`` where the command has that option, and
    ``loopid base --lock x --lock y`` where only others have it; ``design_motion with`` becomes
    ``loopid excite`` with the robot. A mapping is one that ``loopid init`` begins. All other text
    stays as it is.
    """
    commands = getattr(context.find_root().command, "commands", {})

    def option(found: re.Match[str]) -> str:
        for command in (context.command, *commands.values()):
            for known in command.params:
                if known.name == found["name"] and known.param_type_name == "option":
                    words = _in_words(known, found["value"]) or found[0]
                    elsewhere = words != found[0] and command.name != context.command.name
                    called = f"loopid {command.name} {words}" if elsewhere else words
                    if found["caller"] is None:
                        return called
                    return _excite(words, context, commands["excite"])
        return found[0]

    if context.command.name != "init":
        text = text.replace(f"name it {MAPPING}", f"name it {BEGUN}")
        text = text.replace(f"by their numbers {MAPPING}", f"by their numbers {BEGUN}")
    return ADVICE.sub(option, ARGUMENT.sub(partial(_named, context.command), text))


def _named(command: Any, found: re.Match[str]) -> str:
    """The option of a command that an argument was made from."""
    name = RENAMED.get(found[0], found[0])
    options = (each for each in command.params if each.param_type_name == "option")
    return next((each.opts[0] for each in options if each.name == name), found[0])


def command_with(
    command: str, robot: Robot, *words: str, loaded: bool = True, **options: Any
) -> str:
    """A command for a robot, with options by their names, and with those that it was loaded with.

    Commands that do not load it find in their files how it was.
    """
    from loopid.loading.files import bundled_directory

    bundled = robot.path is not None and robot.path.parent == bundled_directory()
    said = ["loopid", command, robot.name if bundled else robot.source, *words]
    for name, value in (options | (dict(robot.options) if loaded else {})).items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, dict):
            value = [f"{key}:={given}" for key, given in value.items()]
        each = value if isinstance(value, list | tuple) else [value]
        for one in (one for one in each if one is not None and one is not False):
            said += [option] if one is True else [option, str(one)]
    return shlex.join(said)


def _excite(words: str, context: typer.Context, excite: Any) -> str:
    """The motion for parameters, of the robot, model and terms of the command, after its logs."""
    given = context.params
    said = ["loopid", "excite", str(given.get("file", "ROBOT")), *shlex.split(words)]
    for known in excite.params:
        value = given.get(known.name)
        if known.name == "mapping" and value:  # those of other options follow
            value = value[: len(given.get("logs", ())) or 1]
        if known.name not in OF_ROBOT_AND_MODEL or value in (None, known.get_default(context)):
            continue
        for one in value if isinstance(value, list | tuple) else [value]:
            said += known.opts if one is True else [known.opts[0], str(one)]
    said += [word for log in given.get("logs", ()) for word in ("--after", str(log))]
    return shlex.join(said)


def _in_words(known: Any, value: str) -> str:
    """An option with a value in Python's words; empty where a flag has no such value."""
    if known.is_flag:
        return str(next(iter(known.opts if value == "True" else known.secondary_opts), ""))
    given = literal_eval(value) if value[0] in "[\"'" else value
    words = given if isinstance(given, list) else [given]
    return " ".join(f"{known.opts[0]} {shlex.quote(str(word))}" for word in words)
