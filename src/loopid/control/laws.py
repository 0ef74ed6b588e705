"""Control laws. A controller is a sum of laws, each a class that can be understood alone.

A law gives forces of the motors from what the sensors say and where the robot is to be:

    Controller(PID(Kp, Kd), Friction(dynamics), Gravity(dynamics))            PD+G
    Controller(PID(Kp, Kd, Ki, interval=0.01), OnlineCompensation(...))     with online gravity

e = u_d - u is the error of the positions.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from loopid.arguments import BoolArray, FloatArray, NotNegative, Positive, checked, finite, shaped
from loopid.control.online import ChangeDetector, RecursiveLeastSquares
from loopid.errors import DataError, OptionError
from loopid.regressors.dynamics import Dynamics


class Signals(NamedTuple):
    """What sensors say at a sample, (dof,) each.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import Signals
    >>> Signals(np.zeros(2), np.zeros(2), np.array([3.0, -1.0])).force.tolist()
    [3.0, -1.0]
    """

    position: FloatArray  # in m or rad
    velocity: FloatArray
    force: FloatArray  # of the motors, measured since the sample before, in N or N m


class Reference(NamedTuple):
    """Where the robot is to be at a sample, (dof,) each.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import Reference
    >>> Reference(np.array([0.1, 0.2]), np.zeros(2), np.zeros(2)).position.tolist()
    [0.1, 0.2]
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@runtime_checkable
class Law(Protocol):
    """What gives forces.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import Controller, Law, Reference, Signals
    >>> class Damping(Law):
    ...     def force(self, signals, reference):
    ...         return -0.5 * signals.velocity
    >>> at = np.ones(2)
    >>> Controller(Damping()).force(Signals(at, at, at), Reference(at, at, at)).tolist()
    [-0.5, -0.5]
    """

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,) of the motors in N or N m, computed once a sample."""
        ...  # pragma: no cover


@checked
class Controller:
    """A sum of laws.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import PID, Controller, Reference, Signals
    >>> law = Controller(PID(100.0, 10.0))
    >>> at, still = np.array([0.1]), np.zeros(1)
    >>> law.force(Signals(at, still, still), Reference(at + 0.01, still, still)).round(6).tolist()
    [1.0]
    """

    def __init__(self, *laws: Law) -> None:
        self.laws = laws

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,) of all laws together."""
        return np.asarray(sum(law.force(signals, reference) for law in self.laws))


@checked
class PID:
    """Kp e + Kd ė + Ki ∫e dt; PD without an integral gain.

    Parameters
    ----------
    proportional, derivative, integral : float or FloatArray
        Of all coordinates, or (dof,).
    interval : float
        Between samples in s, for the integral.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import PID, Reference, Signals
    >>> still = np.zeros(1)
    >>> law = PID(100.0, 10.0)
    >>> law.force(Signals(still, still, still), Reference(still + 0.01, still, still)).tolist()
    [1.0]
    """

    def __init__(
        self,
        proportional: FloatArray | float,
        derivative: FloatArray | float,
        integral: FloatArray | float = 0.0,
        *,
        interval: NotNegative = 0.0,
    ) -> None:
        gains = {"proportional": proportional, "derivative": derivative, "integral": integral}
        Kp, Kd, Ki = (finite(gain, name) for name, gain in gains.items())
        for name, gain in zip(gains, (Kp, Kd, Ki), strict=True):
            if gain.ndim > 1 or not gain.size:
                said = f"{name} must be one number, or have shape (dof,), not {gain.shape}"
                raise DataError(said, argument=name, given=gain.shape)
        if min(Kp.min(), Kd.min(), Ki.min()) < 0 or (Ki.any() and not interval):
            raise OptionError("gains must not be negative, and an integral one needs an interval")
        self.proportional, self.derivative, self.integral = Kp, Kd, Ki
        self.interval, self.sum = interval, np.zeros(())

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,)."""
        error = _apart("position", signals, reference)
        rate = _apart("velocity", signals, reference)
        self.sum = self.sum + self.interval * error
        return np.asarray(
            self.proportional * error + self.derivative * rate + self.integral * self.sum
        )


def _apart(what: str, signals: Signals, reference: Reference) -> FloatArray:
    """The error (dof,) of positions or velocities."""
    measured = finite(getattr(signals, what), f"{what} of the signals")
    required = getattr(reference, what)
    return shaped(required, f"{what} of the reference", *measured.shape) - measured


@checked
class Gravity:
    """Forces that hold the robot, by values that stay.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import Gravity, Reference, Signals
    >>> own = loopid.Dynamics(loopid.load("five_bar"))
    >>> at, still = np.array([1.2, 1.9]), np.zeros(2)
    >>> force = Gravity(own).force(Signals(at, still, still), Reference(at, still, still))
    >>> bool(np.allclose(force, own.gravity(at)))
    True
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,)."""
        return self.dynamics.gravity(signals.position)


@checked
class Friction:
    """Friction at the commanded velocity, by values that stay.

    The measured one is noise where it is small, and Coulomb friction has its sign.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import Friction, Reference, Signals
    >>> model = loopid.force_model(loopid.load("five_bar"), "gravity", "Fv")
    >>> bodies = model.robot.standard_parameters("gravity")
    >>> values = model.base.values(np.append(bodies, [0.05, 0.05]))
    >>> law, at = Friction(loopid.Dynamics(model, values)), np.zeros(2)
    >>> law.force(Signals(at, at, at), Reference(at, np.array([1.0, 2.0]), at)).round(6).tolist()
    [0.05, 0.1]
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,)."""
        return self.dynamics.friction(signals.position, reference.velocity)


def _gravity_and_friction(dynamics: Dynamics, signals: Signals, reference: Reference) -> FloatArray:
    """K (dof, n) of both laws together."""
    u = signals.position
    return dynamics.regressor(u) + dynamics.friction_regressor(u, reference.velocity)


@checked
class OnlineCompensation:
    """Gravity and friction with values that are estimated while the robot moves.

    The values fit the last forces, which hold the controller's own. Used at once, they would be a
    loop of gain one, which no dynamics calm. They follow with a lag. A motor says something once it
    has measurably followed its command since that turned. Before, its friction may be anything.
    Where a change is detected, the estimate forgets along what a body on a link would change. It
    soon knows the body. Until the robot moves as commanded again it is detected again and again.
    Within five time constants after the last time it is the same change.

    Parameters
    ----------
    dynamics : Dynamics
        Its parameters are estimated; a gravity model, as accelerations are left out. With
        ``smoothing``, as commanded velocities pass through zero.
    estimate : RecursiveLeastSquares
        Of these parameters.
    interval : float
        Between samples in s.
    lag : float
        Time constant in s with which the values in use follow the estimate.
    moving, followed : float
        Commanded rate in m/s or rad/s, and measured way in m or rad since the command has turned,
        above which a motor moves.
    payload : (str, FloatArray), optional
        The link that may be loaded, and deviations (4,) of mass in kg and first moments in kg m;
        without, the estimate never loosens.

    Attributes
    ----------
    detector : ChangeDetector or None
    changes : list of int
        Samples at which something began to change.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import OnlineCompensation, RecursiveLeastSquares
    >>> model = loopid.force_model(loopid.load("five_bar"), "gravity", None)
    >>> own = loopid.Dynamics(model, smoothing=1e-3)
    >>> n = len(own.values)
    >>> estimate = RecursiveLeastSquares(own.values, np.eye(n), np.ones(2))
    >>> OnlineCompensation(own, estimate, 0.01).changes
    []
    """

    def __init__(
        self,
        dynamics: Dynamics,
        estimate: RecursiveLeastSquares,
        interval: Positive,
        *,
        lag: Positive = 0.3,
        moving: NotNegative = 1.5e-3,
        followed: NotNegative = 2e-4,
        payload: tuple[str, FloatArray] | None = None,
    ) -> None:
        self.dynamics, self.estimate = dynamics, estimate
        self.detector = None if payload is None else ChangeDetector()
        self.part, self.settling = min(1.0, interval / lag), round(5 * lag / interval)
        self.moving, self.followed = moving, followed
        self.values = np.array(estimate.values)  # in use
        if payload is not None:
            link, self.deviations = payload
            self.columns = dynamics.payload_columns(link)[:, : len(self.deviations)]
        self.changes, self.samples = list[int](), 0
        self.before, self._settled = self.values, 0  # the last change, and the sample that ends it
        self._last: tuple[FloatArray, BoolArray] | None = None
        self._sign, self._turn = np.zeros(dynamics.dof), np.zeros(dynamics.dof)

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,) of gravity and friction."""
        self._learn(signals.force)
        K = _gravity_and_friction(self.dynamics, signals, reference)
        self._last = K, self._moves(signals.position, reference.velocity)
        self.samples += 1
        return np.asarray(K @ self.values)

    def _moves(self, u: FloatArray, rate: FloatArray) -> BoolArray:
        """Which motors move (dof,) as they are commanded to."""
        sign = np.sign(rate)
        way = sign * u
        self._turn = np.where(sign == self._sign, np.minimum(self._turn, way), way)
        self._sign = sign
        return (np.abs(rate) > self.moving) & (way - self._turn > self.followed)

    def _learn(self, force: FloatArray) -> None:
        if self._last is None or not self._last[1].any():
            return
        K, used = self._last
        rows, force = K * used[:, None], force * used
        if self.detector and self.detector.update(*self.estimate.innovation(rows, force)):
            if self.samples > self._settled:
                self.changes.append(self.samples)
                self.before = self.estimate.values
            self._settled = self.samples + self.settling
            self.estimate.loosen(self.columns, self.deviations)
        self.estimate.update(rows, force)
        self.values = self.values + self.part * (self.estimate.values - self.values)

    @property
    def payload(self) -> tuple[FloatArray, FloatArray]:
        """Mass and first moments (k,) put on since the last change, and their deviations (k,).

        The values have changed by B π: least squares, weighted by the covariance of the estimate.
        """
        C = self.estimate.covariance
        weighted = np.linalg.solve(C, self.columns)
        spread = np.linalg.pinv(self.columns.T @ weighted, hermitian=True)
        found = spread @ (weighted.T @ (self.estimate.values - self.before))
        return found, np.sqrt(spread.diagonal())


@checked
class AdaptiveCompensation:
    """Gravity and friction whose values adapt by what they miss: φ̇ = B γ Bᵀ Kᵀ s [Slotine1987].

    s = ė + λ e; friction is that of the commanded velocity.

    Parameters
    ----------
    dynamics : Dynamics
        With ``smoothing``, as commanded velocities pass through zero.
    interval : float
        Between samples in s.
    gains : FloatArray
        (k,), γ of each of the k columns.
    columns : FloatArray, optional
        B (n, k), along which values may change; by default each value for itself.
    bandwidth : float
        λ in 1/s.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.control import AdaptiveCompensation, Reference, Signals
    >>> model = loopid.force_model(loopid.load("five_bar"), "gravity", None)
    >>> own = loopid.Dynamics(model, smoothing=1e-3)
    >>> law = AdaptiveCompensation(own, 0.01, gains=np.ones(len(own.values)))
    >>> at, still = np.array([0.1, 0.1]), np.zeros(2)
    >>> law.force(Signals(at, still, still), Reference(at, still, still)).shape
    (2,)
    """

    def __init__(
        self,
        dynamics: Dynamics,
        interval: Positive,
        *,
        gains: FloatArray,
        columns: FloatArray | None = None,
        bandwidth: Positive = 2.0,
    ) -> None:
        self.dynamics, self.interval, self.bandwidth = dynamics, interval, bandwidth
        self.columns = (
            np.eye(len(dynamics.values)) if columns is None else finite(columns, "columns")
        )
        self.gains, self.values = finite(gains, "gains"), np.array(dynamics.values)

    def force(self, signals: Signals, reference: Reference) -> FloatArray:
        """Forces (dof,)."""
        K = _gravity_and_friction(self.dynamics, signals, reference)
        s = reference.velocity - signals.velocity
        s += self.bandwidth * (reference.position - signals.position)
        slope = self.columns.T @ (K.T @ s)
        self.values = self.values + self.interval * self.columns @ (self.gains * slope)
        return np.asarray(K @ self.values)
