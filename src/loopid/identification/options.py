"""How an identification is done: one record of options that checks itself."""

from __future__ import annotations

import numpy as np

from loopid.errors import OptionError
from loopid.identification.estimator import ESTIMATORS, Estimator
from loopid.records import record
from loopid.workers import require_processes

# What is done about a combination of parameters that no force of the data depends on.
UNIDENTIFIABLE = ("error", "prior")


@record(kw_only=True, checked=True)
class FitOptions:
    """Options of ``identify``.

    Attributes
    ----------
    estimator : str or Estimator
        A name of ``ESTIMATORS``, or an estimator with its own options. ``"bayes"`` takes the robot
        file as its prior.
    unidentifiable : str
        Where no force of the training data depends on a combination of parameters: ``"error"``, or
        ``"prior"``: fit the others, and keep the robot file's values there.
    fraction : float
        Of the samples of each recording in which a motor moves, between 0 and 1: the first ones
        are fitted, the rest judges.
    prior_deviation : float, optional
        For ``"bayes"``: standard deviation of the robot file's parameters, relative to their sizes
        (``cad_prior``); by default 0.3.
    deviations : tuple of float
        Without that: the least and the largest such deviation that the evidence of the data may
        choose. A file that is right in most of its bodies need not be in all, so that the least is
        not 0.
    n_jobs : int
        Processes that compute the regressors; the result is the same to the bit.

    Raises
    ------
    OptionError
        When an option is out of its range, or one is given that the estimator has no use for.

    Examples
    --------
    >>> import loopid
    >>> loopid.FitOptions(estimator="wsl")
    Traceback (most recent call last):
    loopid.errors.OptionError: unknown estimator 'wsl': choose one of ols, wls, bisquare, iv, bayes
    """

    estimator: str | Estimator = "wls"
    unidentifiable: str = "error"
    fraction: float = 0.6
    prior_deviation: float | None = None
    deviations: tuple[float, float] = (0.1, 10.0)
    n_jobs: int = 1

    def __post_init__(self) -> None:
        if isinstance(self.estimator, str) and self.estimator not in ESTIMATORS:
            raise OptionError.unknown("estimator", self.estimator, ESTIMATORS)
        if self.unidentifiable not in UNIDENTIFIABLE:
            raise OptionError.unknown("unidentifiable", self.unidentifiable, UNIDENTIFIABLE)
        if not 0 < self.fraction < 1:
            raise OptionError(
                f"fraction must be between 0 and 1, not {self.fraction}", given=self.fraction
            )
        least, largest = self.deviations
        if not 0 < least < largest < np.inf:
            raise OptionError(
                f"deviations must be two that ascend from above 0, not {self.deviations}",
                given=self.deviations,
            )
        if self.prior_deviation is not None and self.estimator != "bayes":
            raise OptionError(
                "prior_deviation is of the robot file as prior: it goes with estimator='bayes', "
                f"not with {self.estimator!r}",
                given=self.estimator,
            )
        require_processes(self.n_jobs, "n_jobs")

    def require_references(self, count: int) -> None:
        """Refuse reference motions for another estimator than ``"iv"``, and that without any."""
        if (self.name == "iv") != bool(count):
            raise OptionError(
                f"references are for estimator='iv', which needs them: {count} motions do not go "
                f"with {self.name!r}",
                given=count,
                estimator=self.name,
            )

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return self.estimator if isinstance(self.estimator, str) else self.estimator.name

    @property
    def keeps_robot_file(self) -> bool:
        """Whether the robot file's values are kept where the data tell nothing."""
        return self.unidentifiable == "prior"

    @property
    def weighs_robot_file(self) -> bool:
        """Whether the robot file counts as prior beside the fit: by default, with ``"wls"``."""
        return self.name == "wls"

    @property
    def estimator_beside(self) -> str | Estimator:
        """The estimator without a prior: weighted least squares stands in for Bayes."""
        return "wls" if self.name == "bayes" else self.estimator
