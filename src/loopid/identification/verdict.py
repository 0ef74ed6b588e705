"""A verdict on an identification: fit for what, how sure, and what would improve it most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from loopid.identification.plausibility import absurdities
from loopid.identification.result import FitResult
from loopid.records import record
from loopid.regressors.joint_laws import grouped

if TYPE_CHECKING:
    from loopid.identification.pipeline import Identification

# Error on new data as a part of a motor's force, in the root mean square: what a controller's
# feedforward can be built on, and what it still profits from.
GOOD, ROUGH = 0.1, 0.3
NAMED = 1  # parameters that the sentence names


@record
class Verdict:
    """What an identification is good for; printed, it is one sentence.

    Attributes
    ----------
    use : str
        What the recommended fit is fit for.
    motor : str
        Whose force is predicted worst.
    error : float
        Of that motor on new data, in parts of its force, in the root mean square.
    ratio : tuple of float
        Mean squared error of the recommended fit on new data over that of the robot file with
        fitted joint terms, the geometric mean over the motors, and its standard error.
    judged : str
        On what: ``"stretches"`` that were left out one by one, ``"logs"`` left out, or
        ``"validation"`` data.
    band : float or None
        In Hz, below which forces were fitted and judged; None without a filter.
    better : str
        What it says that other values predict clearly better; empty where none do.
    significant, parameters : int
        Parameters of the recommended fit, and how many of them clearly differ from zero.
    excite : tuple of str
        Parameters that a further motion should excite: ``design_excitation(model,
        parameters=verdict.excite, after=recordings)``.
    improvement : str
        What would improve the fit most.
    """

    use: str
    motor: str
    error: float
    ratio: tuple[float, float]
    judged: str
    band: float | None
    better: str
    significant: int
    parameters: int
    excite: tuple[str, ...]
    improvement: str

    @classmethod
    def of(cls, found: Identification) -> Verdict:
        """Of an identification."""
        new, quality = found.new, found.recommended.validation
        squares = np.array(new.problem.force_squares()) / np.maximum(quality.samples, 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.where(squares > 0, quality.residual_rms / np.sqrt(squares), np.nan)
        worst = 0 if np.isnan(errors).all() else int(np.nanargmax(errors))
        count = sum(not grouped(each.kind) for each in found.fit.parameters)
        significant = count - len(_insignificant(found.fit))
        better = _better(found)
        excite = () if better else found.identifiability.leads or _least_known(found)
        improvement = f"exciting {_listed(excite)}" if excite else "a longer log"
        left_out = "logs" if len(found.training) > 1 else "stretches"
        return cls(
            _use(found, float(errors[worst])),
            new.actuators[worst],
            float(errors[worst]),
            found.recommended.error_ratio,
            "validation" if found.validation else left_out,
            found.training[0].cutoff,
            better,
            significant,
            count,
            excite,
            "mending the file or the log" if better else improvement,
        )

    def __str__(self) -> str:
        band = "" if self.band is None else f" below {self.band:.3g} Hz"
        return (
            f"{self.use}: {self.better}{JUDGED[self.judged]}{band} errors are at most "
            f"{100 * self.error:.2g} % of a motor's force ({self.motor}){self._beside_file}, and "
            f"{self.significant} of {self.parameters} values differ clearly from zero; "
            f"{self.improvement} would improve it most."
        )

    @property
    def _beside_file(self) -> str:
        """Errors beside those of the robot file, to first order; empty for the robot file's."""
        ratio, error = self.ratio
        if ratio == 1 or not np.isfinite(ratio):
            return ""
        below, root = ratio < 1, np.sqrt(ratio)
        size = 100 * abs(1 - root)
        spread = f" ± {50 * error / root:.0f}" if np.isfinite(error) else ""
        side = "below" if below else "above"
        return f", over all motors {size:.0f}{spread} % {side} those with the file's bodies"


# What judged, in words.
JUDGED = {
    "stretches": "on stretches left out of the fit",
    "logs": "on logs left out of the fit",
    "validation": "on new data",
}


def _better(found: Identification) -> str:
    """What it says that all parameters predict clearly better; empty where they do not."""
    times = found.advantage
    if times is None:
        return ""
    return (
        f"all parameters predict {times:.2g} times better than any robot with solid bodies and "
        "friction that dissipates, so that a sign, a zero or a length of the file is wrong; "
    )


def _use(found: Identification, error: float) -> str:
    broken = absurdities(found.force_model, found.fit, found.data)
    if broken:
        return f"Not fit for use, as {broken[0]}"
    if not error <= ROUGH:
        return "Not fit for use"
    use = "Fit for predicting forces" if error <= GOOD else "Fit for rough predictions of forces"
    if found.recommended is found.baseline:
        return f"{use} with the robot file's bodies, as fitted ones are clearly worse"
    told, deviation = found.identifiability, found.fit.deviation
    doubtful = found.advantage is not None or (deviation is not None and deviation.suspicion)
    if error <= GOOD and told.well_determined == told.structural_rank and not doubtful:
        return f"{use} and as parameters of the robot"
    return f"{use} in motions like these, but not parameter by parameter"


def _least_known(found: Identification) -> tuple[str, ...]:
    """Parameters whose estimates are not clear from zero, the least known first."""
    alone = found.recommended is found.baseline  # of the bodies it has no estimates
    fit = found["all parameters"].fit if alone else found.fit
    weak, order = set(_insignificant(fit)), np.argsort(-fit.relative_std, kind="stable")
    return tuple(name for j in order if (name := fit.parameters.labels[j]) in weak)


def _insignificant(fit: FitResult) -> tuple[str, ...]:
    """Names of parameters not clearly different from zero; points of a curve are none."""
    kinds = {each.label: each.kind for each in fit.parameters}
    return tuple(name for name in fit.insignificant() if not grouped(kinds[name]))


def _listed(names: Sequence[str]) -> str:
    more = len(names) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")
