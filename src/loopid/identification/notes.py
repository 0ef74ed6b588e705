"""What to know of an identification beside what is wrong, and what was checked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from loopid.findings import Finding
from loopid.identification.force_models import parted
from loopid.identification.friction import friction_findings
from loopid.identification.hysteresis import hysteresis_loop, hysteretic_joints
from loopid.identification.verdict import insignificant
from loopid.regressors.joint_terms import NO_TERMS

if TYPE_CHECKING:
    from loopid.identification.identification import Identification

NAMED = 4  # parameters that a note names
IDLE = 0.3  # part of a motor's samples left out, above which it is worth a word


def checks_of(found: Identification) -> tuple[tuple[bool, str], ...]:
    """What was checked, and whether it passed."""
    delay, told, cutoff = found.delay, found.identifiability, found.cutoff
    every, known = told.structural_rank, told.well_determined
    said = [
        (not found.mistakes, "signs, units and order of motors", "a mistake is suspected"),
        (told.rank == every, "all combinations excited", f"{every - told.rank} not excited"),
        (
            known == every,
            "all known better than by the file",
            f"{every - known} less known than by the file",
        ),
        (
            found.recommended.beats_baseline,
            "fitted bodies predict better",
            "fitted bodies do not predict clearly better",
        ),
    ]
    if delay is not None:
        said.insert(1, (not delay.clear, "no clear delay", "a delay, undone"))
    if cutoff is not None:
        said.append((not cutoff.bound, "filter within its range", "filter at a bound"))
    return tuple((bool(good), text if good else other) for good, text, other in said)


def notes_of(found: Identification) -> Iterator[Finding]:
    """What is good to know, and nothing wrong."""
    fit, told, cutoff = found.fit, found.identifiability, found.training[0].cutoff
    runs = (*found.training, *found.validation)
    filtered = "unfiltered" if cutoff is None else f"filtered at {cutoff:.3g} Hz"
    terms, _ = parted(found.force_model.joint_terms)
    choice = NO_TERMS if terms is None else terms.choice(found.force_model.robot)
    unclear = insignificant(fit)
    idle = [float(1 - run.used.mean(axis=0).min()) for run in runs]
    notes = [
        (f"recommended: {found.recommended.name}", _recommendation(found)),
        (
            f"the data were {filtered}",
            "the condition number of the weighted regressor is "
            f"{found['all parameters'].fit.condition_number:.4g}",
        ),
        (f"the joint terms are {choice}", ""),
    ]
    if unclear:
        more = f" and {len(unclear) - NAMED} more" if len(unclear) > NAMED else ""
        title = f"{len(unclear)} values may as well be zero"
        notes.append((title, f"{', '.join(unclear[:NAMED])}{more}"))
    if max(idle) > IDLE:
        why = f"there, up to {100 * max(idle):.0f} % of a motor's samples are left out"
        notes.append(("motors stand still for much of the log", why))
    if frames := dict.fromkeys(frame for run in runs for frame in run.wrenches):
        notes.append(("measured wrenches are part of the forces", f"on {', '.join(frames)}"))
    notes += friction_findings(fit)
    notes += [hysteresis_loop(fit, joint).finding for joint in hysteretic_joints(fit)]
    if told.unidentifiable:
        title = "unidentifiable combinations are as in the robot file"
        notes.append((title, f"the values of {', '.join(told.assumed)} rest on it"))
    yield from (Finding("note", *note) for note in notes)


def _recommendation(found: Identification) -> str:
    said = f"Recommended, and written to parameters.yaml: {found.recommended.name}"
    if found.recommended is found.baseline:
        return f"{said} with fitted joint terms, as fitted bodies are clearly worse on new data."
    deviation = found.fit.deviation
    if deviation is None:
        return f"{said} by {found.fit.estimator}."
    return f"{said} parameters, every body solid; {deviation.sentence}."
