"""Gains of all motors at once, each with a factor and a sign of its own, as of currents.

From signs and sizes by the file's bodies alone, Newton's method climbs the evidence over the
logarithms of all gains; a sign is turned where that raises it. Gains of all motors and bodies times
the same number explain the forces alike. So the bodies are held as heavy as the file's, in the
median motor, until motors that are right show the scale.
"""

from __future__ import annotations

from math import comb, inf, log, pi
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray
from loopid.findings import EVIDENCE
from loopid.identification.evidence import TINY, Evidence, Explanation
from loopid.numbers import NORMAL_95

# Logarithm of what gains are possible beforehand, of both signs; bends of the evidence that say no
# more than that.
POSSIBLE = 2 * log(1e8)
FLAT = 2 * pi / POSSIBLE**2
# Largest step, in logarithms of gains; its halves that are tried, and steps at most; evidence that
# is worth another step.
LARGEST, HALVES, STEPS, RISES = 2.0, 8, 30, 1e-3
RIGHT = log(1.25)  # logarithm of a gain that is right
WIDE = 0.5  # half of a 95 % interval, as a part of the gain, that is not known


class OwnGains(NamedTuple):
    """Gains of d motors that explain a log best."""

    gains: FloatArray  # (d,), over those that are undone already; 1 where they are right
    reach: FloatArray  # (d,), half of the 95 % interval, as a part of each; inf: not known
    after: Explanation
    lost: float  # of the evidence, by the choice of sizes and motors
    relative: bool  # whether all are known no better than the file's masses

    @property
    def motors(self) -> tuple[int, ...]:
        """Motors whose gains are wrong."""
        return tuple(np.flatnonzero(self.gains != 1).tolist())

    @property
    def wrong(self) -> int:
        """How many are clearly wrong, or have the wrong sign."""
        clear = np.abs(np.log(np.abs(self.gains))) - self.reach > RIGHT
        return int((clear | (self.gains < 0)).sum())


def own_gains(model: Evidence, found: Explanation) -> OwnGains | None:
    """Gains of all motors whose gains are not right, beside how a log was explained.

    None where gains as they are explain the forces as well.
    """
    first = model.file_gains(found.undone)
    gains = np.where(np.isin(np.arange(len(first)), model.present) & (first != 0), first, 1.0)
    best = _Climb(model, found, gains, tuple(model.present)).signed()
    if best.after.evidence - found.evidence < EVIDENCE:
        return None
    typical = np.median(np.abs(first / best.gains)[model.present])
    best = best.again(best.gains * np.where(gains == 1, 1.0, typical))
    signs, count = best.without(*model.present), 0
    if signs.evidence >= best.evidence:
        return signs.found
    # Right gains stay; so do those that are not known, but for their signs.
    while count != len(best.free):
        count = len(best.free)
        for k in model.present:
            if k in best.usual or k in best.unknown:
                fewer = best.without(k)
                best = fewer if fewer.evidence >= best.evidence else best
    right = np.abs(np.log(np.abs(best.gains))) <= RIGHT  # known, and right but for their signs
    best = best.without(*(k for k in best.free if k not in best.unknown and right[k]))
    return signs.found if signs.evidence > best.evidence - EVIDENCE else best.found


class _Climb:
    """Gains at the top of the evidence, some of them free."""

    def __init__(
        self,
        model: Evidence,
        before: Explanation,
        gains: FloatArray,
        free: tuple[int, ...],
        *,
        hidden: tuple[int, ...] = (),
        held: bool = True,
    ) -> None:
        self.model, self.before, self.free = model, before, list(free)
        self.gains, self.hidden, self.held = gains, hidden, held
        (self.after,) = self._explained(gains[None])
        for _ in range(STEPS * bool(free)):
            slopes, bends = self._slopes()
            sizes, axes = np.linalg.eigh(bends)
            step = axes @ (axes.T @ slopes / np.maximum(sizes, 1.0))
            step *= min(1.0, LARGEST / max(float(np.abs(step).max()), LARGEST))
            if not self._rises(self._times(np.exp(np.outer(0.5 ** np.arange(HALVES), step)))):
                break

    def _times(self, factors: FloatArray) -> FloatArray:
        """Gains (k, d) times factors of the free ones."""
        gains = np.tile(self.gains, (len(factors), 1))
        gains[:, self.free] *= factors
        return gains

    def _explained(self, gains: FloatArray) -> list[Explanation]:
        base = self.before.undone
        every = (gains * base.gain).tolist()
        return self.model.explained([base._replace(gain=tuple(one)) for one in every])

    def _rises(self, gains: FloatArray) -> bool:
        """Whether some of the gains (k, d) are better; then they are taken."""
        every = self._explained(gains)
        k = int(np.argmax([one.evidence for one in every]))
        rises = every[k].evidence > self.after.evidence + RISES
        if rises:
            self.gains, self.after = gains[k], every[k]
        return rises

    def _slopes(self) -> tuple[FloatArray, FloatArray]:
        """Of the free gains; where they are held, their common factor has no slope."""
        slopes, bends = self.model.gain_slopes(self.after)
        slopes, bends = slopes[self.free], -bends[np.ix_(self.free, self.free)]
        if self.held and self.free:
            known = np.maximum(np.diag(bends), FLAT)
            share = known / known.sum()
            apart = np.eye(len(share)) - share
            slopes, bends = apart @ slopes, apart @ bends @ apart.T
            bends += known.max() * np.outer(share, share) / (share @ share)
        return slopes, bends

    def signed(self) -> _Climb:
        """With signs turned as long as this raises the evidence."""
        turned = self._times(1.0 - 2.0 * np.eye(len(self.free)))
        return self.again(self.gains).signed() if self._rises(turned) else self

    def without(self, *motors: int) -> _Climb:
        """With the sizes of gains as they are logged; those that are known show the scale."""
        gains = np.array(self.gains)
        gains[list(motors)] = np.sign(gains[list(motors)])
        return self.again(gains, motors)

    def again(self, gains: FloatArray, motors: tuple[int, ...] = ()) -> _Climb:
        """From other gains on, those of some motors held."""
        unknown, free = self.unknown, tuple(k for k in self.free if k not in motors)
        hidden = *self.hidden, *(k for k in motors if k in unknown)
        held = self.held and set(motors) <= set(unknown)
        return _Climb(self.model, self.before, gains, free, hidden=hidden, held=held)

    @property
    def deviations(self) -> FloatArray:
        """Of the logarithms of the free gains; errors may all be alike to what bodies carry."""
        sizes, axes = np.linalg.eigh(self._slopes()[1])
        alike = (self.after.error / np.maximum(self.after.shape, TINY))[self.free]
        return np.asarray(np.sqrt((axes**2 / np.maximum(sizes, FLAT)).sum(axis=1) + alike**2))

    @property
    def unknown(self) -> list[int]:
        """Motors whose gains are free and not known."""
        wide = NORMAL_95 * self.deviations > WIDE
        return [k for k, own in zip(self.free, wide.tolist(), strict=True) if own]

    @property
    def usual(self) -> list[int]:
        """Motors whose gains are free and may be right, but for their signs."""
        off = np.abs(np.log(np.abs(self.gains[self.free]))) - NORMAL_95 * self.deviations
        return [k for k, own in zip(self.free, (off <= RIGHT).tolist(), strict=True) if own]

    @property
    def evidence(self) -> float:
        """Less what is lost by the choice of sizes, signs and motors."""
        sizes = np.linalg.eigvalsh(self._slopes()[1])
        lost = np.log(POSSIBLE * np.sqrt(np.maximum(sizes, FLAT) / (2 * pi))).sum()
        turned = [k for k in self.model.present if k not in self.free and self.gains[k] < 0]
        count = len(self.free) + len(turned)
        return float(self.after.evidence - lost - log(comb(len(self.model.present), count)))

    @property
    def found(self) -> OwnGains:
        reach = np.zeros(len(self.gains))
        reach[self.free] = NORMAL_95 * self.deviations
        reach[[*self.hidden, *self.unknown]] = inf
        lost = self.after.evidence - self.evidence
        return OwnGains(self.gains, reach, self.after, lost, self.held)
