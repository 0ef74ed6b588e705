"""Loop closures: pairs of frames that a joint outside the tree keeps together."""

from __future__ import annotations

from dataclasses import dataclass

# Rows of each kind: '3d' pins two origins together (spherical joint), '6d' welds two frames.
CLOSURE_ROWS = {"3d": 3, "6d": 6}


@dataclass(frozen=True)
class LoopClosure:
    """A joint that closes a loop of the tree.

    Attributes
    ----------
    kind : str
        ``"3d"``: the origins coincide. ``"6d"``: the frames coincide.
    frame_a, frame_b : str
        Names of the two frames, on different bodies.
    frame_ids : tuple of int
        Their indices in the Pinocchio model.
    """

    kind: str
    frame_a: str
    frame_b: str
    frame_ids: tuple[int, int]

    @property
    def name(self) -> str:
        """Text form, ``<frame a>-<frame b>``."""
        return f"{self.frame_a}-{self.frame_b}"

    @property
    def rows(self) -> int:
        """Number of scalar equations."""
        return CLOSURE_ROWS[self.kind]
