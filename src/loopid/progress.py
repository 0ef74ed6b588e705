"""What long work tells while it runs."""

from collections.abc import Callable

# Called with the number of items done and the number in all.
Progress = Callable[[int, int], None]
