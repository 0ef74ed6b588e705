"""``loopid`` and ``python -m loopid``: the command line."""

import gc
import io
import os
import sys


def main() -> None:
    """Run the command line; Ctrl-C ends it with exit code 130 also while it is imported."""
    # Commands make many objects and little garbage, which is looked for less.
    gc.set_threshold(1_000_000)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # searched in all packages
    if sys.stderr is None:  # closed: nobody hears warnings, but libraries write there
        sys.stderr = io.StringIO()
    try:
        from loopid.cli import main as command
    except KeyboardInterrupt:  # later on, the command line answers it
        sys.stderr.write("loopid: interrupted\n")
        sys.exit(130)
    try:
        command()
    finally:
        gc.freeze()  # what is left goes with the process: it is not searched for garbage first


if __name__ == "__main__":
    main()
