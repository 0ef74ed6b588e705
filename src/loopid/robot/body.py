"""Bodies: what carries parameters."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Body:
    """A rigid body that carries parameters: all the links fixed to one joint.

    Attributes
    ----------
    link : str
        The link that the joint carries; the parameters are in its frame.
    joint_id : int
        Index of the joint in the Pinocchio model.
    """

    link: str
    joint_id: int
