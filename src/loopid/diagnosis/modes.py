"""Assembly modes compared: whether as many base parameters can be known in each."""

from __future__ import annotations

from contextlib import suppress
from math import ceil

from loopid.arguments import checked
from loopid.base_parameters.structure import analyse
from loopid.errors import LoopidError, ModelWarning, warn
from loopid.kinematics.freedoms import closed_at
from loopid.kinematics.sampling import SamplingOptions
from loopid.records import record
from loopid.regressors.structural import LEAST_SAMPLES, structural_observation
from loopid.robot.robot import AssemblyMode, Robot

ROWS_PER_COLUMN = 1.5  # of observations for a rank alone
# Parts of the limits that poses are from: all, as for base parameters; less where these do not
# close, or show no gap.
SPREADS = (1.0, 0.05)
LARGEST = 600  # parameters of a robot whose modes are compared


@record
class ModeComparison:
    """Assembly modes of a robot, its own first, and what can be known in each."""

    modes: tuple[AssemblyMode, ...]
    # Number of base parameters of the full model in each mode; None where it is not clear
    ranks: tuple[int | None, ...]

    @property
    def alike(self) -> bool:
        """Whether the number is clear and the same in all modes."""
        return len({*self.ranks}) <= 1 and None not in self.ranks


@checked
def compare_modes(robot: Robot) -> ModeComparison:
    """Count the base parameters of the full model in each assembly mode of a robot.

    There are modes where the drawn pose is singular or open, and so leaves a choice. To choose
    another, give its ``reference`` in the YAML.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    ModeComparison
        Empty where there is nothing to choose.

    Warns
    -----
    ModelWarning
        Where the numbers differ, or one is not clear.

    Examples
    --------
    >>> import loopid
    >>> loopid.diagnosis.compare_modes(loopid.load("five_bar"))
    ModeComparison(modes=(), ranks=())
    """
    found = ModeComparison(robot.modes, tuple(_rank(robot, mode) for mode in robot.modes))
    if not found.alike:
        listed = ", ".join(f"{rank or '?'} in mode {k}" for k, rank in enumerate(found.ranks, 1))
        differ = "may differ" if None in found.ranks else "differ"
        warn(
            f"{robot.source}: the drawn pose leaves {len(found.modes)} assembly modes, mode 1 "
            f"is used, and their numbers of base parameters {differ} (full model): {listed}; to "
            "choose another, put its 'reference' into the YAML",
            ModelWarning,
        )
    return found


def _rank(robot: Robot, mode: AssemblyMode) -> int | None:
    """Number of base parameters of the full model in a mode; None where it is not clear."""
    if len(robot.parameters()) > LARGEST:
        return None
    with suppress(LoopidError):
        # Coordinates that are independent in one mode may hardly be so in another.
        robot, _ = closed_at(robot, mode.reference)
        count = ceil(ROWS_PER_COLUMN * len(robot.parameters()) / len(robot.independent))
        count = max(count, LEAST_SAMPLES)
        for spread in SPREADS:
            with suppress(LoopidError):
                options = SamplingOptions(spread=spread)
                found = analyse(
                    structural_observation(robot, "full", samples=count, options=options)
                )
                if found.rank_bounds is None:
                    return found.rank
    return None
