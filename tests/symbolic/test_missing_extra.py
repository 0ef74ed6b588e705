"""Without SymPy the room says which extra brings it."""

import subprocess
import sys

WITHOUT_SYMPY = """
import sys
sys.modules["sympy"] = None
from loopid.errors import MissingExtraError
try:
    import loopid.paper.symbolic
except MissingExtraError as error:
    sys.exit(0 if "symbolic" in str(error) else "the extra is not named")
sys.exit("no error")
"""


def test_missing_sympy_names_the_extra():
    done = subprocess.run([sys.executable, "-c", WITHOUT_SYMPY], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
