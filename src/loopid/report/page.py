"""Reports: a verdict, sections and a record; shown in the terminal, or as one page of HTML.

A page opens without a network: style, script and numbers are in it. Another report is a class with
other sections, or ``Page("title", sections)`` with some of those of a report.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator, Sequence
from functools import cached_property
from importlib.metadata import version
from importlib.resources import files
from typing import Any, ClassVar

from lxml.html import HtmlElement, tostring
from lxml.html.builder import E
from rich.table import Table

from loopid.errors import one_line
from loopid.records import record
from loopid.report.chart import Chart
from loopid.report.look import facts, json_text

LIBRARIES = "loopid", "pin", "numpy", "scipy"
# What a browser is allowed: nothing from elsewhere.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"

Part = str | Table | Chart  # a paragraph, a table, a chart


@record
class Section:
    """A title, and what stands below it.

    Attributes
    ----------
    title : str
    parts : tuple
        Paragraphs (str), tables (``rich.table.Table``) and charts (``Chart``).
    """

    title: str
    parts: tuple[Part, ...]

    @property
    def anchor(self) -> str:
        """Its address on the page."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())

    def html(self) -> HtmlElement:
        """A section of a page."""
        return E.section({"id": self.anchor}, E.h2(one_line(self.title)), *map(_part, self.parts))


def _part(part: Part) -> HtmlElement:
    if isinstance(part, Chart):
        return part.html()
    return _table(part) if isinstance(part, Table) else E.p(one_line(part))


def _table(table: Table) -> HtmlElement:
    sides = ["number" if column.justify == "right" else "" for column in table.columns]
    rows = zip(*(column.cells for column in table.columns), strict=True)
    body = (
        E.tr(*(E.td({"class": side}, str(cell)) for side, cell in zip(sides, row, strict=True)))
        for row in rows
    )
    found = E.table(E.tbody(*body))
    if table.show_header:
        heads = zip(sides, (str(column.header) for column in table.columns), strict=True)
        head = E.thead(E.tr(*(E.th({"class": side, "scope": "col"}, name) for side, name in heads)))
        found.insert(0, head)
    if table.title:
        found.insert(0, E.caption(str(table.title)))
    note = [E.p({"class": "note"}, str(table.caption))] if table.caption else []
    return E.div({"class": "table"}, found, *note)


@record(kw_only=True)
class Run:
    """How a report came about.

    Attributes
    ----------
    command : str
        The command line, empty where there was none.
    warnings : tuple of str
    """

    command: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def versions(self) -> dict[str, str]:
        """Of the libraries that decide the numbers."""
        return {
            **{name: version(name) for name in LIBRARIES},
            "Python": platform.python_version(),
            "machine": f"{platform.system()} {platform.machine()}",
        }

    def sections(self) -> Iterator[Section]:
        """Warnings, and what reproduces the run."""
        if self.warnings:
            yield Section("Warnings", self.warnings)
        told = {"command": self.command} if self.command else {}
        yield Section("To reproduce", (facts("", told | self.versions),))


NO_RUN = Run()


@record
class Page:
    """One file of HTML.

    Attributes
    ----------
    title : str
    sections : tuple of Section
    verdict : str
        One sentence above all.
    data : dict or None
        Numbers that programs read from the page's element ``data``.
    advice : str
        A command below the verdict.

    Examples
    --------
    >>> from loopid.report import Page, Section
    >>> page = Page("My robot", (Section("Notes", ("It moves.",)),))
    >>> page.html()[:15]
    '<!DOCTYPE html>'
    """

    title: str
    sections: tuple[Section, ...]
    verdict: str = ""
    data: dict[str, Any] | None = None
    advice: str = ""

    def html(self) -> str:
        """The page as text."""
        own = files(__package__)
        style, script = ((own / name).read_text("utf-8") for name in ("page.css", "page.js"))
        title = one_line(self.title)
        head = E.head(
            E.meta(charset="utf-8"),
            E.meta({"http-equiv": "Content-Security-Policy", "content": POLICY}),
            E.meta(name="viewport", content="width=device-width, initial-scale=1"),
            E.meta(name="color-scheme", content="light dark"),
            E.title(title),
            E.style(style),
        )
        links = (E.a({"href": f"#{each.anchor}"}, one_line(each.title)) for each in self.sections)
        said = [E.p({"class": "verdict"}, one_line(self.verdict))] if self.verdict else []
        said += [E.pre(one_line(self.advice))] if self.advice else []
        body = E.body(
            E.header(E.h1(title), *said, E.nav(*links)),
            E.main(*(each.html() for each in self.sections)),
        )
        if self.data is not None:
            numbers = json.dumps(self.data).replace("<", r"\u003c")
            body.append(E.script({"id": "data", "type": "application/json"}, numbers))
        body.append(E.script(script))
        page = E.html({"lang": "en"}, head, body)
        return str(tostring(page, encoding="unicode", doctype="<!DOCTYPE html>")) + "\n"


class Report:
    """What a command found, for all ways of showing it; each command has a class of its own."""

    name: ClassVar[str]  # of its record's file

    @property
    def title(self) -> str:
        """Of the page."""
        raise NotImplementedError

    @property
    def verdict(self) -> str:
        """One sentence that comes first."""
        raise NotImplementedError

    @property
    def advice(self) -> str:
        """A command that does what the verdict advises; empty where there is none."""
        return ""

    def record(self) -> dict[str, Any]:
        """All findings in plain numbers, lists and texts."""
        raise NotImplementedError

    def brief(self) -> Sequence[Table]:
        """What the terminal shows below the verdict."""
        return ()

    def sections(self) -> Sequence[Section]:
        """What the page shows below the verdict."""
        raise NotImplementedError

    def results(self) -> dict[str, bytes | str]:
        """Files beside page and record, by name."""
        return {}

    @cached_property
    def data(self) -> dict[str, Any]:
        """The record with the verdict."""
        return {"schema": f"loopid {self.name} {VERSION}", "verdict": self.verdict, **self.record()}

    def tables(self) -> list[Table]:
        """All tables of the page."""
        return [part for each in self.sections() for part in each.parts if isinstance(part, Table)]

    def page(self, run: Run = NO_RUN) -> Page:
        """The page."""
        sections = (*self.sections(), *run.sections())
        return Page(self.title, sections, self.verdict, self.data, self.advice)

    def files(self, run: Run = NO_RUN, *, figures: bool = False) -> dict[str, bytes | str]:
        """Page, record, results, and figures for papers if asked for, by file name."""
        page = self.page(run)
        charts = [part for each in page.sections for part in each.parts if isinstance(part, Chart)]
        drawn = {n: c for chart in charts if figures for n, c in chart.files().items()}
        record = {f"{self.name}.json": json_text(self.data) + "\n"}
        return {"report.html": page.html(), **record, **self.results(), **drawn}


VERSION = 1  # of the records' form: see ``schema.py``
