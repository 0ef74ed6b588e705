"""``loopid identify``: from logs on disk to parameters on the terminal, in JSON and in files."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from lxml.html import fromstring

import loopid
from closure_robots import chain, files
from loopid import FitOptions, JointTerms
from loopid.cli.logs import excite_command
from loopid.identification import load_fit
from loopid.identification.data import read
from loopid.report import identification_report
from made_runs import logged, one_joint, quietly, wander

# No cut-off is sought, so that counts of samples compare, and no curve of friction.
PLAIN = ("--cutoff", "8", "--terms", "Fc,Fv")


def lines_of(text):
    return [line for line in text.splitlines() if line]


@pytest.fixture
def record(arm_files, once):
    """What the library says of the first run."""

    def told():
        options = FitOptions(model="gravity", terms="Fc,Fv,file")
        found = quietly(loopid.identify, loopid.load(arm_files[0]), arm_files[1], options=options)
        command = excite_command(found, found.force_model.robot, ["run.csv"])
        return identification_report(found, command).data

    return once("told", told)


@pytest.fixture
def written(run, arm_files, once, tmp_path):
    """What the command prints on both streams, and the contents of its files by name."""

    def identified():
        out = tmp_path / "new" / "results"
        terms = "--model", "gravity", "--terms", "Fc,Fv,file"
        done = run("identify", *arm_files[:2], *terms, "--out", out)
        assert done.code == 0, done.err
        return done.out, done.err, {path.name: path.read_bytes() for path in out.iterdir()}

    return once("identified", identified)


def test_the_command_says_what_the_library_says(written, record):
    _, err, files = written
    told = json.loads(files["identification.json"])
    assert re.sub(r"\S*run\.csv", "run.csv", told.pop("advice")) == record["advice"]
    # Advice is in the words of the command, or of Python.
    whole, other = (
        json.dumps(each).replace(r"model=\"full\"", "--model full") for each in (told, record)
    )
    assert json.loads(whole) == {k: v for k, v in json.loads(other).items() if k != "advice"}
    about_the_log = set(lines_of(err))
    for line in lines_of(err):
        assert line.startswith("loopid: warning: ")
        assert "\x1b" not in line
        assert ".py" not in line
        if "autocorrelated" in line:
            about_the_log.remove(line)
    assert not about_the_log  # it is a good one


def test_friction_is_found(record):
    found = {entry["name"]: entry for entry in record["all_parameters"]["base_parameters"]}
    for name, value in {"shoulder.Fc": 3.0, "elbow.Fc": 2.0}.items():
        assert found[name]["value"] == pytest.approx(value, rel=0.1)
    assert record["mechanism"] == "small"
    assert [part["name"] for part in record["training"]] == ["run"]
    assert record["validation"] == []  # each segment is judged by fits to the others


def test_the_terminal_shows_the_verdict_first_and_the_place_last(written, record):
    lines = written[0].splitlines()
    assert lines[0].startswith("small, gravity model: Fit for ")
    assert lines[-1].startswith("Report: ")
    assert lines[-1].endswith("report.html")
    assert all(len(line) <= 80 for line in lines[:-1])
    said = [line for line in written[1].splitlines() if line]  # on a terminal, a line each
    assert len(lines) + len(said) <= 25
    assert len(record["fit"]["base_parameters"]) == 8


def test_terminal_page_and_files_say_the_same(written, tmp_path):
    out, _, files = written
    page = files["report.html"].decode()
    fits = {"parameters.yaml", "all_parameters.yaml"}
    assert set(files) == {"report.html", "identification.json", *fits}
    saved = json.loads(files["identification.json"])
    for name, record in (("parameters", "fit"), ("all_parameters", "all_parameters")):
        (tmp_path / "fit.yaml").write_bytes(files[f"{name}.yaml"])
        assert load_fit(tmp_path / "fit.yaml").record() == saved[record]
    names = [entry["name"] for entry in saved["fit"]["base_parameters"]]
    assert all(name in page for name in names)
    left = [name for name in names if name not in out]
    assert not left or f"... and {len(left)} more in the report" in out


def test_figures_for_papers_are_drawn_where_asked_for(run, arm_files, tmp_path):
    done = run("identify", *arm_files[:2], "--out", tmp_path, "--figures")
    assert done.code == 0, done.err
    drawn = {"errors", "filter", "forces", "friction", "parameters", "robot"}
    for name in drawn:
        assert "<svg" in (tmp_path / f"{name}.svg").read_text()
    try:
        import cairosvg  # noqa: F401
    except (ImportError, OSError):
        return
    assert all((tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF") for name in drawn)


def test_all_tables_are_shown_where_asked_for(run, arm_files):
    brief, whole = (run("identify", *arm_files[:2], *more).out for more in ((), ("--verbose",)))
    assert brief.splitlines()[:4] == whole.splitlines()[:4]
    assert "essential parameters" in whole
    assert "essential parameters" not in brief
    assert len(brief.splitlines()) < 25 < len(whole.splitlines())


def test_terms_of_single_joints_are_fitted(run_json, run, arm_files):
    robot, log, _ = arm_files
    options = ["--model", "full", "--terms", "Fv; shoulder: Fc", "--cutoff", "8"]
    record = run_json("identify", robot, log, *options)
    assert record["joint_terms"] == {"shoulder": ["Fv", "Fc"], "elbow": ["Fv"]}
    done = run("identify", robot, log, "--terms", "wrist: Fc")
    assert done.code == 2
    assert "unknown joint 'wrist': choose among shoulder, elbow, passive" in done.err


def test_the_usual_terms_are_the_default(run_json, arm_files):
    of_gravity = "--model", "gravity", "--cutoff", "8"
    for options, usual in {of_gravity: ["Fc", "Fv", "Fo"], (): ["Fc", "Fv", "Fo", "Ia"]}.items():
        record = run_json("identify", *arm_files[:2], *options)
        assert record["model"] == ("gravity" if options else "full")
        for kinds in record["joint_terms"].values():  # offsets that data do not tell are left out
            assert [kind for kind in usual if kind in {*kinds, "Fo"}] == usual
            assert set(kinds) <= set(usual)


@pytest.fixture
def arm(run_json, arm_files, once):
    """Identify the serial robot from its first log."""

    def identified(*options):
        return run_json("identify", *arm_files[:2], *PLAIN, *options)

    return lambda *options: identified(*options) if options else once("arm", identified)


def fitted(record):
    """Estimates by name."""
    return {entry["name"]: entry["value"] for entry in record["all_parameters"]["base_parameters"]}


def test_the_split_is_an_option(arm):
    whole = arm()
    little = arm("--train", "0.3")
    counts = [
        [sum(part["samples"] for part in record[name]) for name in ("training", "validation")]
        for record in (whole, little)
    ]
    assert sum(counts[0]) == sum(counts[1])
    assert counts[0][1] == 0
    assert counts[1][0] / sum(counts[1]) == pytest.approx(0.3, abs=0.02)


def test_a_validation_log_takes_the_place_of_the_split(arm, arm_files):
    whole, found = arm(), arm("--validate", arm_files[2])
    assert [part["name"] for part in found["training"]] == ["run"]
    assert [part["name"] for part in found["validation"]] == ["other"]
    assert found["training"][0]["samples"] == whole["training"][0]["samples"]


@pytest.mark.validate
def test_friction_comes_from_its_own_log(arm, arm_files, tmp_path):
    robot = loopid.load(arm_files[0])
    terms = JointTerms(robot.actuated), 1.5 * np.array([3.0, 1.0, 2.0, 0.5])
    path = tmp_path / "warm_up.csv"
    motion = wander(robot, 3, seconds=15.0, rate=50.0, size=(1.0, 1.2))
    path.write_text(logged(robot, motion, terms, noise=0.1, seed=5))
    found = fitted(arm("--friction-log", path))
    assert found["shoulder.Fc"] == pytest.approx(4.5, rel=0.15)
    assert found["elbow.Fc"] == pytest.approx(3.0, rel=0.15)


@pytest.mark.validate
def test_without_terms_only_bodies_are_fitted(arm):
    found = arm("--model", "gravity", "--terms", "none")
    leading = {name.partition(" + ")[0] for name in fitted(found)}
    assert leading == {"upper.mx", "upper.mz", "lower.mx", "lower.mz"}
    assert found["candidates"][0]["fitted"] == 0


def test_terms_are_those_that_are_named(arm):
    names = set(fitted(arm("--terms", " Fo , Fc")))
    joints = {f"{joint}.{kind}" for joint in ("shoulder", "elbow") for kind in ("Fo", "Fc")}
    assert {name for name in names if name.partition(".")[0] in ("shoulder", "elbow")} == joints


@pytest.mark.validate
def test_the_full_model_with_drives_is_an_option(arm):
    found = arm("--model", "full", "--terms", "Ia,Fv")
    assert found["model"] == "full"
    assert found["actuators"] == ["shoulder", "elbow"]
    assert {"shoulder.Fv", "elbow.Ia", "lower.mx"} <= set(fitted(found))
    assert found["training"][0]["cutoff"] == 8.0


def test_a_mapping_names_columns_and_units(run_json, arm, arm_files, tmp_path):
    robot, log, _ = arm_files
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    rows *= [1e3, 180 / np.pi, 180 / np.pi, 1 / 28.0, 1 / 28.0]
    text = "\n".join(",".join(f"{x:.12g}" for x in row) for row in rows)
    (tmp_path / "run.csv").write_text(f"t_ms,a,b,c,d\n{text}\n")
    (tmp_path / "mapping.yaml").write_text(
        "time: {column: t_ms, unit: ms}\n"
        "position: {columns: [a, b]}\nforce: {columns: [c, d]}\n"
        f"position_scale: {np.pi / 180}\nforce_scale: 28.0\n"
    )
    mapping = ("--mapping", tmp_path / "mapping.yaml")
    found = fitted(run_json("identify", robot, tmp_path / "run.csv", *mapping, *PLAIN))
    assert found == pytest.approx(fitted(arm()), rel=1e-4)


def test_each_log_may_have_a_mapping_of_its_own(run, run_json, arm_files, tmp_path):
    robot, log, _ = arm_files
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    mappings = []
    for name, scale in (("ab", 1.0), ("cd", 1e3)):
        columns = [f"{name}{k}" for k in range(4)]
        text = "\n".join(
            ",".join(f"{x:.12g}" for x in row) for row in rows * [1, 1, 1, scale, scale]
        )
        (tmp_path / f"{name}.csv").write_text(f"time,{','.join(columns)}\n{text}\n")
        (tmp_path / f"{name}.yaml").write_text(
            f"position: {{columns: {columns[:2]}}}\nforce: {{columns: {columns[2:]}}}\n"
            f"force_scale: {1 / scale}\n"
        )
        mappings += ["--mapping", tmp_path / f"{name}.yaml"]
    logs = [tmp_path / "ab.csv", "--validate", tmp_path / "cd.csv"]
    found = run_json("identify", robot, *logs, *mappings, *PLAIN)
    alone = run_json("identify", robot, log, "--validate", log, *PLAIN)
    assert fitted(found) == pytest.approx(fitted(alone), rel=1e-4)
    refused = run("identify", robot, logs[0], *mappings)
    assert refused.code == 2
    assert (
        "once for each in the order of LOG, --validate, --reference, --friction-log" in refused.err
    )
    assert "not 2 times for 1 log" in refused.err


def test_no_progress_bar_is_drawn_where_no_terminal_is(run, arm_files):
    done = run("identify", *arm_files[:2])
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
        (("--train", "nan"), ["--train", "nan"]),
        (("--cutoff", "-1"), ["cutoff", "above 0"]),
        (("--cutoff", "1000"), ["cut-off", "half the sample rate"]),
        (("--mapping", "nowhere.yaml"), ["nowhere.yaml"]),
        (("--validate", "nowhere.csv"), ["nowhere.csv"]),
        (("--friction-log", "nowhere.csv"), ["nowhere.csv"]),
        (("--lock", "knee"), ["knee", "shoulder"]),
        (("--jobs", "0"), ["--jobs", "0"]),
    ],
)
def test_wrong_options_are_refused_in_one_sentence(run, arm_files, options, words):
    assert_refused(run("identify", *arm_files[:2], *options), words)


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
    assert_refused(run("identify", "3ups_rpu", arm_files[1]), ["run.csv", "leg1_stroke"])


def test_a_log_too_short_for_the_parameters_is_refused(run, log_texts, tmp_path):
    path = tmp_path / "brief.csv"
    path.write_text("\n".join(log_texts["run.csv"].splitlines()[:50]) + "\n")
    assert_refused(run("identify", "3ups_rpu", path, "--unidentifiable", "error"), [])


def test_a_file_where_results_should_go_is_named_and_stays(run, arm_files, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine\n")
    done = run("identify", *arm_files[:2], "--out", taken)
    assert_refused(done, [f"cannot write to {taken}"])
    assert taken.read_text() == "mine\n"


def test_a_call_without_a_log_is_a_usage_error(run):
    done = run("identify", "3ups_rpu")
    assert done.code == 2
    assert "LOG" in done.err
    assert "Traceback" not in done.err


@pytest.mark.validate
def test_a_real_log_is_identified(run_json, mechanism, real_log):
    found = run_json("identify", mechanism.name, real_log, "--model", "gravity", "--terms", "Fc,Fv")
    assert found["training"][0]["name"] == real_log.name
    assert len(found["all_parameters"]["base_parameters"]) == 23
    assert all(entry["value"] is not None for entry in found["all_parameters"]["base_parameters"])


@pytest.fixture(scope="module")
def elbow_log(arm_files, tmp_path_factory):
    """A log of the serial robot in which only the elbow moves."""
    arm = loopid.load(arm_files[0])
    terms = JointTerms(arm.actuated), np.array([3.0, 1.0, 2.0, 0.5])
    path = tmp_path_factory.mktemp("elbow") / "elbow.csv"
    motion = one_joint(arm, 1, 1.0, seconds=20.0, rate=50.0)
    path.write_text(logged(arm, motion, terms, noise=0.1))
    return str(path)


def test_unidentifiable_combinations_are_refused_with_the_motion_to_add(
    run, run_json, arm_files, elbow_log, tmp_path
):
    words = "unidentifiable from the data", "shoulder.Fc", "--unidentifiable prior"
    command = "identify", arm_files[0], elbow_log, *PLAIN, "--unidentifiable"
    refused = run(*command, "error")
    assert_refused(refused, words)
    # The command that the record tells works as it is typed, and its motion excites all of them.
    record = run_json(*command, "prior")
    places = {"motion": str(tmp_path)}
    advised = [places.get(word, word) for word in shlex.split(record["advice"])]
    designed = run(*advised[1:], "--starts", "1", "--evaluations", "5", "--json")
    assert designed.code == 0, designed.err
    assert np.isfinite(json.loads(designed.out)["condition_number"])
    done = run(*command, "truncate")
    assert_refused(done, ["'truncate'", "error, prior"])


def test_values_of_the_robot_file_are_marked_everywhere(
    run, run_json, arm_files, elbow_log, tmp_path
):
    command = "identify", arm_files[0], elbow_log, *PLAIN, "--unidentifiable", "prior"
    done = run(*command, "--out", tmp_path)
    assert done.code == 0, done.err
    assert "unidentifiable combinations excite the least known: " in " ".join(done.out.split())
    advised = re.search(r"least known: loopid (.*?--after \S+)", " ".join(done.out.split()))
    designed = run(*shlex.split(advised[1]), "--starts", "1", "--evaluations", "5")
    assert designed.code == 0, designed.err
    assert "design_motion" not in done.out
    assert "unidentifiable" not in done.err  # said once
    record = json.loads((tmp_path / "identification.json").read_text())
    told, assumed = record["identifiability"], record["all_parameters"]["estimate"]["assumed"]
    assert {"shoulder.Fc", "shoulder.Fv"} <= set(assumed)
    assert load_fit(tmp_path / "parameters.yaml").assumed == tuple(assumed)
    assert len(told["unidentifiable"]) == told["structural_rank"] - told["rank"] > 0
    page = fromstring((tmp_path / "report.html").read_text())
    rows = [[cell.text for cell in row] for row in page.iter("tr")]
    for direction in told["unidentifiable"]:
        assert direction["standard_error"] is None
        assert [direction["combination"], "0", "unknown: as in the file"] in rows
    assert record["advice"] in page.text_content()
    for entry in record["all_parameters"]["base_parameters"]:
        unbounded = entry["interval_95_percent"] == [None, None]
        assert unbounded == (entry["name"] in assumed)
    assert any("rest on it" in found["why"] for found in record["findings"])
    assert told["effects"] == sorted(told["effects"], reverse=True)
    assert told["better_than_robot_file"] <= told["rank"]
    assert all(direction["standard_error"] > 1 for direction in told["weak"])


@pytest.mark.validate
def test_an_estimator_goes_by_its_name(arm):
    found = arm("--estimator", "bisquare")
    assert found["all_parameters"]["estimate"]["estimator"] == "bisquare"
    values = {entry["name"]: entry["value"] for entry in found["all_parameters"]["base_parameters"]}
    for name, value in (("shoulder.Fc", 3.0), ("elbow.Fc", 2.0)):
        assert values[name] == pytest.approx(value, rel=0.1)


def test_instruments_are_commanded_positions_without_forces(run, arm, arm_files, tmp_path):
    robot, log, _ = arm_files
    rows = [line.split(",") for line in Path(log).read_text().splitlines()]
    moves = [k for k, name in enumerate(rows[0]) if "force" not in name]
    assert len(moves) < len(rows[0])
    commanded = tmp_path / "commanded.csv"
    commanded.write_text("\n".join(",".join(row[k] for k in moves) for row in rows))
    found = arm("--estimator", "iv", "--reference", commanded)
    assert found["all_parameters"]["estimate"]["estimator"] == "iv"
    assert_refused(run("identify", robot, log, "--estimator", "iv"), ["reference"])
    assert_refused(run("identify", robot, log, "--reference", log), ["'wls'"])


def test_a_floating_base_is_refused_by_name(run, arm_files):
    done = run("identify", *arm_files[:2], "--floating-base")
    assert_refused(done, ["root_joint.vx", "--lock"])


def test_mimics_that_are_free_need_signals_of_their_own(run, tmp_path, arm_files):
    joint = '<joint name="elbow" type="revolute">'
    mimic = f'{joint}<mimic joint="shoulder" multiplier="0.5"/>'
    text = Path(arm_files[0]).read_text().replace(joint, mimic)
    (tmp_path / "mimic.urdf").write_text(text)
    command = "identify", tmp_path / "mimic.urdf", arm_files[1]
    free = run(*command, "--free-mimics", *PLAIN, "--json")
    assert free.code == 0, free.err
    assert json.loads(free.out)["actuators"] == ["shoulder", "elbow"]


def test_a_part_of_a_log_is_fitted(arm, run, arm_files):
    robot, log, _ = arm_files
    found = arm("--from", "2", "--to", "12")
    spans = [part["samples"] for part in found["training"] + found["validation"]]
    whole = [part["samples"] for part in arm()["training"] + arm()["validation"]]
    assert sum(spans) == pytest.approx(sum(whole) * 10 / 20, rel=0.1)
    done = run("identify", robot, log, "--from", "5", "--to", "2")
    assert done.code == 2
    assert "--to must be above 5 s, not 2" in done.err


@pytest.mark.validate
def test_some_rows_of_a_log_are_fitted(arm, run, arm_files):
    robot, log, _ = arm_files
    found = arm("--rows", "100:500")
    dropped = found["training"][0]["dropped"]
    assert all(float(line.split()[-2]) < 8.02 for line in dropped)  # 401 rows at 50 Hz
    for rows, words in {
        "9000:": ["[9000:] has 0 rows of numbers"],
        "5:4": ["first before the last"],
        "0:4": ["counted from 1"],
        "7": ["--rows must be M:N", "'7'"],
    }.items():
        assert_refused(run("identify", robot, log, "--rows", rows), words)
    assert_refused(
        run("identify", robot, log, "--rows", "1:", "--reference", log), ["--from and --to"]
    )


def test_a_log_that_is_fitted_and_validates_is_named(arm_files, run):
    robot, log, _ = arm_files
    said = run("identify", robot, log, *PLAIN, "--validate", log).err
    assert "is fitted and validates" in said


@pytest.mark.parametrize("kind", [r"--unidentifiable [a-z]+", r"--lock [\w.]+"])
def test_advice_can_be_followed_as_it_is_printed(kind, run, arm_files, elbow_log):
    robot, log, _ = arm_files
    words = [robot, elbow_log] if "unid" in kind else [robot, log, "--floating-base"]
    refused = run("identify", *words, *(["--unidentifiable", "error"] if "unid" in kind else []))
    assert refused.code == 2
    advice = " ".join(re.findall(kind, refused.err)).split()
    assert advice
    done = run("identify", *words, *PLAIN, *advice)
    assert done.code == 0, done.err


def test_that_nothing_was_saved_is_said(run, arm_files):
    done = run("identify", *arm_files[:2])
    assert done.code == 0
    assert done.out.splitlines()[-1].startswith("Nothing was saved: --out DIR")
    record = json.loads(run("identify", *arm_files[:2], "--json").out)
    assert record["written"] == []


def test_what_was_saved_is_said(run, arm_files, tmp_path):
    out = tmp_path / "results"
    last = run("identify", *arm_files[:2], "--out", out).out.splitlines()[-1]
    assert last == f"Report: {out / 'report.html'}"


def test_a_joint_is_locked_where_the_log_has_it(run, write_files, tmp_path):
    path, time = write_files(*files(chain(2), {})), np.arange(400) / 50
    turned, rate = 0.2 * np.sin(2 * time)[:, None], 0.4 * np.cos(2 * time)[:, None]
    arm = quietly(loopid.load, path, lock=["joint1=0.5"])
    force = loopid.Dynamics(arm).inverse(turned, rate, -4 * turned)
    force = force + 0.1 + np.random.default_rng(0).normal(scale=0.01, size=force.shape)
    log = tmp_path / "run.csv"
    table = np.column_stack([time, np.full(400, 0.5), turned, force])
    head = "time,joint1,joint2,joint2.force"
    np.savetxt(log, table, delimiter=",", comments="", header=head)
    options = "--lock", "joint1", "--model", "gravity", "--unidentifiable", "prior", *PLAIN
    done = run("identify", path, log, *options, "--json")
    assert "locked where the log has it: joint1 at 0.5" in done.err
    record = json.loads(done.out)
    assert record["fit"]["robot"]["options"]["lock"] == ["joint1=0.5"]
    assert "--lock joint1 " in f"{record['advice']} "  # --after has it where the log has
    locked, _ = quietly(read, quietly(loopid.load, path, lock=["joint1"]), str(log))
    assert locked.options["lock"] == ("joint1=0.5",)
