"""Lets scripts of this folder find what all tests share, as pytest does, and writers of logs."""

import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path += map(str, (TESTS, TESTS / "logs"))
