"""Seeded command lines: sound and spoilt files, valid and wrong options, in any mixture."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import typer
from fuzz_material import Material

from loopid.cli import app

Parameter = Any  # Typer brings a click of its own.

# How often a command is called; those that are not named here as often as ``check``.
WEIGHTS = {"check": 5, "base": 4, "identify": 8, "motions": 2, "paper": 0.3, "export": 5}
JUNK = ("", " ", "x", "nan", "inf", "-1", "0", "1e400", "[bold]", "é", "--", "a\nb", "1,2", "None",
        "\udcff", "true", "9" * 40, "*", "'", "Fc")  # fmt: skip
NUMBERS = ("0.5", "1", "0", "-1", "nan", "inf", "-inf", "1e-300", "1e300", "x", "", "2", "0.01")
# Of options by name, most of them valid.
VALUES = {
    "model": ("gravity", "full", "gravity", "Gravity", "x", ""),
    "terms": ("Fc,Fv", "none", "Fc,Fv,Fo,Ia", "Fv", "Fc,Fc", "Fx", "", ",", "Fc,none", " Fc , Fv "),
    "estimator": ("wls", "ols", "huber", "bisquare", "tls", "bayes", "iv", "WLS", "best", ""),
    "unidentifiable": ("error", "prior", "Prior", "", "x"),
    "consistent": ("entropic", "euclidean", "riemannian", "Entropic", "", "x"),
    "prior_deviation": ("0.3", "1", "0", "-1", "nan", "inf", "1e-12", "1e12", "x"),
    "search": ("exact", "qr", "subgroup", "exhaustive", "x", ""),
    "criterion": ("nullspace", "regressor", "x"),
    "samples": ("40", "1", "3", "10", "0", "-1", "x", "1.5"),
    "seed": ("0", "1", "7", "-1", "x", "1.5", "9" * 30),
    "time_limit": ("0.2", "1", "0", "-1", "nan", "x"),
    "cutoff": ("1", "5", "0.05", "0", "-1", "nan", "inf", "24", "25", "1e9", "x"),
    "train": ("0.5", "0.9", "0.05", "0", "1", "nan", "-1", "x", "1e-9"),
    "rate": ("5", "20", "0.2", "0", "-1", "nan", "inf", "1e12", "1e-12", "x"),
    "margin": ("0.02", "0", "-1", "nan", "inf", "x", "0.9"),
    "jobs": ("1", "1", "1", "1", "1", "1", "2", "0", "-1", "x", "1.5"),
    "lock": ("elbow", "rocker_joint", "motor", "crank_joint", "x", "", "shoulder", "hub"),
}  # fmt: skip
# Options that name what is to be written, and its ending.
WRITTEN = {"out": "", "robot": ".urdf", "yaml": ".yaml", "npz": ".npz", "c": ""}
# How many of them, the first ones, are sound for all robots or nearly so.
VALID = {
    "model": 3, "terms": 4, "estimator": 6, "unidentifiable": 2, "consistent": 3, "prior_deviation": 2,
    "search": 3, "criterion": 2, "samples": 1, "seed": 3, "time_limit": 2, "cutoff": 2, "train": 2,
    "rate": 2, "margin": 2, "jobs": 7,
}  # fmt: skip


@dataclass(frozen=True)
class Call:
    """Words of a command line after ``loopid``, and where it is to write."""

    number: int
    words: tuple[str, ...]
    outs: tuple[str, ...] = ()


def parameters(command: str) -> list[Parameter]:
    """Arguments and options of a command, as it declares them."""
    return list(commands()[command].params)


def commands() -> dict[str, Any]:
    """All commands of the command line by name."""
    return dict(typer.main.get_command(app).commands)


def calls(material: Material, seed: int, numbers: range) -> Iterator[Call]:
    """Calls of these numbers; each depends on its seed and number alone."""
    for number in numbers:
        yield _Maker(material, Random(f"{seed} {number}")).call(number)


class _Maker:
    def __init__(self, material: Material, random: Random) -> None:
        self.material, self.random = material, random
        self.robot = self._one(("arm", "arm", "arm", "four_bar", *material.robots))
        self.outs: list[str] = []
        # Most calls have one thing wrong, if any: what is refused first hides the rest.
        self.sound = self._one((0.6, 0.85, 0.95, 1.0))

    def call(self, number: int) -> Call:
        names = list(commands())
        weights = [WEIGHTS.get(name, WEIGHTS["check"]) for name in names]
        name = self.random.choices(names, weights)[0]
        words = [name]
        options = [
            p for p in parameters(name) if p.param_type_name == "option" and p.name != "help"
        ]
        for parameter in parameters(name):
            if parameter.param_type_name == "argument":
                words += self._argument(parameter)
        # What writes is exercised more than its share.
        chosen = self.random.sample(options, min(len(options), self.random.choice((0, 1, 1, 2, 3))))
        for option in chosen:
            words += self._option(option)
        if self._wrong(0.1):
            words.insert(self.random.randint(0, len(words)), self._one(("--nope", "--help", "-x")))
        if self._wrong(0.1):
            del words[self.random.randrange(len(words))]
        return Call(number, tuple(words), tuple(self.outs))

    def _argument(self, argument: Parameter) -> list[str]:
        if argument.name == "file":
            return [self._robot()]
        if argument.name == "program":
            return [] if self._chance(0.3) else [self._file([self.material.motions], ".yaml")]
        if argument.name == "fit":
            return [self._file([self.material.fit], ".yaml")]
        if argument.nargs == -1 or argument.name == "logs":
            return [self._log() for _ in range(self._one((1, 1, 1, 2, 0)))]
        return [str(self._new_place())]

    def _option(self, option: Parameter) -> list[str]:
        if option.is_flag:
            return [option.opts[0]]
        return [option.opts[0], self._value(option)]

    def _value(self, option: Parameter) -> str:
        name = option.name or ""
        if name in ("mapping", "reference_mapping"):
            return self._file([self.material.mapping], ".yaml")
        if name in ("validate", "friction_log", "log", "reference"):
            return self._log()
        if name in WRITTEN:
            return self._out(WRITTEN[name])
        if name in VALUES and not self._wrong(0.3):
            values = VALUES[name]
            return self._one(values if self._wrong() else values[: VALID.get(name, 1)])
        return self._one((*NUMBERS, *JUNK))

    def _robot(self) -> str:
        if self._wrong(0.2):
            return self._one(("3ups", *JUNK, "robot.urdf"))
        return self._file(self.material.robots[self.robot], self._one((".urdf", ".yaml", ".xml")))

    def _log(self) -> str:
        logs = self.material.logs
        own = logs[self.robot] if self.robot in logs else self._one([*logs.values()])
        log = self._one(own)
        return self._file([log], log.suffix)

    def _file(self, files: list[Path], ending: str) -> str:
        if not self._wrong():
            return str(files[0])
        if self._chance(0.8):
            return str(self.material.spoilt(files, self.random))
        return self.material.wrong_place(ending, self.random)

    def _out(self, ending: str) -> str:
        if self._wrong():
            place = self.material.wrong_place(ending, self.random)
        else:
            place = str(self._new_place() / f"made{ending}" if ending else self._new_place())
        self.outs.append(place)
        return place

    def _new_place(self) -> Path:
        """A place that is new, or holds files of its own."""
        place = self.material.folder / f"out{self.random.randrange(10**9)}"
        if self._chance(0.5):
            place.mkdir(exist_ok=True)
            for name in ("report.md", "notes.txt", "result.json"):
                (place / name).write_text("old\n")
        return place

    def _one(self, choices):
        return self.random.choice(list(choices))

    def _wrong(self, part: float = 1.0) -> bool:
        """Whether the next thing is to be wrong, or only in so many of these cases."""
        return not self._chance(self.sound) and self._chance(part)

    def _chance(self, part: float) -> bool:
        return self.random.random() < part
