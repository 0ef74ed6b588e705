"""``loopid identify``: from logs on disk to parameters on the terminal, in JSON and in files."""

import json
import re
import stat
import warnings
from pathlib import Path

import pytest

from loopid import JointTerms
from loopid.experiment import find_force_model, identify, split_recordings
from loopid.logs import prepare_recording, read_log
from loopid.report import identification_record
from made_runs import friction, logged, wander

LINK = re.compile(r"!\[[^]]*\]\(([^)]+)\)")


def mass(record):
    """Estimated mass of the platform."""
    found = {entry["name"]: entry["value"] for entry in record["fit"]["parameters"]}
    return found["platform.m"]


def lines_of(text):
    return [line for line in text.splitlines() if line]


@pytest.fixture(scope="module")
def record(knee, logs):
    """What the library says of the first run."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recording = prepare_recording(knee, read_log(logs["run.csv"], knee))
        model = find_force_model(knee, "gravity", JointTerms(knee.actuated))
        return identification_record(identify(model, *split_recordings([recording])))


def test_the_command_says_what_the_library_says(run_json, logs, record):
    first, again = (run_json("identify", "3ups_rpu", logs["run.csv"]) for _ in range(2))
    assert first == again == json.loads(json.dumps(record))


def test_friction_and_gravity_are_found(record, friction_values):
    found = {entry["name"]: entry for entry in record["fit"]["parameters"]}
    for name, value in friction_values.items():
        assert found[name]["value"] == pytest.approx(value, rel=0.1)
    assert record["mechanism"] == "3ups_rpu"
    assert [part["name"] for part in record["training"]] == ["run"]
    assert 0.4 < record["training"][0]["samples"] / record["validation"][0]["samples"] < 2.5


def test_the_robot_file_is_confirmed_by_logs_of_it(record):
    baseline, full, supported = record["candidates"]
    assert baseline["name"] == "robot file"
    assert min(baseline["validation"]["r_squared"]) > 0.95
    assert not full["beats_baseline"]
    assert supported["fitted"] <= full["fitted"] == 23


def test_tables_and_files_say_the_same(run, logs, tmp_path):
    out = tmp_path / "new" / "results"
    done = run("identify", "3ups_rpu", logs["run.csv"], "--out", out)
    assert done.code == 0, done.err
    assert "platform.m" in done.out
    assert "all parameters by wls" in done.out
    page = (out / "report.md").read_text()
    links = LINK.findall(page)
    assert len(links) == 3
    assert all((out / link).stat().st_size > 1000 for link in links)
    names = {path.name for path in out.iterdir()}
    pictures = {
        f"{figure}.{kind}"
        for figure in ("forces", "parameters", "reduction")
        for kind in ("svg", "png")
    }
    assert names == {"report.md", "identification.json", *pictures}
    saved = json.loads((out / "identification.json").read_text())
    for label in (entry["name"] for entry in saved["fit"]["parameters"]):
        assert label in done.out
        assert label in page


def test_results_are_replaced_by_the_next_run(run, logs, tmp_path):
    for model_terms in ("none", "Fc,Fv"):
        done = run(
            "identify", "3ups_rpu", logs["run.csv"], "--out", tmp_path, "--terms", model_terms
        )
        assert done.code == 0
    saved = json.loads((tmp_path / "identification.json").read_text())
    assert len(saved["fit"]["parameters"]) == 23
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    mode = stat.S_IMODE((tmp_path / "report.md").stat().st_mode)
    (tmp_path / "plain").write_text("")
    assert mode == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_the_split_is_an_option(run_json, logs, record):
    little = run_json("identify", "3ups_rpu", logs["run.csv"], "--train", "0.3")
    sizes = [sum(part["samples"] for part in little[name]) for name in ("training", "validation")]
    whole = record["training"][0]["samples"] + record["validation"][0]["samples"]
    assert sum(sizes) == whole
    assert sizes[0] / whole == pytest.approx(0.3, abs=0.02)


def test_a_validation_log_takes_the_place_of_the_split(run_json, logs):
    found = run_json("identify", "3ups_rpu", logs["run.csv"], "--validate", logs["other.csv"])
    assert [part["name"] for part in found["training"]] == ["run"]
    assert [part["name"] for part in found["validation"]] == ["other"]
    assert found["validation"][0]["samples"] > 300


def test_several_logs_count_together(run_json, logs, record):
    found = run_json("identify", "3ups_rpu", logs["run.csv"], logs["other.csv"])
    assert [part["name"] for part in found["training"]] == ["run", "other"]
    errors = [
        [entry["standard_error"] for entry in each["fit"]["parameters"]] for each in (found, record)
    ]
    assert sum(two < one for two, one in zip(*errors, strict=True)) > 18


def test_friction_comes_from_its_own_log(run_json, knee, logs, tmp_path):
    terms, values = friction(knee)
    motion = wander(knee, 3, seconds=30.0, rate=50.0)
    path = tmp_path / "warm_up.csv"
    path.write_text(logged(knee, motion, (terms, 1.5 * values), seed=5))
    found = run_json("identify", "3ups_rpu", logs["run.csv"], "--friction-log", path)
    by_name = {entry["name"]: entry["value"] for entry in found["fit"]["parameters"]}
    for limb, value in enumerate((17.0, 22.0, 19.0, 230.0), 1):
        assert by_name[f"leg{limb}_stroke.Fc"] == pytest.approx(1.5 * value, rel=0.15)


def test_without_terms_only_bodies_are_fitted(run_json, knee, tmp_path):
    path = tmp_path / "smooth.csv"
    path.write_text(logged(knee, wander(knee, 1, seconds=30.0, rate=50.0)))
    found = run_json("identify", "3ups_rpu", path, "--terms", "none")
    assert len(found["fit"]["parameters"]) == 15
    assert found["candidates"][0]["fitted"] == 0


def test_the_estimator_is_an_option(run_json, logs):
    found = run_json("identify", "3ups_rpu", logs["run.csv"], "--estimator", "ols")
    assert found["fit"]["estimator"] == "ols"
    weights = {actuator["weight"] for actuator in found["fit"]["actuators"]}
    assert weights == {1.0}


def test_the_full_model_of_a_serial_robot_with_its_drives(run_json, arm_files):
    robot, log = arm_files
    found = run_json("identify", robot, log, "--model", "full", "--terms", "Ia,Fv", "--cutoff", "8")
    assert found["model"] == "full"
    assert found["actuators"] == ["shoulder", "elbow"]
    names = {entry["name"] for entry in found["fit"]["parameters"]}
    assert {"shoulder.Fv", "elbow.Ia", "lower.mx"} <= names
    assert found["training"][0]["cutoff"] == 8.0


def test_a_mapping_names_columns_and_units(run_json, log_texts, record, tmp_path):
    head, *rows = log_texts["run.csv"].splitlines()
    count = len(head.split(","))
    names = ["t_ms", *(f"c{k}" for k in range(1, count))]
    moved = []
    for row in rows:
        time, *values = (float(x) for x in row.split(","))
        scaled = [time * 1e3, *(1e3 * x for x in values[:4]), *(x / 28.0 for x in values[4:])]
        moved.append(",".join(f"{x:.10g}" for x in scaled))
    (tmp_path / "raw.csv").write_text("\n".join([",".join(names), *moved, ""]))
    (tmp_path / "mapping.yaml").write_text(
        "time: {column: t_ms, unit: ms}\n"
        "position: {columns: [c1, c2, c3, c4]}\n"
        "force: {columns: [c5, c6, c7, c8]}\n"
        "position_scale: 0.001\nforce_scale: 28.0\n"
    )
    mapping = ("--mapping", tmp_path / "mapping.yaml")
    found = run_json("identify", "3ups_rpu", tmp_path / "raw.csv", *mapping)
    assert mass(found) == pytest.approx(mass(record), rel=1e-3)


def test_json_alone_is_on_the_output_and_warnings_are_single_lines(run, logs):
    done = run("identify", "3ups_rpu", logs["run.csv"], "--json")
    json.loads(done.out)
    for line in lines_of(done.err):
        assert line.startswith("loopid: warning: ")
        assert "\x1b" not in line
        assert ".py" not in line
    assert any("do not tell" in line for line in lines_of(done.err))


def test_no_progress_bar_is_drawn_where_no_terminal_is(run, logs):
    done = run("identify", "3ups_rpu", logs["run.csv"])
    assert "assembling" not in done.out + done.err
    assert "━" not in done.out + done.err
    assert "\x1b" not in done.out + done.err
    assert "\r" not in done.out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--terms", "Fq"), ["'Fq'", "Fc", "Fv", "Ia"]),
        (("--estimator", "best"), ["'best'", "ols", "wls"]),
        (("--model", "half"), ["'half'", "gravity", "full"]),
        (("--train", "0"), ["between 0 and 1", "0"]),
        (("--train", "1.5"), ["between 0 and 1", "1.5"]),
        (("--train", "nan"), ["between 0 and 1", "nan"]),
        (("--cutoff", "-1"), ["cut-off", "positive"]),
        (("--cutoff", "1000"), ["cut-off", "half the sample rate"]),
        (("--mapping", "nowhere.yaml"), ["nowhere.yaml"]),
        (("--validate", "nowhere.csv"), ["nowhere.csv"]),
        (("--friction-log", "nowhere.csv"), ["nowhere.csv"]),
        (("--lock", "elbow"), ["elbow", "leg1_stroke"]),
    ],
)
def test_wrong_options_are_refused_in_one_sentence(run, logs, options, words):
    assert_refused(run("identify", "3ups_rpu", logs["run.csv"], *options), words)


def assert_refused(done, words):
    assert done.code == 2, done.out + done.err
    assert done.out == ""
    *warned, last = lines_of(done.err)
    assert all(line.startswith("loopid: warning: ") for line in warned)
    assert last.startswith("loopid: error: ")
    for word in words:
        assert word in last


def test_a_log_that_is_not_there_is_named(run, tmp_path):
    assert_refused(run("identify", "3ups_rpu", tmp_path / "no.csv"), ["no.csv"])
    assert_refused(run("identify", "nobody", tmp_path / "no.csv"), ["nobody", "3ups_rpu"])


def test_a_log_of_another_robot_is_refused(run, arm_files):
    _, log = arm_files
    assert_refused(run("identify", "3ups_rpu", log), ["arm.csv", "leg1_stroke"])


def test_too_few_rows_are_refused(run, log_texts, tmp_path):
    path = tmp_path / "short.csv"
    path.write_text("\n".join(log_texts["run.csv"].splitlines()[:4]) + "\n")
    assert_refused(run("identify", "3ups_rpu", path), ["short"])


def test_a_log_too_short_for_the_parameters_is_refused(run, log_texts, tmp_path):
    path = tmp_path / "brief.csv"
    path.write_text("\n".join(log_texts["run.csv"].splitlines()[:90]) + "\n")
    assert_refused(run("identify", "3ups_rpu", path), [])


def test_a_file_where_results_should_go_is_named_and_stays(run, logs, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine\n")
    done = run("identify", "3ups_rpu", logs["run.csv"], "--out", taken)
    assert done.code == 2
    assert lines_of(done.err)[-1].startswith(f"loopid: error: cannot write to {taken}")
    assert taken.read_text() == "mine\n"


def test_a_call_without_a_log_is_a_usage_error(run):
    done = run("identify", "3ups_rpu")
    assert done.code == 2
    assert "LOG" in done.err
    assert "Traceback" not in done.err


def test_a_real_log_is_identified(run_json, shared):
    folder = shared / "data" / "upv" / "logs" / "exp_18_12_2020-12_36_29"
    found = run_json("identify", "3ups_rpu", folder)
    assert found["training"][0]["name"] == Path(folder).name
    assert len(found["fit"]["parameters"]) == 23
    assert all(entry["value"] is not None for entry in found["fit"]["parameters"])
