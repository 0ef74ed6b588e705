"""``loopid`` and ``python -m loopid``: the command line, and Ctrl-C while it is imported."""

import os
import signal
import sys


def main() -> None:
    """Run the command line."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    from loopid.cli import main as command  # takes a while

    signal.signal(signal.SIGINT, before)
    command()


def _end(*_: object) -> None:
    # Compiled libraries that are being imported would swallow an exception.
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, b"loopid: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    main()
