"""What was measured: logs of positions and forces, made ready for identification."""

from loopid.logs.recording import Dropped, Recording

__all__ = ["Dropped", "Recording"]
