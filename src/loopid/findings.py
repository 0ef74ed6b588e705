"""Findings: what a user should know beside the numbers, and what to do about it.

A finding is made once, where the reason is found. Commands, Python, JSON, pages and notebooks show
the same record.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from loopid.errors import DataWarning, warn
from loopid.records import record

# The most important first. A mistake spoils all figures.
SEVERITIES = ("mistake", "warning", "note")
PAGE = "docs/not_fit.md"  # what to look at, by symptom
Severity = Literal["mistake", "warning", "note"]
# Probability that a user is told of what is chance, of each kind of test: of those that are made
# together by Bonferroni. Logarithm of how much likelier, twenty times, a finding makes the data.
FALSE_ALARM, EVIDENCE = 0.01, 3.0


@record(checked="outside")
class Finding:
    """One thing to know.

    Attributes
    ----------
    severity : str
        ``"mistake"``: the data or the robot file are wrong, and no figure counts before that is
        mended; ``"warning"``: the result is worse for it; ``"note"``: nothing is wrong.
    title : str
        What was found, in a few words that begin small and end without a period.
    why : str
        The evidence, in numbers; empty where the title says it all.
    do : str
        What to do, such that it can be typed; empty where there is nothing to do.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.findings.Finding(
    ...     "warning", "motors disagree", "2.35 to 2.62 kg", "find their gains: known_mass=2.8"
    ... )
    >>> print(found)
    motors disagree: 2.35 to 2.62 kg; find their gains: known_mass=2.8
    """

    severity: Severity
    title: str
    why: str = ""
    do: str = ""

    def __str__(self) -> str:
        why, do = f": {self.why}" * bool(self.why), f"; {self.do}" * bool(self.do)
        return f"{self.title}{why}{do}"

    @property
    def brief(self) -> str:
        """Without the evidence, for a terminal."""
        return f"{self.title}{f'; {self.do}' * bool(self.do)}"

    @property
    def veto(self) -> str:
        """The verdict on all that a mistake spoils."""
        return (
            f"Not fit for use: {self.title} ({self.why}). First {self.do}; no figure counts before "
            f"({PAGE})."
        )

    def warn(self) -> None:
        """Warn of it, unless it is a note."""
        if self.severity != "note":
            warn(str(self), DataWarning)


class WithFindings:
    """What has ``findings``, and can tell them as warnings."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What to know of it."""
        raise NotImplementedError

    def warn(self) -> None:
        """Warn of each that is no note."""
        for each in self.findings:
            each.warn()


def most_important_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings by severity, each once, as of the first log that has it; equal ones keep order."""
    once = dict[tuple[str, ...], Finding]()
    for found in findings:
        once.setdefault((found.severity, found.title, found.do), found)
    return tuple(sorted(once.values(), key=lambda found: SEVERITIES.index(found.severity)))
