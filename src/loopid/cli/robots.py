"""Commands on a robot: what it is, its base parameters, its motions."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import typer
from typer import Argument, Option

from loopid.cli import completion
from loopid.cli.advice import command_with, in_options
from loopid.cli.shell import Answer, with_options
from loopid.errors import OptionError, counted, shown
from loopid.files import require_ending, require_name, require_other_file, write_file, write_files
from loopid.progress import progress_bar

if TYPE_CHECKING:
    from loopid.logs.recording import Recording
    from loopid.motion.files import MotionProgram
    from loopid.robot.robot import Robot

FILE = Argument(
    ...,
    metavar="FILE",
    help="Robot: a YAML, URDF, MJCF or SDF, or a bundled one's name.",
    autocompletion=completion.robots,
)
XACRO = Option(None, metavar="KEY:=VALUE", help="Argument of a xacro; repeatable.")
MOTIONS = Argument(None, metavar="MOTIONS", help="Motion YAML; by default the robot's bundled one.")
LOG_ENDINGS = (".csv", ".txt", ".tsv")
MODELS = "gravity (slow motion) or full (all ten parameters a body)"
MODEL = Option("gravity", help=f"{MODELS}.", autocompletion=completion.models)
LOGGED_MODEL = Option(
    "auto", help=f"{MODELS}; auto: the one that LOG needs.", autocompletion=completion.models
)
TERMS = (
    "Forces in the joints: Coulomb (Fc) and viscous (Fv) friction, offset (Fo), armature (Ia), "
    "spring (Ks). Of all motors, as Fc,Fv,Fo; with some joints' own, as "
    '"Fc,Fv; elbow: Ks; passive: Fv"; file: those that the robot file gives; none.'
)
GIVEN_TERMS = Option("none", help=TERMS, autocompletion=completion.terms)
MAPPING = Option(None, metavar="YAML", help="File that says which columns of LOG are what.")
MAPPINGS = Option(
    None,
    metavar="YAML",
    help="File that says which columns of LOG are what: one for all, or one a log, in order.",
)


def loaded(
    file: str = FILE,
    lock: list[str] | None = Option(
        None,
        metavar="JOINT[=VALUE]",
        help="Lock a joint, or a turn such as ball.wz, at its reference or a value; repeatable.",
        autocompletion=completion.joints,
    ),
    rounding: float | None = Option(
        None, help="Rounding of the file's numbers in m and rad: loops may be open by it."
    ),
    floating_base: bool = Option(
        False, "--floating-base", help="The root of the URDF moves freely."
    ),
    free_mimics: bool = Option(
        False, "--free-mimics", help="Joints that mimic others move on their own."
    ),
    tied: bool = Option(
        False, "--tied", help="Links that the YAML calls identical share parameters."
    ),
    xacro: list[str] | None = XACRO,
) -> Any:
    """The robot (``Robot``) that the options of a command name."""
    from loopid.loading.robot_files import load

    with progress_bar("robot"):
        return load(
            file,
            lock=lock or (),
            floating_base=floating_base,
            free_mimics=free_mimics,
            tied=tied,
            rounding=rounding,
            xacro=macro_arguments(xacro),
        )


of_robot = with_options(robot=loaded, answer=Answer)


@of_robot
def check(robot: Robot, answer: Answer) -> None:
    """Show joints, loop closures, mobility and singularities."""
    from loopid.report.structure import check_report

    answer.require(robot.path)
    answer.show(check_report(robot), command_with("base", robot))


@of_robot
def base(
    robot: Robot,
    answer: Answer,
    model: str = MODEL,
    search: str = Option(
        "exact",
        help="exact, subgroup or qr.",
        autocompletion=completion.words_of("base_parameters.base:SEARCHES"),
    ),
    alpha: float | None = Option(
        None, help="Subgroup search: group rising factor, above 0, at most 0.5; 0.25 by default."
    ),
    cond_limit: float | None = Option(
        None, help="Subgroup search: valid combinations are below; 2000 by default."
    ),
    variant: str | None = Option(
        None, help="Subgroup search: gap, by default, or pseudocode, as printed in the paper."
    ),
    terms: str = GIVEN_TERMS,
    criterion: str = Option(
        "nullspace",
        help="nullspace (cond V22) or regressor (cond W_B).",
        autocompletion=completion.words_of("base_parameters.choice:CRITERIA"),
    ),
    samples: int | None = Option(None, help="Number of random closed poses; enough by default."),
    seed: int = Option(0, help="Seed of the random poses."),
    time_limit: float | None = Option(
        None, metavar="S", help="Processor time of the search in s, at most; 10 by default."
    ),
) -> None:
    """Find base parameters, and prove how to write them best."""
    from loopid.base_parameters.base import find_base_and_motors_alone
    from loopid.base_parameters.choice import SearchOptions
    from loopid.regressors.joint_terms import JointTerms, warn_of_omitted
    from loopid.regressors.structural import structural_observation
    from loopid.report.structure import base_report

    answer.require(robot.path)
    strategy = subgroups_of(search, alpha=alpha, condition_limit=cond_limit, variant=variant)
    joint_terms = JointTerms.of(robot, terms)
    warn_of_omitted(robot, joint_terms)
    with progress_bar("poses") as report:
        observation = structural_observation(
            robot, model, samples=samples, seed=seed, progress=report, joint_terms=joint_terms
        )
    options = None if time_limit is None else SearchOptions(time_limit=time_limit)
    found = find_base_and_motors_alone(observation, strategy, criterion=criterion, options=options)
    command = command_with("excite", robot, "--out", "motion", model=model)
    answer.show(base_report(robot, model, *found), command)


def subgroups_of(search: str, **options: Any) -> Any:
    """The search of a name, with options where it is that of subgroups."""
    from loopid.base_parameters.subgroups import SubgroupSearch

    given = {name: value for name, value in options.items() if value is not None}
    if given and search != SubgroupSearch.name:
        raise OptionError(
            f"{next(iter(given))} must be left out of {search} search, as subgroup search alone "
            "takes it: use search='subgroup'",
            given=search,
        )
    return SubgroupSearch(**given) if given else search


@of_robot
def motions(
    robot: Robot,
    answer: Answer,
    program: str | None = MOTIONS,
    rate: float = Option(20.0, help="Samples per second."),
    singularity_threshold: float = Option(0.02, help="Least singularity measure."),
) -> None:
    """Check motions against limits and singularities."""
    from loopid.motion.files import read_motion_program
    from loopid.report.structure import motions_report

    answer.require(robot.path, program)
    planned = read_motion_program(program or _bundled_motions(robot))
    reviews = _reviews(robot, planned, rate, singularity_threshold)
    answer.show(motions_report(robot.name, reviews, planned.seconds))


def _reviews(robot: Robot, program: MotionProgram, rate: float, threshold: float) -> dict[str, Any]:
    """Reviews of all motions of a file by name."""
    from loopid.motion.joints import joint_motion, review_motion

    reviews = {}
    with progress_bar("motions") as report:
        for done, name in enumerate(program.motions, start=1):
            motion = joint_motion(robot, program.motion(name, rate))
            reviews[name] = review_motion(robot, motion, threshold)
            report(done, len(program.motions))
    return reviews


def _bundled_motions(robot: Robot) -> str:
    """The name of a robot that has motions; others need a file."""
    from loopid.loading.files import robots_with_motions

    if robot.name not in robots_with_motions():
        design = command_with("excite", robot, "--out", "motion")
        raise OptionError(
            f"{robot.name} has no motions of its own: name a motion file, MOTIONS, such as "
            f"motion/motion.yaml that {design} writes"
        )
    return robot.name


@with_options(robot=loaded)
def simulate(
    robot: Robot,
    program: str | None = MOTIONS,
    motion: str | None = Option(None, metavar="NAME", help="Of the file; its first by default."),
    out: str | None = Option(None, metavar="CSV", help="The log; on the terminal without it."),
    rate: float = Option(100.0, help="Samples per second."),
    noise: float = Option(0.0, help="Standard deviation of the forces in N or N m."),
    encoder_step: float = Option(
        0.0, help="Resolution of the positions, in m or rad; 0 for exact ones."
    ),
    terms: str = Option(
        "none", help='As for identify with values: "Fc=60,Fv=900; elbow: Ks=12"; none at first.'
    ),
    cad_error: float = Option(
        0.0, help="How far, in parts, bodies are off the robot file's: 0.2 for 20 %."
    ),
    seed: int = Option(0, help="Seed of the noise and of the bodies."),
) -> None:
    """Write the log of a simulated robot, to try identify."""
    from loopid.loading.files import own_files
    from loopid.motion.files import read_motion_program
    from loopid.motion.simulation import Noise, scaled_bodies, simulate as simulated
    from loopid.regressors.joint_terms import JointTerms

    if out is not None:
        require_name(out, "the log")
        require_other_file(out, *own_files(robot), *filter(None, [program]))
        require_ending(out, LOG_ENDINGS)
    errors = Noise(gaussian=noise, encoder_step=encoder_step)
    planned = read_motion_program(program or _bundled_motions(robot)).motion(motion, rate)
    chosen, values = JointTerms.with_values(robot, terms)
    text = simulated(
        robot,
        planned,
        errors,
        seed=seed,
        standard_parameters=scaled_bodies(robot, cad_error, seed=seed),
        joint_terms=chosen,
        joint_values=values,
    ).text
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_file(out, text)
        typer.echo(out)


@of_robot
def excite(
    robot: Robot,
    answer: Answer,
    model: str = Option(
        "auto",
        help=f"{MODELS}; auto: the one that the logs of --after need, gravity without.",
        autocompletion=completion.models,
    ),
    terms: str = Option(
        "none", help=f"{TERMS[:-1]}; auto: those of identify.", autocompletion=completion.terms
    ),
    criterion: str = Option(
        "D",
        help="What is optimised: D, A, E or condition.",
        autocompletion=completion.words_of("excitation.criteria:CRITERIA"),
    ),
    shape: str = Option("fourier", help="fourier, or poses to stand in (gravity)."),
    size: int | None = Option(None, help="Number of harmonics or poses; enough by default."),
    duration: float | None = Option(
        None, help="Seconds; by default 20 for a gravity model, 10 for a full one."
    ),
    rate: float = Option(100.0, help="Samples per second of the run."),
    share: float = Option(1.0, help="Part of each limit that may be used."),
    limit: list[str] | None = Option(
        None, metavar="JOINT=LOW:HIGH", help="Range of a joint; repeatable."
    ),
    max_speed: list[str] | None = Option(
        None, metavar="[JOINT=]V", help="Limit of a joint or of all motors; repeatable."
    ),
    max_acceleration: list[str] | None = Option(None, metavar="[JOINT=]A", help="As --max-speed."),
    max_force: list[str] | None = Option(None, metavar="[JOINT=]F", help="As --max-speed."),
    workspace: list[str] | None = Option(
        None, metavar="X=LOW:HIGH", help="Range of a platform coordinate; repeatable."
    ),
    singularity_threshold: float | None = Option(
        None, help="Least singularity measure; by default 0.02, or what is possible."
    ),
    collisions: bool = Option(True, help="Links must not touch, by the URDF's collision geometry."),
    noise: list[str] | None = Option(
        None,
        metavar="[JOINT=]S",
        help="Standard deviation of the motors' forces; by default 1 % of their RMS value.",
    ),
    after: list[str] | None = Option(
        None, metavar="LOG", help="A log that you already have; repeatable."
    ),
    mapping: list[str] | None = MAPPINGS,
    parameters: list[str] | None = Option(
        None, "--for", metavar="PARAMETER", help="One that the motion should excite; repeatable."
    ),
    payload: str | None = Option(
        None,
        metavar="LINK",
        help="Link whose parameters alone are unknown.",
        autocompletion=completion.links,
    ),
    starts: int = Option(4, help="Random motions to begin with."),
    evaluations: int = Option(400, help="Motions that are tried; more never give a worse one."),
    time_limit: float | None = Option(
        None, help="Seconds of search, at most; the best motion so far is kept."
    ),
    seed: int = Option(0, help="Seed of the random motions."),
    solver: str | None = Option(
        None,
        help="ipopt, where it is installed, or slsqp.",
        autocompletion=completion.words_of("excitation.problem:SOLVERS"),
    ),
) -> None:
    """Design a motion that excites the parameters.

    Ctrl-C keeps the best motion so far.
    """
    from loopid.excitation.design import design_motion
    from loopid.excitation.limits import MotionLimits
    from loopid.excitation.problem import DesignOptions
    from loopid.identification.force_models import force_model
    from loopid.identification.model_choice import chosen_model, require_model
    from loopid.logs.reading import locked_as_logged
    from loopid.report.excitation import excitation_report

    answer.require(robot.path, *(mapping or ()), *(after or ()))
    (mappings,) = mapping_of_each(mapping, after=after)
    limits = MotionLimits(
        share=share,
        positions=ranges(limit, "--limit"),
        speeds=sizes(max_speed, "--max-speed"),
        accelerations=sizes(max_acceleration, "--max-acceleration"),
        forces=sizes(max_force, "--max-force"),
        workspace=ranges(workspace, "--workspace"),
        singularity_threshold=singularity_threshold,
        collisions=collisions,
    )
    options = DesignOptions(
        criterion=criterion,
        shape=shape,
        size=size,
        duration=duration,
        rate=rate,
        noise=sizes(noise, "--noise") or None,
        starts=starts,
        evaluations=evaluations,
        time_limit=time_limit,
        solver=solver,
        seed=seed,
    )
    require_model(model)
    robot = locked_as_logged(robot, after[0], mapping=mappings[0]) if after else robot
    logged = recordings(robot, after, mappings)
    chosen = chosen_model(robot, model, logged)
    fitted = force_model(robot, chosen, terms)
    with progress_bar(criterion) as watch:
        found = design_motion(
            fitted,
            limits=limits,
            options=options,
            after=logged,
            parameters=parameters or (),
            payload=payload,
            progress=watch,
        )
    found.require_gain()
    model = found.force_model.model
    answer.show(excitation_report(found), command_with("identify", robot, "LOG", model=model))


@with_options(robot=loaded)
def view(
    robot: Robot,
    files: list[str] | None = Argument(
        None, metavar="[LOG|MOTION|FIT]...", help="What to play, and saved fits: their masses."
    ),
    mapping: str | None = MAPPING,
    port: int = Option(8080, help="Of this machine; the next free one where it is taken."),
    out: str | None = Option(None, metavar="DIR", help="Write pictures to a folder, and end."),
    count: int = Option(1, min=1, help="Pictures, evenly spread over the motion."),
) -> None:
    """Move a robot in the browser, play logs and motions."""
    from loopid.view.viewer import open_viewer

    with open_viewer(robot, files or (), mapping=mapping, port=port) as viewer:
        if out is None:
            typer.echo(f"{robot.name} is shown at {viewer.url} until Ctrl-C")
            viewer.wait()
        else:
            pictures = enumerate(viewer.pictures(count))
            written = write_files(out, {f"{robot.name}_{k:03d}.png": png for k, png in pictures})
            typer.echo("\n".join(map(str, written)))


def init(
    context: typer.Context,
    file: str = Argument(..., metavar="FILE", help="Robot: a URDF, MJCF, SDF or xacro."),
    log: str | None = Argument(None, metavar="[LOG]", help="A log, whose columns are named."),
    out: str = Option(".", metavar="DIR", help="Folder to write to."),
    floating_base: bool = Option(False, "--floating-base", help="The root moves freely."),
    xacro: list[str] | None = XACRO,
) -> None:
    """Write a YAML and a mapping to fill in.

    The YAML has the closures that the file shows. The mapping names the columns of the log.
    """
    from loopid.export.first_files import write_in_words

    options = {"floating_base": floating_base, "xacro": macro_arguments(xacro)}
    with progress_bar("robot"):
        yaml, mapping = write_in_words(
            file, log, out, options, partial(in_options, context=context)
        )
    # A YAML or a bundled robot is whole already.
    written = [mapping] if str(yaml) == file else [yaml, mapping]
    typer.echo(next_commands(yaml, log or "LOG", mapping, written))


def next_commands(yaml: object, log: str, mapping: object, written: Sequence[object]) -> str:
    """The commands that follow ``init``, which has written files to fill in."""
    robot, log, mapping = (shlex.quote(str(each)) for each in (yaml, log, mapping))
    return f"""\
Fill in {" and ".join(shlex.quote(str(each)) for each in written)}. Then:
  loopid check {robot}
  loopid view {robot}
  loopid base {robot} --model full
  loopid excite {robot} --model full --out motion
  loopid identify {robot} {log} --mapping {mapping} --out found"""


def schema(
    kind: str = Argument(
        ...,
        metavar="KIND",
        help="robot, mapping or motions.",
        autocompletion=completion.words_of("export.first_files:FORMS"),
    ),
) -> None:
    """Print the JSON schema of a YAML, for editors.

    They complete keys by it, and mark mistakes.
    """
    from loopid.export.first_files import file_schema

    typer.echo(json.dumps(file_schema(kind), indent=1, ensure_ascii=False))


def macro_arguments(given: Sequence[str] | None) -> dict[str, str]:
    """KEY:=VALUE by key."""
    if not all(":=" in text for text in given or ()):
        raise OptionError(f"--xacro takes KEY:=VALUE, not {shown(' '.join(given or ()))}")
    return dict(text.partition(":=")[::2] for text in given or ())


def ranges(given: Sequence[str] | None, option: str) -> dict[str, tuple[float, float]]:
    """NAME=LOW:HIGH by name."""
    found = {}
    for text in given or ():
        name, _, ends = text.rpartition("=")
        low, colon, high = ends.partition(":")
        if not name or not colon:
            raise OptionError(f"{option} must be NAME=LOW:HIGH, not {text!r}", given=text)
        found[name] = number(low, option), number(high, option)
    return found


def sizes(given: Sequence[str] | None, option: str) -> dict[str, float]:
    """[NAME=]NUMBER by name, or by "all"."""
    parts = [text.rpartition("=") for text in given or ()]
    return {name or "all": number(value, option) for name, _, value in parts}


def number(text: str, option: str) -> float:
    """A number of an option."""
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"{option} must have numbers, not {text!r}", given=text) from None


def numbers(text: str, option: str, count: int) -> Any:
    """Numbers with commas between, as many as ``count``."""
    found = [number(part, option) for part in text.split(",")]
    if len(found) != count:
        raise OptionError(f"{option} must have {count} numbers, not {text!r}", given=text)
    return found


def row_range(text: str | None) -> tuple[int, int | None] | None:
    """First and last row of M:N, M: or :N."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,9})?:(\d{1,9})?", text, re.ASCII)
    if found is None:
        raise OptionError(f"--rows must be M:N, as 1000:5000 or 1000:, not {text!r}", given=text)
    first, last = found.groups()
    return int(first or 1), int(last) if last else None


def recordings(
    robot: Robot,
    paths: Sequence[str] | None,
    mappings: Sequence[str | None],
    cutoff: float | None = None,
    rows: str | None = None,
    *,
    forces: bool = True,
) -> list[Recording]:
    """Logs of an option, each with its mapping, read and made ready."""
    from loopid.logs.preparing import prepare
    from loopid.logs.reading import read_log
    from loopid.logs.recording import FilterOptions

    lowpass = FilterOptions() if cutoff is None else FilterOptions(cutoff=cutoff)
    found: list[Recording] = []
    chosen = row_range(rows)
    with progress_bar("assembling") as report:
        for path, mapping in zip(paths or (), mappings, strict=True):
            log = read_log(path, robot, mapping=mapping, rows=chosen, forces=forces)
            found.append(prepare(robot, log, filter=lowpass, progress=report))
    return found


def mapping_of_each(
    given: Sequence[str] | None, **logs: Sequence[str] | None
) -> list[list[str | None]]:
    """The mapping of each log of some options: one for all, or one for each in order."""
    counts = [len(paths or ()) for paths in logs.values()]
    every = [*(given or (None,))]
    if len(every) == 1:
        every *= sum(counts)
    if len(every) != sum(counts):
        named = ", ".join(
            f"--{name.replace('_', '-')}" if name != "logs" else "LOG" for name in logs
        )
        raise OptionError(
            f"--mapping must be given once for all logs, or once for each in the order of {named}, "
            f"not {len(every)} times for {counted(sum(counts), 'log')}",
            given=tuple(every),
        )
    rest = iter(every)
    return [[next(rest) for _ in range(count)] for count in counts]
