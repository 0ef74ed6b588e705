"""All cases: a public function without one fails the suite."""

import data_cases  # noqa: F401
import export_cases  # noqa: F401
import robot_cases  # noqa: F401
import value_cases  # noqa: F401
from case_registry import CASES, RECORDS, Case, public_functions

# Minutes of work, or a compiler's: their refusals are those of what they are made of.
UNSWEPT = ("reproduce_paper", "compile_regressor")
# NaN stands for what is not there, as the functions say.
TELLS_NAN = ("try_assemble", "eliminate", "identifiability", "identify")

__all__ = ["CASES", "RECORDS", "TELLS_NAN", "UNSWEPT", "Case", "public_functions"]
