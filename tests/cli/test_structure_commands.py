"""``loopid check`` and ``loopid base``, refusals, and what starting costs."""

import subprocess
import sys
from pathlib import Path

import pytest

URDF = Path(__file__).parents[2] / "urdf"
BASE_KEYS = {
    "mechanism",
    "model",
    "standard_parameters",
    "nonzero_parameters",
    "rank",
    "rank_gap",
    "condition_number",
    "search",
    "base_parameters",
}
SEARCH_KEYS = {
    "name",
    "criterion",
    "condition_number",
    "certified",
    "candidates",
    "evaluated",
    "seconds",
}


def test_base_json_has_the_promised_keys_and_counts(run_json):
    record = run_json("base", str(URDF / "3ups_rpu.yaml"))
    assert record.keys() >= BASE_KEYS
    assert record["search"].keys() >= SEARCH_KEYS
    counts = (record["standard_parameters"], record["nonzero_parameters"], record["rank"])
    assert counts == (36, 30, 15)
    assert record["search"]["candidates"] == 155_117_520
    assert record["search"]["certified"] is True
    assert len(record["base_parameters"]) == record["rank"]
    for parameter in record["base_parameters"]:
        assert parameter["terms"][parameter["name"]] == 1.0


@pytest.mark.parametrize("search", ["exact", "subgroup", "qr"])
@pytest.mark.parametrize("criterion", ["nullspace", "regressor"])
def test_every_search_and_criterion_answers_and_none_beats_the_exact_one(
    run, run_json, search, criterion
):
    options = ("--criterion", criterion, "--samples", "50")
    if run("base", "5p", "--search", search, *options).code:
        # The paper's search sorts round-off, and may end with nothing.
        assert search == "subgroup"
        assert "found no valid choice" in run("base", "5p", "--search", search, *options).err
        return
    found = run_json("base", "5p", "--search", search, *options)["search"]
    exact = run_json("base", "5p", *options)["search"]
    assert (found["name"], found["criterion"]) == (search, criterion)
    assert exact["condition_number"] <= found["condition_number"] * (1 + 1e-9)


def test_the_full_model_of_a_bundled_robot(run_json):
    record = run_json("base", "3ups_rpu", "--model", "full")
    assert record["standard_parameters"] == 90
    assert record["search"]["certified"]


def test_a_seed_gives_the_same_answer_again(run_json):
    first, second = (run_json("base", "3ups_rpu", "--seed", "7") for _ in range(2))
    first["search"].pop("seconds")
    second["search"].pop("seconds")
    assert first == second


def test_a_bundled_name_works_from_any_folder(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run("base", "3ups_rpu")
    assert done.code == 0
    assert "platform.mx - 0.3 leg1_stem.m" in done.out


def test_base_says_which_lengths_the_coefficients_are(run, run_json):
    text = run("base", "3ups_rpu").out
    for line in ("where -0.3 = x(platform_B1)", "0.1928 m   x of platform_B2 in platform"):
        assert line in text
    rows = run_json("base", "3ups_rpu")["base_parameters"]
    (row,) = [row for row in rows if row["name"] == "platform.my"]
    assert row["expression"] == (
        "platform.my + 0.2298 leg2_stem.m - 0.3 leg3_stem.m, "
        "where 0.2298 = y(platform_B2), -0.3 = y(platform_B3)"
    )


def test_check_reports_mobility_and_closure(run_json):
    record = run_json("check", "3ups_rpu")
    assert (record["closure_rows"], record["closure_rank"]) == (9, 9)
    assert record["degrees_of_freedom"] == len(record["actuated"]) == 4
    assert record["coordinates"] == len(record["actuated"]) + len(record["passive"])
    assert record["closure_residual"] < 1e-10
    assert 0 < record["singularity_measure"] < 1
    assert not record["near_singularity"]
    assert [closure["frames"] for closure in record["closures"]] == [
        [f"leg{leg}_stem", f"platform_B{leg}"] for leg in (1, 2, 3)
    ]


def test_check_prints_the_same_as_tables(run):
    text = run("check", "5p").out
    for word in ("leg4_stroke", "leg2_stem - platform_B2", "degrees of freedom", "singularity"):
        assert word in text


def test_check_names_the_inertia_that_no_solid_body_has(run_json):
    assert run_json("check", "3ups_rpu")["inertia_defects"] == []
    (defect,) = run_json("check", "5p")["inertia_defects"]
    assert defect.startswith("leg4_stem: a principal moment is zero")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["base", "missing.yaml"], ["missing.yaml", "3ups_rpu"]),
        (["base", "3ups_rpu", "--search", "genetic"], ["genetic", "exact", "subgroup", "qr"]),
        (["base", "3ups_rpu", "--criterion", "best"], ["best", "nullspace", "regressor"]),
        (["base", "3ups_rpu", "--model", "half"], ["half", "gravity", "full"]),
        (["base", "3ups_rpu", "--samples", "0"], ["samples", "0"]),
        (["base", "3ups_rpu", "--samples", "2"], ["rank", "samples"]),
        (["base", "3ups_rpu", "--lock", "elbow"], ["elbow", "leg1_stroke"]),
        (["base", "3ups_rpu", "--model", "full", "--search", "exhaustive"], ["C(74, 23)"]),
        (["base", "3ups_rpu", "--model", "full", "--search", "subgroup"], ["GiB"]),
        (["check", str(URDF / "generate.py")], ["generate.py", ".yaml", ".urdf"]),
        (["check", str(URDF)], ["urdf", "3ups_rpu"]),
    ],
)
def test_refusals_are_one_sentence_and_exit_code_2(run, arguments, words):
    done = run(*arguments)
    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert done.err.startswith("loopid: error: ")
    for word in words:
        assert word in done.err


@pytest.mark.parametrize(
    "arguments", [["base"], ["base", "5p", "--samples", "many"], ["base", "5p", "--depth"], ["fly"]]
)
def test_usage_errors_exit_with_2_and_no_traceback(run, arguments):
    done = run(*arguments)
    assert done.code == 2
    assert "Traceback" not in done.err


def test_a_refusal_in_a_process_of_its_own():
    script = [sys.executable, "-c", "from loopid.cli import main; main()", "check", "nowhere"]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("loopid: error: nowhere does not exist")


def test_heavy_libraries_are_imported_only_when_needed():
    heavy = ("yourdfpy", "trimesh", "mujoco", "dask", "sympy", "matplotlib")
    loaded = f"print([m for m in {heavy} if m in sys.modules])"
    script = f"import sys, loopid, loopid.cli; {loaded}; loopid.load_mechanism('3ups_rpu'); {loaded}"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[]", "['yourdfpy', 'trimesh']"]
