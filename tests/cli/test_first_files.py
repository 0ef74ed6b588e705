"""``loopid init`` and ``schema``: files to begin with, and what editors and shells complete."""

import json
import shlex

import jsonschema
import numpy as np
import pytest
import typer
from ruamel.yaml import YAML

import loopid
from loopid.cli import app, completion
from loopid.export import write_first_files
from loopid.export.first_files import file_schema
from loopid.kinematics import mobility
from loopid.loading.files import bundled_directory
from made_runs import ARM

COMMANDS = typer.main.get_command(app).commands


def read(text):
    return YAML(typ="safe", pure=True).load(text)


@pytest.fixture
def open_bar(tmp_path):
    """A five-bar whose loop is cut open, as its file shows by the names of two frames."""
    urdf = (bundled_directory() / "five_bar.urdf").read_text()
    for end, name in (("left_coupler_end", "pin_a"), ("right_coupler_end", "pin_b")):
        urdf = urdf.replace(end, name)
    (tmp_path / "bar.urdf").write_text(urdf)
    return tmp_path / "bar.urdf"


def test_the_first_yaml_closes_the_loop_that_the_file_shows(open_bar, run, monkeypatch):
    monkeypatch.chdir(open_bar.parent)
    done = run("init", open_bar.name)
    assert done.code == 0, done.err
    assert "loopid check bar.yaml" in done.out
    assert "--mapping bar_mapping.yaml" in done.out
    given = read((open_bar.parent / "bar.yaml").read_text())
    assert given["urdf"] == "bar.urdf"
    assert "name_mot" not in given  # only the user knows
    with pytest.warns(loopid.errors.ModelWarning) as caught:
        robot = loopid.load("bar.yaml")
    assert any("does not say which joints have motors" in str(w.message) for w in caught)
    known = loopid.load("five_bar")
    assert [mobility(each).degrees_of_freedom for each in (robot, known)] == [2, 2]
    again = run("init", open_bar.name)
    assert (again.code, "is there already" in again.err) == (2, True)


def test_what_is_a_comment_is_valid_where_it_is_uncommented(open_bar, tmp_path):
    yaml, mapping = write_first_files(open_bar, folder=tmp_path / "new")
    for file, kind in ((yaml, "robot"), (mapping, "mapping")):
        lines = file.read_text().splitlines()
        keys = tuple(file_schema(kind)["properties"])
        bare = [line.removeprefix("# ") for line in lines]
        told = [x for x in bare if x.startswith((" ", *(f"{key}:" for key in keys)))]
        jsonschema.validate(read("\n".join(told)), file_schema(kind))


def test_columns_that_are_found_by_name_are_mapped(tmp_path):
    robot = loopid.load("five_bar")
    names = [f"{joint}_{what}" for what in ("pos", "torque") for joint in robot.actuated]
    rows = np.column_stack([np.arange(9), *np.zeros((4, 9))])
    log = tmp_path / "run.csv"
    np.savetxt(log, rows, delimiter=",", header=",".join(["time [ms]", *names]), comments="")
    _, mapping = write_first_files("five_bar", log, folder=tmp_path)
    found = read(mapping.read_text())
    assert found["time"] == {"column": "time [ms]"}
    assert [*found["position"].values(), *found["force"].values()] == names
    log.write_text(log.read_text().replace("pos", "quux"))
    _, mapping = write_first_files("five_bar", log, folder=tmp_path / "other")
    text = mapping.read_text()
    assert "left_crank_joint_quux" in text
    assert "Not found by name: " in text
    assert "position" not in read(text)
    assert [*read(text)["force"].values()] == names[2:]


def test_currents_that_are_found_by_name_need_their_forces(tmp_path):
    robot = loopid.load("five_bar")
    for name, values in (("encoders", 0.1), ("motor_current_mA", 20.0)):
        rows = np.column_stack([np.arange(9), *np.full((2, 9), values)])
        head = ",".join(["t", *robot.actuated])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=head, comments="")
    _, mapping = write_first_files("five_bar", tmp_path, folder=tmp_path)
    found = read(mapping.read_text())
    assert found["force_scale"] == 1.0
    assert found["position"] == {joint: f"encoders:{joint}" for joint in robot.actuated}
    assert found["force"] == {joint: f"motor_current_mA:{joint}" for joint in robot.actuated}
    assert "force_scale is the force of one of their units" in mapping.read_text()


SAID = {
    "an unknown key": ("robot", {"closurs": []}),
    "a key of another kind": (
        "robot",
        {"closures": [{"type": "hinge", "frames": ["a", "b"], "length": 1}]},
    ),
    "an unknown kind": ("robot", {"closures": [{"type": "magnet", "frames": ["a", "b"]}]}),
    "an unknown format": ("mapping", {"format": "xls"}),
    "an unknown step": (
        "motions",
        {"coordinates": ["a"], "motions": {"m": {"steps": [{"go": 1}]}}},
    ),
}


@pytest.mark.parametrize("case", SAID)
def test_editors_mark_what_is_refused(case):
    kind, content = SAID[case]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, file_schema(kind))


def test_schemas_accept_the_bundled_files(run):
    forms = {kind: json.loads(run("schema", kind).out) for kind in ("robot", "motions")}
    files = [bundled_directory() / f"{name}.yaml" for name in loopid.bundled_robots()]
    for file in files:
        jsonschema.validate(read(file.read_text()), forms["robot"])
    motions = sorted(bundled_directory().glob("*_motions.yaml"))
    for file in motions:
        jsonschema.validate(read(file.read_text()), forms["motions"])
    assert len(files) > 5
    assert motions
    assert run("schema", "robt").err.count("did you mean 'robot'") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_an_example_that_it_parses(name):
    command = COMMANDS[name]
    program, called, *words = shlex.split(command.epilog.removeprefix("Example: "))
    assert (program, called) == ("loopid", name)
    command.make_context(name, words[: words.index(">")] if ">" in words else words)


def test_shells_complete_robots_joints_models_and_terms(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for name in ("five.urdf", "five.csv"):
        (tmp_path / name).write_text("")
    assert completion.robots("five") == ["five_bar", "five.urdf"]
    assert completion.robots("fo") == ["four_bar", "folder/"]
    context = typer.Context(COMMANDS["base"])
    context.params["file"] = "five_bar"
    assert completion.joints(context, "left_cr") == ["left_crank_joint"]
    assert "left_crank" in completion.links(context, "left")
    context.params["file"] = "nothing"
    assert completion.joints(context, "") == []
    assert completion.models("g") == ["gravity"]
    assert "Fc,Fv" in completion.terms("Fc,F")
    assert "file" in completion.terms("f")


@pytest.mark.parametrize(
    ("command", "option", "start", "words"),
    [
        ("identify", "estimator", "b", ["bisquare"]),
        ("payload", "estimator", "o", ["ols"]),
        ("base", "search", "", ["exact", "subgroup", "qr"]),
        ("base", "criterion", "r", ["regressor"]),
        ("excite", "criterion", "", ["D", "A", "E", "condition"]),
        ("excite", "solver", "s", ["slsqp"]),
        ("schema", "kind", "m", ["mapping", "motions"]),
    ],
)
def test_shells_complete_words(command, option, start, words):
    (known,) = (each for each in COMMANDS[command].params if each.name == option)
    found = known.shell_complete(typer.Context(COMMANDS[command]), start)
    assert [each.value for each in found] == words


def test_what_a_mapping_advises_is_in_the_words_of_who_asks(run, tmp_path):
    """And of a robot whose motors are not known, joints without forces are not asked for."""
    log = tmp_path / "run.csv"
    log.write_text("time,left_crank_joint_pos,left_crank_joint_torque\n0,1,2\n0.1,2,3\n")
    _, mapping = write_first_files("five_bar", log, folder=tmp_path / "python")
    assert 'lock=["right_crank_joint"]' in mapping.read_text()
    done = run("init", "five_bar", log, "--out", tmp_path / "command")
    printed = [shlex.split(line)[1:] for line in done.out.splitlines() if "  loopid " in line]
    assert [name for name, *_ in printed] == ["check", "view", "base", "excite", "identify"]
    for name, *words in printed:  # that it parses
        COMMANDS[name].make_context(name, words)
    text = (tmp_path / "command" / "five_bar_mapping.yaml").read_text()
    assert "--lock right_crank_joint" in text
    assert "lock=" not in text
    # What is to be filled in is what was written.
    assert done.out.startswith(f"Fill in {tmp_path / 'command' / 'five_bar_mapping.yaml'}. Then:")


def test_joints_that_have_forces_in_the_log_are_the_motors(open_bar, run):
    robot, (free, held) = loopid.load("five_bar"), ("left_coupler_joint", "right_coupler_joint")
    log = open_bar.parent / "run.csv"
    names = [f"{joint}.{what}" for what in ("position", "force") for joint in robot.actuated]
    rows = np.column_stack([np.arange(9), *np.zeros((4, 9))])
    np.savetxt(log, rows, delimiter=",", header=",".join(["time", *names]), comments="")
    yaml, mapping = write_first_files(open_bar, log, folder=open_bar.parent)
    assert read(yaml.read_text())["name_mot"] == [*robot.actuated]
    assert [*read(mapping.read_text())["force"]] == [*robot.actuated]
    _, mapping = write_first_files(open_bar, folder=open_bar.parent / "without")
    assert not {free, held} & {*mapping.read_text().replace(":", " ").split()}


ARM_LOG = "--rate 50 --noise 0.05 --terms Fc=0.4,Fv=0.3"


@pytest.mark.validate
@pytest.mark.parametrize("kind", ["serial", "bundled", "open loop"])
def test_the_commands_that_init_prints_work_as_they_stand(kind, open_bar, run, monkeypatch):
    """The log for ``identify`` is simulated along the motion that ``excite`` writes."""
    monkeypatch.chdir(open_bar.parent)
    monkeypatch.setattr("loopid.view.viewer.Viewer.wait", lambda viewer: None)
    if kind == "serial":
        (open_bar.parent / "arm.urdf").write_text(ARM)
    file = {"bundled": "five_bar", "serial": "arm.urdf", "open loop": open_bar.name}[kind]
    if kind == "open loop":  # who names no motors has no motion of them
        log = bundled_directory() / "logs" / "five_bar.csv"
    else:
        log = open_bar.parent / "run.csv"
        drawn = run("excite", file, "--model", "full", "--max-speed", "2", "--out", "first",
                    "--evaluations", "20", "--max-acceleration", "10")  # fmt: skip
        assert drawn.code == 0, drawn.err
        made = run("simulate", file, "first/motion.yaml", *ARM_LOG.split(), "--out", log)
        assert made.code == 0, made.err
    done = run("init", file, log)
    assert done.code == 0, done.err
    commands = [line for line in done.out.splitlines() if line.startswith("  loopid ")]
    assert [line.split()[1] for line in commands] == ["check", "view", "base", "excite", "identify"]
    for line in commands:
        found = run(*shlex.split(line)[1:])
        assert found.code == 0, f"{line}: {found.err}"
