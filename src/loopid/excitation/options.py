"""How a motion is designed: its kind, what is optimised, and the effort."""

from __future__ import annotations

from collections.abc import Mapping

from loopid.errors import OptionError
from loopid.excitation.criteria import CRITERIA
from loopid.excitation.shapes import SHAPES
from loopid.records import record

MOST_SIZE = 500  # time and memory grow with its square
COORDINATES = ("joints", "platform")
SOLVERS = {
    "ipopt": "loopid.excitation.solvers:by_ipopt",
    "slsqp": "loopid.excitation.solvers:by_slsqp",
}


@record(kw_only=True, checked=True)
class DesignOptions:
    """How a motion is designed.

    Attributes
    ----------
    criterion : str
        ``"D"``, ``"A"``, ``"E"`` or ``"condition"`` (``Criteria``).
    shape : str
        ``"fourier"``, ``"spline"``, or ``"poses"`` to stand in, for a gravity model.
    size : int, optional
        Harmonics, waypoints or poses; by default 6, 10, or twice as many forces as parameters.
    duration : float, optional
        In s; by default 20 for a gravity model, 10 for a full one.
    rate : float
        Samples per second of the run.
    coordinates : str
        ``"joints"``, or ``"platform"`` for the platform coordinates.
    noise : float or mapping, optional
        Standard deviation of each motor's force in N or N m at the rate of the run, one for all or
        by joint (``"all"``: the others); by default that of the logs, or 1.
    starts : int
        Random motions to begin with, one after the other; the best result counts.
    evaluations : int
        Of the criterion and the bounds in all, shared by the starts. More never give a worse
        motion.
    time_limit : float, optional
        In s. It only stops: what is found until then does not depend on it.
    inset : float
        Part of each bound's range, or of its size, that is kept free on the grid of the design,
        for what happens between its samples.
    solver : str, optional
        ``"ipopt"`` or ``"slsqp"``; by default IPOPT where it is installed.
    seed : int
        Of the random motions.

    Raises
    ------
    OptionError
        When a field is none of what it may be.

    Examples
    --------
    >>> import loopid
    >>> loopid.DesignOptions(duration=6.0, starts=1).evaluations
    400
    """

    criterion: str = "D"
    shape: str = "fourier"
    size: int | None = None
    duration: float | None = None
    rate: float = 100.0
    coordinates: str = "joints"
    noise: float | Mapping[str, float] | None = None
    starts: int = 4
    evaluations: int = 400
    time_limit: float | None = None
    inset: float = 0.01
    solver: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        for what, given, choices in (
            ("criterion", self.criterion, CRITERIA),
            ("shape", self.shape, SHAPES),
            ("coordinates", self.coordinates, COORDINATES),
            ("solver", self.solver or "slsqp", SOLVERS),
        ):
            if given not in choices:
                raise OptionError.unknown(what, given, choices)
        noise = self.noise if isinstance(self.noise, Mapping) else {"all": self.noise}
        size = 2 if self.size is None else self.size
        for name, value, valid, words in (
            ("size", size, 2 <= size <= MOST_SIZE, f"from 2 to {MOST_SIZE}"),
            ("starts", self.starts, self.starts >= 1, "1 at least"),
            ("evaluations", self.evaluations, self.evaluations >= 0, "0 at least"),
            ("seed", self.seed, self.seed >= 0, "0 at least"),
            ("duration", self.duration, _positive(self.duration), "above 0 s"),
            ("rate", self.rate, _positive(self.rate), "above 0 Hz"),
            ("time_limit", self.time_limit, _positive(self.time_limit), "above 0 s"),
            ("inset", self.inset, 0 <= self.inset < 0.5, "a part below a half"),
            ("noise", self.noise, all(map(_positive, noise.values())), "above 0"),
        ):
            if not valid:
                raise OptionError(
                    f"{name} must be {words}, not {value}", argument=name, given=value
                )


def _positive(value: float | None) -> bool:
    return value is None or value > 0
