"""What all commands share: their list, how they answer, refuse and show progress."""

from __future__ import annotations

import os
import re
import shlex
import sys
import warnings
from ast import literal_eval
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from typer.core import TyperCommand

from loopid.errors import LoopidError, one_line

if TYPE_CHECKING:
    from rich.table import Table

WIDTH = 80  # columns of a table where the terminal tells none, as by COLUMNS=0
# Advice in Python's words, between spaces: keyword=value, a list, text, a number or a flag.
ADVICE = re.compile(
    r"""(?<![^\s(])(?P<name>[a-z]\w*)="""
    r"""(?P<value>\[[^]]*\]|"[^"]*"|'[^']*'|-?\d+(?:\.\d+)?(?:e[-+]?\d+)?|True|False)"""
    r"""(?=[,;:.)]*(?:\s|$))"""
)


class Command(TyperCommand):
    """A command that refuses, warns and is interrupted in one line; a refusal is exit code 2."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""

        def show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
            say(f"warning: {in_options(str(message), self.params)}")

        try:
            with warnings.catch_warnings():
                warnings.showwarning = show_warning
                return super().invoke(ctx)
        except LoopidError as error:
            refuse(in_options(str(error), self.params))
        except MemoryError as error:
            refuse(f"there is not enough memory: {error}")
        except BrokenPipeError:
            raise  # as of ``loopid ... | head``: Typer ends the command
        except OSError as error:
            if error.filename is None:  # of a stream: what waits to be written is lost too
                os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            refuse(f"{error.filename or 'standard output'}: {error.strerror}")
        except KeyboardInterrupt:
            say("interrupted")
            raise


def in_options(text: str, parameters: Iterable[Any]) -> str:
    """Text whose advice to use a parameter of a command names the command's option.

    ``lock=["x", "y"]`` becomes ``--lock x --lock y`` where the command has that option; all other
    text stays as it is.
    """
    options = {each.name: each for each in parameters if each.param_type_name == "option"}

    def option(found: re.Match[str]) -> str:
        known = options.get(found["name"])
        if known is None:
            return found[0]
        if known.is_flag:
            names = known.opts if found["value"] == "True" else known.secondary_opts
            return str(names[0]) if names else found[0]
        given = literal_eval(found["value"]) if found["value"][0] in "[\"'" else found["value"]
        words = given if isinstance(given, list) else [given]
        return " ".join(f"{known.opts[0]} {shlex.quote(str(word))}" for word in words)

    return ADVICE.sub(option, text)


def refuse(reason: str) -> NoReturn:
    """End the command with a line and exit code 2."""
    say(f"error: {reason}")
    raise typer.Exit(2)


def say(line: str) -> None:
    """Write a line to the error stream, if it takes any: results do not depend on it."""
    with suppress(OSError):
        typer.echo(one_line(f"loopid: {line}"), err=True)


def show(record: dict[str, Any], tables: Iterable[Table], as_json: bool) -> None:
    """Print tables, or the record as JSON."""
    from rich.console import Console

    from loopid.report.look import json_text

    if as_json:
        typer.echo(json_text(record))
        return
    console = Console()
    console.width = console.width or WIDTH
    for table in tables:
        console.print(table)


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[..., None]]:
    """A progress bar on the terminal's error stream, gone when the work is done.

    It is moved by what is done of how much, and may show the best criterion so far.
    """
    if not sys.stderr or not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    said = TextColumn("{task.description}", markup=False)
    columns = said, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(one_line(what), total=None)

        def report(done: float, total: float, best: float | None = None) -> None:
            text = one_line(what) if best is None else f"{one_line(what)} {best:.4g}"
            progress.update(task, completed=done, total=total, description=text)

        yield report
