"""What reading and preparing a log may be asked for: tolerances, filters and masks."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from loopid.errors import OptionError
from loopid.motion.filtering import LowPass
from loopid.records import record


@record(kw_only=True)
class LogTolerances:
    """How far a log may be from a perfect one, and still be one.

    Attributes
    ----------
    bad_rows : float
        Part of the rows that may be left out.
    gap : float
        Median steps: a longer step between time stamps is a gap.
    shortest_step, longest_step : float
        Seconds between stamps, at the median. Other steps mean another unit of the time.
    outside, far_outside : float
        Parts of a joint's range: how far outside its limits a position may be without a word, and
        from how far on it is none of that joint.
    glitch : float
        Forces so many times their 99th percentile are no forces.
    excess : float
        Relative, over a limit of speed or force: the round-off of how it was written.
    compared_over : float
        Seconds over which measured rates are compared with changes of the position.
    apart : float
        Relative difference of the two (root mean square) that passes without a word.
    gain : float
        Ratio of the two, or its inverse, from which on the rates are something else.
    """

    bad_rows: float = 0.1
    gap: float = 5.0
    shortest_step: float = 1e-5
    longest_step: float = 0.2
    outside: float = 1e-3
    far_outside: float = 1.0
    glitch: float = 100.0
    excess: float = 1e-3
    compared_over: float = 0.5
    apart: float = 0.1
    gain: float = 1.25

    def __post_init__(self) -> None:
        _require_numbers(self)


@record(kw_only=True)
class FilterOptions:
    """How signals are filtered, and how many of the filtered samples are kept.

    Attributes
    ----------
    cutoff : float, "auto" or None
        Of the low-pass filter in Hz; "auto" as ``motion_spectrum`` says, None for no filter.
    order : int
        Of each of the filter's two passes.
    decimate : bool
        Whether to keep only as many samples as the cut-off calls for:
    oversampling : float
        at least so many a period of the cut-off.
    reach : float
        Periods of the cut-off, for a filter of second order, after which 1 % is left of what a
        single sample or the end of a stretch does to the filtered signal. Ends are left out.
    rate_rounding : float
        Relative error of measured rates.

    Examples
    --------
    >>> import loopid
    >>> loopid.FilterOptions(cutoff=5.0).lowpass(suggested=20.0)
    LowPass(cutoff=5.0, order=2)
    """

    cutoff: float | str | None = "auto"
    order: int = 2
    decimate: bool = True
    oversampling: float = 5.0
    reach: float = 1.0
    rate_rounding: float = 1e-3

    def __post_init__(self) -> None:
        if isinstance(self.cutoff, str) and self.cutoff != "auto":
            raise OptionError.unknown("cut-off", self.cutoff, ["auto", "None", "a number in Hz"])
        self.lowpass(1.0)  # a LowPass checks itself
        _require_numbers(self)

    def lowpass(self, suggested: float) -> LowPass | None:
        """The filter, with the suggested cut-off in Hz for "auto"."""
        if self.cutoff is None:
            return None
        return LowPass(suggested if isinstance(self.cutoff, str) else self.cutoff, self.order)

    def reach_of(self, lowpass: LowPass | None, rate: float) -> int:
        """Samples at a rate over which a filter spreads what happens in one."""
        if lowpass is None:
            return 0
        return int(np.ceil(self.reach * max(lowpass.order, 2) / 2 * rate / lowpass.cutoff))

    def step_of(self, lowpass: LowPass | None, rate: float) -> int:
        """Which samples at a rate are kept: one of so many."""
        if lowpass is None or not self.decimate:
            return 1
        # A rate a little short of a whole number of times is meant to be it.
        most = (1 + self.rate_rounding) * rate / (self.oversampling * lowpass.cutoff)
        return max(int(most), 1)


@record(kw_only=True)
class MaskOptions:
    """Which samples say nothing about the model.

    Attributes
    ----------
    singularity : float
        Samples with a smaller singularity measure are left out.
    unassembled : float
        Part of the samples whose loops may stay open.
    idle, dither : float
        A motor stands at or below this part of the 99th percentile of its own speed, or of that of
        the fastest motor of its kind: its encoder only dithers.
    standstill : float
        Periods of the cut-off that a motor must be slow for to stand, not to pass through zero.
    near_saturation : float
        Forces within this part of the saturation are saturated.
    other_limit : float
        An effort limit that more than this part of the forces exceeds is another one.
    frozen : int
        Equal positions in a row that may be a frozen encoder: the motor then
    jump, abrupt, moved : float
        goes on from elsewhere, by ``jump`` times its fastest way in a sample; or stops ``abrupt``
        times as fast as it ever changes its speed, while another goes through ``moved`` of its
        range.
    clipped : int
        Samples in motion in which a clipped force has its largest size.

    Examples
    --------
    >>> import loopid
    >>> loopid.MaskOptions(singularity=0.02).singularity
    0.02
    """

    singularity: float = 5e-3
    unassembled: float = 0.5
    idle: float = 0.05
    dither: float = 0.01
    standstill: float = 0.5
    near_saturation: float = 0.01
    other_limit: float = 0.1
    frozen: int = 20
    jump: float = 2.0
    abrupt: float = 3.0
    moved: float = 0.05
    clipped: int = 20

    def __post_init__(self) -> None:
        _require_numbers(self)


def _require_numbers(options: Any) -> None:
    """Refuse a negative or infinite number among the fields."""
    for name in (field.name for field in fields(options)):
        value = getattr(options, name)
        if isinstance(value, float | int) and not 0 <= value < np.inf:
            raise OptionError(
                f"{name} must be a number from 0 on, not {value}", option=name, given=value
            )
