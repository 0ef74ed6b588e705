"""What all commands share: their list, how they answer, refuse and show progress."""

from __future__ import annotations

import shlex
import shutil
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from typer.core import TyperCommand

from loopid.cli.advice import in_options
from loopid.errors import LoopidError, OptionError, counted, one_line
from loopid.files import require_folder, require_other_file, write_files

if TYPE_CHECKING:
    from loopid.findings import Finding
    from loopid.report.page import Report

MOST_SAID = 5  # findings that are shown without ``--verbose``
WIDTH = 80  # columns of a table where the terminal gives none, as by COLUMNS=0


class Command(TyperCommand):
    """A command that refuses, warns and is interrupted in one line; a refusal is exit code 2."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; what it warns of is said after what it shows."""
        warned = ctx.obj = list[str]()

        def keep(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
            text = in_options(str(message), ctx)
            if issubclass(category, RuntimeWarning):  # NumPy's own, which name nothing
                text = (
                    f"some numbers on the way were too large, or none ({text}): are the units of "
                    "all files right?"
                )
            warned.extend([text] if text not in warned else [])

        try:
            with warnings.catch_warnings():
                warnings.showwarning = keep
                try:
                    return super().invoke(ctx)
                finally:
                    for text in warned:
                        say(f"warning: {text}", whole=ctx.params.get("verbose", False))
        except LoopidError as error:
            refuse(in_options(str(error), ctx))
        except MemoryError as error:
            refuse(f"there is not enough memory: {error}")
        except KeyboardInterrupt:
            say("interrupted")
            raise


def refuse(reason: str) -> NoReturn:
    """End the command with a line and exit code 2."""
    say(f"error: {reason}")
    raise typer.Exit(2)


def say(line: str, *, whole: bool = True) -> None:
    """Write a line to the error stream, if it takes any; cut to a terminal unless ``whole``."""
    text = one_line(f"loopid: {line}")
    if not whole and sys.stderr and sys.stderr.isatty():
        text = shorten(text, shutil.get_terminal_size().columns - 1, placeholder=" ...")
    with suppress(OSError):
        typer.echo(text, err=True)


# Files that commands write to a folder: no input may be one of them.
WRITTEN = (
    *("report.html", "check.json", "base.json", "identification.json", "parameters.yaml"),
    *("all_parameters.yaml", "excitation.json", "motion.yaml", "motion.csv", "prediction.json"),
    *("payload.json", "comparison.json"),
)


@dataclass(frozen=True)
class Answer:
    """How a command's user wants to see what it finds: options of the command."""

    context: typer.Context  # its object is what was warned of on the way
    out: str | None = typer.Option(
        None, metavar="DIR", help="Write report.html and results to a folder."
    )
    figures: bool = typer.Option(
        False, "--figures", help="With --out: each chart as SVG and PDF, for papers."
    )
    verbose: bool = typer.Option(False, "--verbose", "-v", help="All tables, whole warnings.")
    as_json: bool = typer.Option(False, "--json", help="Print JSON instead of text.")

    def __post_init__(self) -> None:
        if self.figures and self.out is None:
            raise OptionError("--figures are written to a folder: give --out DIR, too")

    def require(self, *inputs: str | Path | None) -> None:
        """Refuse, before the work, what could not be written: no input may be replaced."""
        if self.out is not None:
            require_folder(self.out)
            for name in WRITTEN:
                require_other_file(Path(self.out, name), *(each for each in inputs if each))

    def show(self, report: Report, command: str = "") -> None:
        """Write the report where a folder is given, and print it: the verdict first.

        The command is the next step of a card that is good.
        """
        from loopid.findings import Finding
        from loopid.report.look import json_text

        report = self._in_options(report, command)
        found = {str(each) for each in report.findings}
        warned = self.context.obj  # what is a finding is said once
        warned[:] = [text for text in warned if not any(text in each for each in found)]
        if warned:
            title = f"{counted(len(warned), 'warning')} of robot and log files"
            note = Finding("note", title, "; ".join(warned))
            report = replace(report, findings=[*report.findings, note])
        command = shlex.join(["loopid", *sys.argv[1:]])
        written: list[Path] = []
        if self.out is not None:
            written = write_files(self.out, report.files(command, figures=self.figures))
        if self.as_json:
            data = {**report.data, "written": [str(place) for place in written]}
            typer.echo(json_text(data))
            return
        self._print(report)
        if self.out is None:
            more = "" if self.verbose else " All: --verbose."
            typer.echo(f"Nothing was saved: --out DIR writes report.html and results.{more}")
            return
        typer.echo(one_line(f"Report: {written[0]}"))

    def _in_options(self, report: Report, command: str) -> Report:
        """The report with advice in the command's options, and the command of its next step."""

        def said(text: str) -> str:
            return in_options(text, self.context)

        findings = [replace(f, why=said(f.why), do=said(f.do)) for f in report.findings]
        card = report.card
        command = card.command or (command if card.tone == "good" else "")
        card = replace(card, use=said(card.use), next=said(card.next), command=command)
        return replace(report, verdict=said(report.verdict), findings=findings, card=card)

    def _print(self, report: Report) -> None:
        from rich.console import Console

        from loopid.report.look import Words

        console = Console(highlight=False)
        console.width = console.width or WIDTH
        console.print(Words(f"{report.title}: {report.verdict}"))
        verdict = report.verdict
        own = [f for f in report.findings if f.severity == "mistake" or f.title not in verdict]
        for line in in_words(own, self.verbose):
            console.print(Words(line))
        if report.advice:
            typer.echo(in_lines(report.advice, console.width))
        for table in report.tables() if self.verbose else report.brief:
            console.print(table)


def in_words(findings: Sequence[Finding], verbose: bool) -> list[str]:
    """Mistakes and warnings, the most important first; if required, all with their evidence."""
    if verbose:
        return [f"{each.severity}: {each}" for each in findings]
    serious = [each for each in findings if each.severity != "note"]
    said = [f"{each.severity}: {each.brief}" for each in serious[:MOST_SAID]]
    for k, each in enumerate(serious[:MOST_SAID]):
        if len(said[k]) > WIDTH and each.do:  # on a line of its own
            said[k] = f"{each.severity}: {each.title}\n  {each.do}"
    left = len(findings) - len(said)
    return [*said, *([f"{counted(left, 'more finding')}: --verbose"] if left and said else [])]


def with_options(**makers: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of other functions; what these make of them are its arguments."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        names = {name: list(signature(make).parameters) for name, make in makers.items()}
        # Robots are imported when they are made.
        own = signature(command, eval_str=True, locals={"Robot": Any}).parameters.values()
        more = (
            p
            for make in makers.values()
            for p in signature(make, eval_str=True).parameters.values()
        )
        all_ = [*(p for p in own if p.name not in makers), *more]
        all_ = [p.replace(kind=Parameter.KEYWORD_ONLY) for p in all_]
        all_.sort(key=lambda p: p.name != "file")  # the robot comes first

        @wraps(command)
        def run(**given: Any) -> None:
            made = {n: makers[n](**{k: given.pop(k) for k in names[n]}) for n in makers}
            command(**made, **given)

        run.__dict__["__signature__"] = Signature(all_)
        run.__annotations__ = {p.name: p.annotation for p in all_}
        return run

    return decorate


def in_lines(command: str, width: int) -> str:
    """A command on lines that a shell takes together."""
    lines = [""]
    for word in map(shlex.quote, shlex.split(command)):
        if lines[-1] and len(lines[-1]) + len(word) > width - 4:
            lines.append("   ")
        lines[-1] += f" {word}"
    return " \\\n".join(lines)
