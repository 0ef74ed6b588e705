"""The table of docs/reliability.md: ``python tests/reliability/reliability_table.py``.

Every line is an input of the suite's own cases and the answer that is given to it now.
"""

import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from random import Random

import beside_tests  # noqa: F401
from answers import refusal, wrong_inputs
from api_cases import CASES
from api_world import World
from fuzz_calls import Call
from fuzz_material import Material
from fuzz_running import run
from table_commands import commands

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
START, END = "<!-- table: reliability_table.py -->", "<!-- end of the table -->"
# Functions whose refusals are shown; the suite tries all.
SHOWN = {
    "dynamic_regressor": ("mechanism", "velocities"),
    "assemble": ("coordinates", "tolerance"),
    "random_configurations": ("count", "margin"),
    "fit": ("samples", "estimator"),
    "find_base_parameters": ("search", "criterion"),
    "LowPass": ("cutoff", "order"),
    "load_mechanism": ("path", "lock"),
}
LONGEST = 170


def table(folder: Path) -> str:
    """The table in Markdown."""
    lines = ["| input tried | answer given |", "|---|---|"]
    for tried, answer in (*_functions(folder), *_commands(folder)):
        lines.append(f"| {_cell(tried)} | {_cell(_anonymous(answer, folder))} |")
    return "\n".join(lines)


def _functions(folder: Path) -> Iterator[tuple[str, str]]:
    world = World(folder)
    for name, shown in SHOWN.items():
        case = CASES[name]
        sound = world.quietly(case.sound, world)
        for argument, what, value in wrong_inputs(case, sound):
            if argument in shown:
                said = refusal(case, {**sound, argument: value}, world)
                yield f"`{name}({argument})`: {what}", said or "is answered"


def _commands(folder: Path) -> Iterator[tuple[str, str]]:
    material = Material(folder)
    for tried, words in commands(material, Random(0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = run(Call(0, tuple(map(str, words))), folder)
        answer = found.errors[0].removeprefix("loopid: error: ") if found.errors else found.err
        yield tried, answer.strip().splitlines()[-1] if answer.strip() else "is answered"


def _anonymous(text: str, folder: Path) -> str:
    """The text without the place of this run, and not too long."""
    text = text.replace(f"{folder}/", "").replace(str(folder), ".")
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def page_with(text: str, page: str) -> str:
    """A page with its table replaced."""
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    return f"{before}{START}\n{text}\n{END}{after}"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        text = table(Path(folder))
    PAGE.write_text(page_with(text, PAGE.read_text()))


if __name__ == "__main__":
    main()
