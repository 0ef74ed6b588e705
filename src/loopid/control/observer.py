"""What the surroundings exert, from the motors alone: an observer of the generalised momentum.

Motors with forces τ and a wrench w on a frame of Jacobian J move the robot by

    M ü + C u̇ + g + f = τ + Jᵀ w.

A low-pass of gain k (1/s) of what the motors do not explain needs no accelerations [DeLuca2005]. As
Ṁ = C + Cᵀ, take the momentum's gain less what Cᵀ u̇ adds to it. This is M times the gain of u̇.
Over dt

    r⁺ = (r + k (M (u̇⁺ - u̇) + (C u̇ + g + f - τ) dt)) / (1 + k dt),

with means of M and of C u̇ + g + f at both ends: as in the C code. All terms but τ are regressors
times base parameters φ. The filter runs on the regressors, so that r = D φ less filtered forces.
The covariance of a fit becomes that of r: D Σ Dᵀ.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.special import chdtri, ndtri

from loopid.arguments import BoolArray, FloatArray, Positive, checked, for_each
from loopid.control.laws import Signals
from loopid.errors import DataError, OptionError
from loopid.records import record
from loopid.regressors.dynamics import Dynamics

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
MOVING = 2e-3  # m/s or rad/s, above which a motor does not stand
UNSEEN = 1e-6  # of the largest singular value of J, in units of the robot's length


@record(checked="outside")
class WrenchEstimate:
    """A wrench on a frame, at its origin along the fixed axes: forces in N above moments in N m.

    Attributes
    ----------
    residual, covariance : FloatArray
        (dof,) and (dof, dof): what the motors do not explain, in N or N m.
    sensitivity : FloatArray
        (dof, n), D: how the residual depends on the values of the dynamics.
    wrench, wrench_covariance : FloatArray
        (6,) and (6, 6): the least one that explains the residual, without what no motor senses.
    floor : FloatArray
        (6,), what a component must be, alone and lasting, to raise an alarm on 97.5 % of the
        occasions; infinite where no motor senses it.
    unseen : FloatArray
        (6, k), wrenches that no motor senses: forces, and moments over the robot's length.
    standing : BoolArray
        (dof,), motors whose friction may be anything up to Coulomb's.
    statistic, threshold : float
        rᵀ S⁻¹ r, and what it exceeds at the stated rate of false alarms.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import Signals, WrenchObserver
    >>> own = loopid.Dynamics(loopid.force_model(loopid.load("3ups_rpu"), "full"))
    >>> at, still = np.array([0.72, 0.75, 0.76, 0.72]), np.zeros(4)
    >>> observer = WrenchObserver(own, 0.01, noise=7.0)
    >>> estimate = observer.update(Signals(at, still, own.gravity(at)))
    >>> estimate.wrench.shape, estimate.contact
    ((6,), False)
    """

    residual: FloatArray
    covariance: FloatArray
    sensitivity: FloatArray
    wrench: FloatArray
    wrench_covariance: FloatArray
    floor: FloatArray
    unseen: FloatArray
    standing: BoolArray
    statistic: float
    threshold: float

    @property
    def contact(self) -> bool:
        """Whether something touches the robot."""
        return self.statistic > self.threshold

    @property
    def unseen_components(self) -> tuple[str, ...]:
        """Components that no motor senses."""
        return tuple(np.array(COMPONENTS)[~np.isfinite(self.floor)].tolist())


@checked
class WrenchObserver:
    """Tells wrenches on a frame from the signals of the motors.

    Parameters
    ----------
    dynamics : Dynamics
        With the covariance of its values; bodies of a gravity model are observed as if they stood
        still everywhere, without momentum.
    interval : float
        Between samples in s.
    gain : float
        k in 1/s: the larger, the faster, and the more noise passes.
    noise : float or FloatArray
        Standard deviation of measured forces in N or N m, independent from sample to sample.
    unmodelled : float or FloatArray
        The same of what the model lacks, and of what the fit's covariance does not hold: errors
        that last, and pass the filter. Residuals of a fit are a safe choice.
    alarms : float
        False ones an hour.
    frame : str, optional
        On which wrenches act; by default the platform that the robot file declares.

    Attributes
    ----------
    moving : float
        Rate in m/s or rad/s up to which a motor stands: its friction is then known to Coulomb's.
    threshold : float
        Of ``WrenchEstimate.statistic``.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import Signals, WrenchObserver
    >>> knee = loopid.load("3ups_rpu")
    >>> robot = loopid.Dynamics(loopid.force_model(knee, "full"))
    >>> at, still = np.array([0.72, 0.75, 0.76, 0.72]), np.zeros(4)
    >>> observer = WrenchObserver(robot, 0.01, noise=7.0)
    >>> for _ in range(100):
    ...     found = observer.update(Signals(at, still, robot.gravity(at)))
    >>> found.contact, found.unseen_components, found.unseen.shape
    (False, ('Fy',), (6, 2))
    """

    def __init__(
        self,
        dynamics: Dynamics,
        interval: Positive,
        *,
        gain: Positive = 20.0,
        noise: FloatArray | float = 0.0,
        unmodelled: FloatArray | float = 0.0,
        alarms: Positive = 1.0,
        frame: str | None = None,
    ) -> None:
        self.dynamics, self.interval, self.moving = dynamics, interval, MOVING
        self.part = gain * interval / (1.0 + gain * interval)  # of what is new in the filter
        self.noise = for_each(noise, "noise", dynamics.dof)
        self.unmodelled = for_each(unmodelled, "unmodelled", dynamics.dof)
        if not (self.noise + self.unmodelled).all():
            raise DataError("an observer needs deviations: give noise, or what is unmodelled")
        robot = dynamics.robot
        frames = {each.name: k for k, each in enumerate(robot.model.frames)}
        if frame is None and robot.platform is not None:
            frame = robot.platform.frame
        if frame not in frames:
            raise OptionError.unknown("frame", frame, frames)
        self.frame, self._data = frames[frame], robot.model.createData()
        # Values that follow one another are as many independent ones as the filter forgets.
        self.threshold = float(chdtri(dynamics.dof, alarms / (3600.0 * gain / 2)))
        self._last: tuple[FloatArray, ...] | None = None  # rates, mass and bias
        self._passed: tuple[FloatArray, FloatArray]  # what has come through the filter

    def update(self, signals: Signals, rates: FloatArray | None = None) -> WrenchEstimate:
        """Take a sample: what was measured, and rates (dof,) that signs of friction follow.

        By default these are the measured ones; commanded ones are without noise.
        """
        dynamics, u, v = self.dynamics, *signals[:2]
        commanded = v if rates is None else rates
        bias = dynamics.regressor(u, v, 0 * v, friction=False)
        bias = bias + dynamics.friction_regressor(u, commanded)
        mass = dynamics.mass_regressor(u)
        if self._last is None:  # nothing touches the robot at first
            self._passed = bias, bias @ dynamics.values
        else:
            (D, force), (before, mass_before, bias_before) = self._passed, self._last
            gained = (mass + mass_before) / 2 * ((v - before) / self.interval)[:, None]
            D = D + self.part * (gained.sum(axis=1) + (bias + bias_before) / 2 - D)
            self._passed = D, force + self.part * (signals.force - force)
        self._last = v, mass, bias
        D, force = self._passed
        standing = np.abs(commanded) <= self.moving
        return self._told(u, D @ dynamics.values - force, D, standing)

    def _told(
        self, positions: FloatArray, residual: FloatArray, D: FloatArray, standing: BoolArray
    ) -> WrenchEstimate:
        dynamics = self.dynamics
        passed = self.part / (2.0 - self.part)  # of the variance of white noise
        variance = passed * self.noise**2 + self.unmodelled**2
        variance += (standing * dynamics.coefficients("Fc")) ** 2
        S = D @ dynamics.covariance @ D.T + np.diag(variance)
        J = self.jacobian(positions)
        units = np.repeat([1.0, dynamics.robot.length], 3)[:, None]  # moments like forces
        left, sizes, right = np.linalg.svd(units * J)
        seen = int((sizes > UNSEEN * sizes[0]).sum())
        inverse = units * (left[:, :seen] / sizes[:seen] @ right[:seen])  # of Jᵀ
        told = np.linalg.solve(S, np.column_stack([residual, J.T]))
        unseen = left[:, seen:]
        sensed = np.sqrt(np.maximum((J * told[:, 1:].T).sum(axis=1), 0.0))
        hidden = (unseen**2).sum(axis=1) > 1 - UNSEEN
        floor = np.full(len(J), np.inf)
        floor[~hidden] = (np.sqrt(self.threshold) + ndtri(0.975)) / sensed[~hidden]
        wrench = inverse @ residual, inverse @ S @ inverse.T, floor, unseen
        statistic = float(residual @ told[:, 0]), self.threshold
        return WrenchEstimate(residual, S, D, *wrench, standing, *statistic)

    def jacobian(self, positions: FloatArray) -> FloatArray:
        """J (6, dof) of the frame: its twist, linear above angular, by each coordinate's rate."""
        pose, tree = self.dynamics.pose(positions), self.dynamics.robot.model
        frame = self.frame, pin.LOCAL_WORLD_ALIGNED
        return np.asarray(pin.computeFrameJacobian(tree, self._data, pose.q, *frame) @ pose.G)
