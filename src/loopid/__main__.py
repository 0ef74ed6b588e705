"""``python -m loopid``: the command line."""

from loopid.cli import main

if __name__ == "__main__":
    main()
