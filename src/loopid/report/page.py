"""Reports: a card, findings, sections and a record; shown in the terminal, or as one page of HTML.

A page opens without a network: style, script and numbers are in it. One of your own is
``Page("title", sections)``, with sections of a report and others.
"""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from importlib.metadata import version
from importlib.resources import files
from textwrap import shorten
from typing import Any, Literal

from lxml.etree import _Element as Element, tostring
from rich.table import Table

from loopid.arguments import Number
from loopid.errors import counted
from loopid.findings import Finding, most_important_first
from loopid.plots.chart import Chart, E, Panel, in_parts, short_or_whole, unfolding
from loopid.records import json_value, record
from loopid.report.look import json_text, plain_table, rounded

LIBRARIES = "loopid", "pin", "numpy", "scipy"
VERSION = 1  # of the records' forms, which ``schema.py`` states: a new one where programs notice
# What a browser is allowed: nothing from elsewhere.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
Tone = Literal["good", "rough", "bad", "info"]
MARKS = {"good": "✓ ", "rough": "≈ ", "bad": "✗ ", "info": ""}  # no status by colour alone
TONES: dict[str, Tone] = {"mistake": "bad", "warning": "rough", "note": "info"}  # of findings
SIGNS = {"mistake": "✗ ", "warning": "! ", "note": ""}
COMMAND = ": loopid "  # after what it does
TWO_LINES = 200  # letters of a finding that are seen at first
LONG = 40  # letters of a cell that breaks
DECADES = 3  # of a gauge, which ends at 100 %


Part = str | Table | Chart | Element


@record(checked="outside")
class Section:
    """A title, and what stands below it.

    Examples
    --------
    >>> import loopid
    >>> chart = loopid.plots.robot_chart(loopid.load("five_bar"))
    >>> loopid.report.Section("The robot", (chart,)).title
    'The robot'
    """

    title: str
    parts: tuple[Part, ...]  # paragraphs, tables, charts and elements
    folded: bool = False  # only the titles of its tables are seen at first
    lead: str = ""  # what it says, in a sentence
    short: str = ""  # its name in the page's bar, by default the title

    @property
    def anchor(self) -> str:
        """Its address on the page."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())

    def html(self) -> Element:
        """A section of a page."""
        parts = (_part(part, self.folded) for part in self.parts)
        lead = [E.p({"class": "lead"}, self.lead)] if self.lead else []
        return E.section({"id": self.anchor}, E.h2(self.title), *lead, *parts)


def _part(part: Part, folded: bool) -> Element:
    if isinstance(part, Chart):
        return part.html()
    if not isinstance(part, Table):
        return E.p(part) if isinstance(part, str) else part
    # Rows beyond the first ones unfold.
    found = E.div(*in_parts(part.row_count, lambda rows: _table(part, rows)))
    if folded:
        found = unfolding(str(part.title or "table"), found)
        found[0].append(E.small(f" {counted(part.row_count, 'row')}"))
    return found


def _table(table: Table, some: range) -> Element:
    sides = [{"class": "number"} if column.justify == "right" else {} for column in table.columns]
    rows = list(zip(*(column.cells for column in table.columns), strict=True))
    found = E.table(E.tbody())
    for row in rows[some.start : some.stop]:
        cells = zip(sides, map(str, row), strict=True)
        long = {"class": "long"}
        found[0].append(
            E.tr(*(E.td(long if len(text) > LONG else side, text) for side, text in cells))
        )
    if table.show_header:
        heads = zip(sides, (str(column.header) for column in table.columns), strict=True)
        found.insert(
            0, E.thead(E.tr(*(E.th({"scope": "col"}, side, text) for side, text in heads)))
        )
    if table.title:
        found.insert(0, E.caption(str(table.title)))
    note = [E.p({"class": "note"}, str(table.caption))] if table.caption else []
    return E.div({"class": "table", "tabindex": "0"}, found, *note)


@record(checked="outside")
class Figure:
    """A number that a page shows first.

    Examples
    --------
    >>> import loopid
    >>> loopid.report.Figure("0.4 %", "of its force").value
    '0.4 %'
    """

    value: str
    what: str  # that it is
    more: str = ""  # small beside it
    gauge: tuple[Number, ...] = ()  # an error, and up to which it is good and rough, in parts of 1
    sure: bool = True  # whether it counts

    def html(self) -> Element:
        """A part of a card."""
        more = [E.small(f" {self.more}")] if self.more else []
        gauge = [self._gauge()] if self.gauge else []
        number = E.dd(self.value, *more, *gauge)
        return E.div({"class": "" if self.sure else "unsure"}, E.dt(self.what), number)

    def _gauge(self) -> Element:
        at, good, rough = (
            f"{100 * min(max(1 + math.log10(max(x, 1e-9)) / DECADES, 0.0), 1.0):.0f}%"
            for x in self.gauge
        )
        return E.span(
            {"class": "gauge", "style": f"--Good:{good};--Rough:{rough}"},
            E.b({"style": f"left:{at}"}),
            E.small({"style": f"left:{good}"}, f"{100 * self.gauge[1]:.3g}"),
            E.small({"style": f"left:{rough}"}, f"{100 * self.gauge[2]:.3g} %"),
        )


@record(kw_only=True, checked="outside")
class Card:
    """What a page says first: a word, for what, and what to do next.

    Examples
    --------
    >>> import loopid
    >>> loopid.report.Card(tone="good", word="Fit", use="for predicting forces").said
    '✓ Fit'
    """

    tone: Tone = "info"
    word: str = ""  # such as "Fit"
    use: str = ""  # such as "for predicting forces"
    chips: tuple[tuple[Tone, str], ...] = ()  # uses with a tone each
    figures: tuple[Figure, ...] = ()
    next: str = ""  # the next step
    command: str = ""  # that does it

    @property
    def said(self) -> str:
        """The word with its sign."""
        return f"{MARKS[self.tone]}{self.word}"

    def html(self) -> Element:
        """The first part of a page."""
        card = E.div({"class": f"card {self.tone}"})
        word = [E.strong(self.said)] if self.word else []
        card.append(E.p({"class": "word"}, *word, E.span(f" {self.use}")))
        chips = (E.li({"class": tone}, f"{MARKS[tone]}{text}") for tone, text in self.chips)
        card.extend([E.ul({"class": "chips"}, *chips)] if self.chips else [])
        figures = (each.html() for each in self.figures)
        card.extend([E.dl({"class": "figures"}, *figures)] if self.figures else [])
        if self.next:
            command = [unfolding("Show the command", E.pre(self.command))] if self.command else []
            card.append(E.div({"class": "next"}, E.p(E.b("Next: "), self.next), *command))
        return card


def findings_html(findings: Sequence[Finding], checks: Sequence[tuple[bool, str]]) -> Element:
    """Mistakes and warnings with what to do, notes folded, checks in one line."""
    serious, notes, passed = E.ol({"class": "findings"}), E.div({"class": "notes"}), list[Any]()
    for each in findings:
        title, kind = _sentence(each.title), f"{SIGNS[each.severity]}{each.severity.capitalize()}"
        why, (do, *command) = _sentence(each.why, "."), each.do.split(COMMAND)
        brief = short_or_whole(shorten(why, TWO_LINES, placeholder=" ..."), why)
        said = [E.div({"class": "why"}, brief)] if why else []
        said += [E.p(E.b("Do: "), _sentence(do, "."))] if do else []
        said += [unfolding("Show the command", E.pre(f"loopid {text}")) for text in command]
        if each.severity == "note":
            notes.append(unfolding(title, *said))
        else:
            kind_ = E.span({"class": "kind"}, kind)
            serious.append(E.li({"class": TONES[each.severity]}, kind_, E.div(E.h3(title), *said)))
    for good, text in checks:
        tone, sign = ("good", "✓") if good else ("rough", "!")
        passed.append(E.li({"class": tone}, f"{sign} {text}"))
    shown = (each for each in (serious, notes, E.ul({"class": "checks"}, *passed)) if len(each))
    return E.section({"id": "findings"}, E.h2("Findings, most important first"), *shown)


def _sentence(text: str, end: str = "") -> str:
    """The text as a sentence; a name that it begins with stays as it is."""
    end = end * bool(text and text[-1] != ".")
    word = text.split(" ")[0].strip(",:")
    return f"{text[:1].upper()}{text[1:]}{end}" if word.isalpha() else text + end


@record(checked="outside")
class Page:
    """One file of HTML.

    Examples
    --------
    >>> from loopid.report import Page, Section
    >>> page = Page("My robot", (Section("Notes", ("It moves.",)),))
    >>> page.html()[:15]
    '<!DOCTYPE html>'
    """

    title: str
    sections: tuple[Section, ...]
    under: str = ""  # what it is of, below the title
    card: Card | None = None
    pictures: tuple[Chart, ...] = ()  # beside the card, and below both
    findings: Element | None = None  # before the sections
    data: dict[str, Any] | None = None  # its element "data" has it to six digits, for programs

    def html(self) -> str:
        """The page as text."""
        own = files(__package__)
        style, script = ((own / name).read_text("utf-8") for name in ("page.css", "page.js"))
        head = E.head(
            E.meta(charset="utf-8"),
            E.meta({"http-equiv": "Content-Security-Policy", "content": POLICY}),
            E.meta(name="viewport", content="width=device-width, initial-scale=1"),
            E.meta(name="color-scheme", content="light dark"),
            E.title(self.title),
            E.style(style),
        )
        main = E.main(*([] if self.findings is None else [self.findings]))
        main.extend(each.html() for each in self.sections)
        body = E.body(self._header(), self._bar(), main)
        if self.data is not None:
            numbers = json.dumps(rounded(self.data), separators=(",", ":")).replace("<", r"\u003c")
            body.append(E.script({"id": "data", "type": "application/json"}, numbers))
        body.append(E.script(script))
        page = E.html({"lang": "en"}, head, body)
        whole = tostring(page, encoding="unicode", method="html", doctype="<!DOCTYPE html>")
        return f"{whole}\n"

    def _header(self) -> Element:
        under = [E.p({"class": "under"}, self.under)] if self.under else []
        first = [each.html() for each in (self.card, *self.pictures) if each is not None]
        return E.header(E.h1(self.title), *under, E.div({"class": "first"}, *first))

    def _bar(self) -> Element:
        links = [
            E.a({"href": f"#{each.anchor}"}, each.short or each.title) for each in self.sections
        ]
        if self.findings is not None:
            links.insert(0, E.a({"href": "#findings"}, "Findings"))
        if self.card is not None and self.card.word:
            links.insert(0, E.b({"class": self.card.tone}, self.card.said))
        return E.nav(E.div(*links))


@record(kw_only=True, checked="outside")
class Report:
    """What a command found, for all ways of showing it; what is drawn is made when it is shown.

    Examples
    --------
    >>> import loopid
    >>> report = loopid.report.check_report(loopid.load("five_bar"))
    >>> report.name, report.card.said
    ('check', '✓ Ready')
    """

    name: str  # of the record's form, and of its file
    title: str
    verdict: str  # which comes first
    record: Callable[[], dict[str, Any]]  # all findings, as ``json_value`` takes them
    brief: Sequence[Table]  # what the terminal shows below the verdict
    sections: Callable[[], Sequence[Section]]  # of the page
    card: Card
    # More files of the record, by name.
    results: Callable[[dict[str, Any]], dict[str, bytes | str]] = lambda _: {}
    advice: str = ""  # a command that does what the verdict advises
    pictures: Callable[[], Sequence[Chart]] = tuple  # beside the card, and below both
    under: str = ""  # what it is of, below the title of the page
    findings: Sequence[Finding] = ()  # what to know beside the numbers
    checks: Sequence[tuple[bool, str]] = ()  # whether what was checked passed
    beside: tuple[str, ...] = ()  # keys of the record that the page lacks, as they are large

    def __post_init__(self) -> None:
        object.__setattr__(self, "findings", most_important_first(self.findings))

    @cached_property
    def data(self) -> dict[str, Any]:
        """The record with its form and the verdict."""
        said = {
            "verdict": self.verdict,
            "advice": self.advice,
            "findings": self.findings,
            "checks": [{"passed": good, "what": text} for good, text in self.checks],
        }
        known: dict[str, Any] = json_value(said | self.record())
        return {"schema": f"loopid {self.name} {VERSION}", **known}

    def tables(self) -> list[Table]:
        """All tables of the page, those with pictures among them."""
        parts = [part for each in self.sections() for part in each.parts]
        panels = (p for part in parts if isinstance(part, Chart) for p in part.panels if p.columns)
        return [*map(panel_table, panels), *(part for part in parts if isinstance(part, Table))]

    def page(self, command: str = "") -> Page:
        """The page, with the command line that reproduces it."""
        findings = None
        if self.findings or self.checks:
            findings = findings_html(self.findings, self.checks)
        data = {key: value for key, value in self.data.items() if key not in self.beside}
        versions = {name: version(name) for name in LIBRARIES} | {
            "Python": platform.python_version()
        }
        used = ", ".join(f"{name} {which}" for name, which in versions.items())
        parts: list[Part] = [E.pre(command)] if command else []
        parts.append(f"{used}; {platform.system()} {platform.machine()}")
        run = Section("To reproduce this run", tuple(parts), short="Reproduce")
        sections, pictures = (*self.sections(), run), tuple(self.pictures())
        return Page(self.title, sections, self.under, self.card, pictures, findings, data)

    def files(self, command: str = "", *, figures: bool = False) -> dict[str, bytes | str]:
        """Page, record, results, and figures for papers if required, by file name."""
        page = self.page(command)
        parts = (*page.pictures, *(part for each in page.sections for part in each.parts))
        charts = [part for part in parts if isinstance(part, Chart)]
        drawn = dict[str, bytes | str]()
        for chart in charts if figures else ():
            drawn[f"{chart.name}.svg"] = svg = chart.svg()
            with suppress(ImportError, OSError):  # without CairoSVG, or without the library cairo
                from cairosvg import svg2pdf

                drawn[f"{chart.name}.pdf"] = svg2pdf(svg.encode())
        record = {f"{self.name}.json": json_text(self.data) + "\n"}
        return {"report.html": page.html(), **record, **self.results(self.data), **drawn}


def panel_table(panel: Panel) -> Table:
    """The texts of a table with pictures."""
    title = panel.title or panel.motor
    columns = ("", *(f">{name}" for name in panel.columns))
    return plain_table(title, columns, zip(panel.labels, *panel.columns.values(), strict=True))
