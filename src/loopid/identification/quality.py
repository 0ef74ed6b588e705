"""How well values explain forces, what their errors are like, and what else a fit finds."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, shaped
from loopid.identification.problem import FitProblem
from loopid.numbers import number
from loopid.records import record

# Squared deviation of a force from its mean, relative to its square, that is but round-off.
CONSTANT_FORCE = 1e-12


@record(checked="outside")
class Quality:
    """Residuals of parameters on data, by actuator; NaN where it has no samples."""

    residual_rms: FloatArray  # (dof,) in N or N m
    # (dof,), 1 - residual over total squares about the mean; negative when worse than the mean, NaN
    # for a constant force
    r_squared: FloatArray
    samples: IntArray  # (dof,)

    @classmethod
    def of(cls, problem: FitProblem, squares: FloatArray) -> Quality:
        """Of sums of squared residuals (dof,) of a problem."""
        return cls.of_sums(problem.samples, squares, problem.force_squares(), problem.mean_force)

    @classmethod
    def of_sums(
        cls, samples: IntArray, squares: FloatArray, force: FloatArray, mean_force: FloatArray
    ) -> Quality:
        """Of sums of squared residuals and forces (dof,), and the means of these."""
        total = force - samples * mean_force**2
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(samples > 0, squares / samples, np.nan)
            r_squared = np.where(total > CONSTANT_FORCE * force, 1.0 - squares / total, np.nan)
        return cls(np.sqrt(mean), r_squared, samples)


@checked
def fit_quality(problem: FitProblem, values: FloatArray) -> Quality:
    """Residuals of a problem at parameter values (n,)."""
    phi = shaped(values, "values", len(problem.parameters))
    return Quality.of(problem, problem.residual_squares(phi))


@record(checked="outside")
class NoiseModel:
    """An autoregressive model of each actuator's errors, e_t = Σ c_k e_{t-k} + ε_t.

    Actuators without samples have NaN for all that is not a count.
    """

    actuators: tuple[str, ...]
    # (dof, order), c_k, padded with zeros; order 0 when the errors of all are independent
    coefficients: FloatArray
    innovation: FloatArray  # (dof,), standard deviation of ε in N or N m
    deviation: FloatArray  # (dof,), standard deviation of e in N or N m
    lag_one: FloatArray  # (dof,), correlation of neighbouring errors
    samples: IntArray  # (dof,)
    # (dof,), number of independent samples that would determine a mean as well; at most ``samples``
    effective_samples: FloatArray
    # (dof,), of independent samples that would determine the parameters as well, on average over
    # what the actuator determines of them; as for a mean where nothing is fitted
    informing_samples: FloatArray


@record(checked="outside")
class Robustness:
    """Scale and weights of the residuals of a robust fit, by actuator; NaN without samples."""

    # (dof,) in N or N m, standard deviation of errors without outliers, from the median
    scale: FloatArray
    # (dof,), share of the samples that count less than half: some 1 % of normal errors
    down_weighted: FloatArray


# Deviations of the robot file as a whole that the data may choose, in parts of its bodies, and the
# largest of a single one. The least is 0.4: evidence averages ten parameters, and a wrong mass
# spoils one.
LEAST_OFF, LARGEST_OFF, LARGEST_OF_BODY = 0.4, 1.0, 3.0


@record(checked="outside")
class FileDeviation:
    """How far the bodies of the robot file are off, as the data say, in parts of themselves."""

    common: float  # of all bodies
    bodies: tuple[str, ...]  # those with a mass
    own: FloatArray  # (bodies,), of each: larger for one that is far off while the others are right

    @property
    def sentence(self) -> str:
        """How far the file is trusted; at a bound that is no finding of the data."""
        bound = not LEAST_OFF < self.common < LARGEST_OFF
        off = (f"{name} {number(100 * own, 2)} %" for name, own in self.rows if own > self.common)
        also = ", ".join(off)
        return (
            f"the given bodies {'are assumed' if bound else 'count as'} right to "
            f"{number(100 * self.common, 2)} %{f', but {also}' if also else ''}"
        )

    @property
    def far(self) -> tuple[str, ...]:
        """Bodies that are as far off as they may be."""
        return tuple(self.bodies[k] for k in np.flatnonzero(self.own >= LARGEST_OF_BODY))

    @property
    def rows(self) -> list[tuple[str, float]]:
        """Each body with its deviation."""
        return list(zip(self.bodies, self.own.tolist(), strict=True))

    @property
    def fault(self) -> str:
        """What a deviation at its bound says: a sentence, empty where none is."""
        if self.common < LARGEST_OFF and not self.far:
            return ""
        who = f"bodies {', '.join(self.far)}" if self.far else "the bodies"
        most = LARGEST_OF_BODY if self.far else LARGEST_OFF
        return (
            f"{who} would have to be {100 * most:.0f} % off the robot file: it is of "
            "another robot (a tool, a payload), or the model lacks a force"
        )


@record(checked="outside")
class TermDeviations:
    """Prior deviations of groups of joint terms, as the evidence of the data chooses them."""

    names: tuple[str, ...]  # of the groups, such as ``"elbow: friction curve"``
    own: FloatArray  # (g,), deviation of each, in the unit of its terms
    determined: FloatArray  # (g,), how many of its terms the data determine
    # (g,), logarithm of how much likelier the data are with the group than without it
    evidence: FloatArray


@record(checked="outside")
class MotorUse:
    """How the motors were used in the samples of a fit."""

    joints: tuple[str, ...]
    slowest: FloatArray  # (m,), slowest informative and fastest rate of each, in m/s or rad/s
    fastest: FloatArray
    load: FloatArray  # (m,), mean size of the force that moved the bodies, in N or N m
    largest: FloatArray  # (m,), largest size of the force, in N or N m

    def of(self, joint: str) -> tuple[float, float]:
        """Slowest and fastest rate of a joint."""
        k = self.joints.index(joint)
        return float(self.slowest[k]), float(self.fastest[k])


@record(checked="outside")
class Ripples:
    """Waves of forces of motors over their positions, which estimates are beside."""

    motors: tuple[str, ...]  # of each of r ripples
    number: FloatArray  # (r,), waves in 2 π rad or metres
    size: FloatArray  # (r,), root mean square in N or N m


@record(checked="outside")
class StandardUncertainty:
    """What the covariance of a fit, and the robot file, say of the p standard parameters.

    That is of the bodies, and of the joint terms, in the order of the force model.
    """

    gain: FloatArray  # (p, n), changes of these with the n base parameters
    beside: FloatArray  # (p,), variances at known base parameters
    file: FloatArray  # (p,), variances by the robot file alone; 0 for what no force depends on
    degrees_of_freedom: FloatArray  # (p,)
