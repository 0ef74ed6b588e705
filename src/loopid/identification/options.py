"""Options of an identification."""

from __future__ import annotations

from loopid.errors import OptionError
from loopid.identification.estimator import ESTIMATORS, Estimator
from loopid.identification.force_models import AUTOMATIC, ForceModel, chosen_terms
from loopid.identification.model_choice import require_model
from loopid.records import record
from loopid.regressors.joint_terms import require_kinds
from loopid.robot.robot import Robot
from loopid.workers import require_processes

# What is done about a combination of parameters that no force of the data depends on.
UNIDENTIFIABLE = ("error", "prior")


@record(kw_only=True, checked=True)
class FitOptions:
    """Options of ``identify``.

    Attributes
    ----------
    model : str
        Of a robot: ``"gravity"``, ``"full"``, or ``"auto"`` for the one that the data ask for
        (``choose_model``).
    terms : str
        Joint terms of a robot, as of ``JointTerms.of``; by default those of ``force_model``.
    estimator : str or Estimator
        A name of ``ESTIMATORS``, or an estimator with its own options. With ``"wls"`` the robot
        file is weighed, too (``consistent_fit``).
    unidentifiable : str
        Where no force of the training data depends on a combination of parameters: ``"prior"``: fit
        the others, and keep the robot file's values there; or ``"error"``.
    fraction : float, optional
        Of the samples of each recording in which a motor moves, between 0 and 1: the first ones
        are fitted, the rest judges. By default all are fitted, and each segment is judged by fits
        to the others.
    undo_delay : bool
        Whether a clear delay between forces and motion is undone in the logs (``find_delay``).
    n_jobs : int
        Processes that compute the regressors; the result is the same to the bit.

    Raises
    ------
    OptionError
        When an option is out of its range, or one is given that the estimator has no use for.

    Examples
    --------
    >>> import loopid
    >>> loopid.FitOptions(estimator="mean")
    Traceback (most recent call last):
    loopid.errors.OptionError: unknown estimator 'mean': choose among ols, wls, bisquare, iv
    """

    model: str = AUTOMATIC
    terms: str = AUTOMATIC
    estimator: str | Estimator = "wls"
    unidentifiable: str = "prior"
    fraction: float | None = None
    undo_delay: bool = True
    n_jobs: int = 1

    def __post_init__(self) -> None:
        require_model(self.model)
        require_kinds(self.terms, AUTOMATIC)
        if isinstance(self.estimator, str):
            OptionError.require("estimator", self.estimator, ESTIMATORS)
        OptionError.require("unidentifiable", self.unidentifiable, UNIDENTIFIABLE)
        if self.fraction is not None and not 0 < self.fraction < 1:
            raise OptionError(
                f"fraction must be between 0 and 1, not {self.fraction}", given=self.fraction
            )
        require_processes(self.n_jobs)

    def require_terms(self, robot: Robot | ForceModel) -> None:
        """Refuse joint terms that a robot cannot have, before any work is done.

        Raises
        ------
        OptionError
            Naming the joint or the word; when a force model, which has its own, comes with others.
        """
        if isinstance(robot, ForceModel):
            if (self.model, self.terms) != (AUTOMATIC, AUTOMATIC):
                raise OptionError(
                    "the force model that is given has a model and terms of its own: choose them "
                    "by force_model, or give the robot in its place"
                )
            return
        chosen_terms(robot, "full" if self.model == AUTOMATIC else self.model, self.terms)

    def require_references(self, count: int) -> None:
        """Refuse reference motions for another estimator than ``"iv"``, and that without any."""
        if (self.name == "iv") != bool(count):
            raise OptionError(
                "references must be commanded motions, one a recording, for estimator='iv' alone, "
                f"not {count} for {self.name!r}",
                given=count,
                estimator=self.name,
            )

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return self.estimator if isinstance(self.estimator, str) else self.estimator.name
