"""Whether fits of two logs of one robot agree: a test of intervals without any truth.

Logs are independent, so that the variance of a difference is the sum of both variances. What is
known of it has the degrees of freedom of [Welch1947]. The robot file, which both fits may weigh,
draws them together. They then agree more often than intervals promise.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.special import stdtr

from loopid.arguments import FloatArray, checked
from loopid.errors import DataError
from loopid.findings import FALSE_ALARM
from loopid.identification.identification import Identification
from loopid.identification.result import VALUES, Fit
from loopid.numbers import NORMAL_95
from loopid.records import Tabular, record


@record
class Agreement(Tabular):
    """Differences between the base parameters that two fits have in common.

    Attributes
    ----------
    expressions : tuple of str
        Of the k base parameters.
    differences : FloatArray
        (k,), the second fit's less the first one's.
    standard_errors : FloatArray
        (k,), of the differences.
    degrees_of_freedom : FloatArray
        (k,).
    others : int
        Parameters that one fit alone has, or that rest on the robot file in one.
    """

    expressions: tuple[str, ...]
    differences: FloatArray
    standard_errors: FloatArray
    degrees_of_freedom: FloatArray
    others: int

    def _table(self) -> dict[str, object]:
        return {
            "parameter": self.expressions,
            "difference": self.differences,
            "standard_error": self.standard_errors,
            "apart": self.apart,
        }

    @cached_property
    def apart(self) -> FloatArray:
        """Sizes (k,) of the differences in their standard errors; infinite for exact fits."""
        sizes = np.abs(self.differences)
        none = np.where(sizes > 0, np.inf, 0.0)
        np.divide(sizes, self.standard_errors, out=none, where=self.standard_errors > 0)
        return none

    @property
    def usual(self) -> float:
        """Part of the differences that are below 1.96 standard errors: 0.95 on average."""
        return float((self.apart < NORMAL_95).mean()) if len(self.apart) else 1.0

    @property
    def clear(self) -> tuple[str, ...]:
        """Parameters that clearly differ, the farthest first."""
        freedom = np.maximum(self.degrees_of_freedom, 1.0)
        chance = 2 * stdtr(freedom, -self.apart)
        order = np.argsort(-self.apart, kind="stable")
        bound = FALSE_ALARM / max(len(chance), 1)
        return tuple(self.expressions[k] for k in order if chance[k] < bound)

    def __str__(self) -> str:
        count = len(self.expressions)
        if not count:
            return "They have no parameters in common."
        worst, word = int(self.apart.argmax()), "disagree" if self.clear else "agree"
        return (
            f"They {word}: {100 * self.usual:.0f} % of {count} differences are below 1.96 standard "
            f"errors (95 % by chance), the largest is {self.apart[worst]:.2g} "
            f"({self.expressions[worst]})."
        )


@checked
def compare_fits(first: Fit | Identification, second: Fit | Identification) -> Agreement:
    """Compare fits of two logs of one robot, by what their errors let them differ.

    Parameters
    ----------
    first, second : Fit or Identification
        Of an identification, its fit.

    Returns
    -------
    Agreement
        Differences of the parameters, in their standard errors.

    Raises
    ------
    DataError
        When they are of different robots or models, or a fit is of values without any errors.

    Examples
    --------
    Two logs of one five-bar, the second with other noise:

    >>> import loopid
    >>> from loopid.identification.fitting import quiet_fit
    >>> robot = loopid.load("five_bar")
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> parts = loopid.identification.split_recordings([run], 0.5)
    >>> fits = [quiet_fit(model.samples(part)) for (part,) in parts]
    >>> found = loopid.diagnosis.compare_fits(*fits)
    >>> len(found.expressions), found.usual > 0.7
    (15, True)
    """
    first, second = (
        each.fit if isinstance(each, Identification) else each for each in (first, second)
    )
    if VALUES in (first.estimator, second.estimator):
        raise DataError("fits of values alone have no errors that they could agree within")
    kinds = [fit.model and fit.model.model for fit in (first, second)]
    for what, one, other in (
        ("robots", first.actuators, second.actuators),
        ("models", kinds[0] or kinds[1], kinds[1] or kinds[0]),
    ):
        if one != other:
            raise DataError(f"fits of different {what} cannot agree: {one} and {other}")
    known = [_known(fit) for fit in (first, second)]
    common = [each for each in known[0] if each in known[1]]
    rows = np.array([[fit[each] for each in common] for fit in known]).reshape(2, -1, 3)
    (values, variances, freedom) = np.moveaxis(rows, 2, 0)
    total = variances.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        together = total**2 / (variances**2 / freedom).sum(axis=0)
    return Agreement(
        expressions=tuple(common),
        differences=values[1] - values[0],
        standard_errors=np.sqrt(total),
        degrees_of_freedom=np.where(np.isfinite(together), together, np.inf),
        others=sum(len(fit) - len(common) for fit in known),
    )


def _known(fit: Fit) -> dict[str, tuple[float, float, float]]:
    """Value, variance and degrees of freedom of what the data of a fit determine, by its sum."""
    return {
        each.expression: (each.value, each.standard_error**2, float(own))
        for each, own in zip(fit.estimates, fit.degrees_of_freedom, strict=True)
        if each.name not in fit.assumed and np.isfinite(each.standard_error)
    }
