"""From logs to recordings: filtered motion is the true one, and what is left out is named."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import loopid
from loopid.errors import AssemblyError, DataError, DataWarning, LogError, OptionError
from loopid.kinematics import (
    SamplingOptions,
    constraint_residual,
    platform_coordinates,
    random_configurations,
)
from loopid.kinematics.projection import singularity_measure
from loopid.logs import FilterOptions, Log, LogMapping, read_log
from loopid.logs.preparing import (
    apart_at_jumps,
    assemble_samples,
    clipped_from,
    filter_log,
    idle_samples,
    kept_rows,
    long_enough,
    near_saturation,
    provisional_cutoff,
    saturation_of,
    standing,
    sticking,
    without_frozen,
)
from loopid.logs.recording import least_logged
from loopid.motion import Motion, joint_motion
from loopid.motion.filtering import differentiate
from made_runs import quietly
from real_streams import read_stream


def prepared(robot, log, cutoff=5.0, decimate=True, **options):
    chosen = FilterOptions(cutoff=cutoff, decimate=decimate)
    return loopid.prepare(robot, log, filter=chosen, **options)


@pytest.fixture(scope="module")
def log(knee, truth):
    return Log.from_arrays(truth.time, truth.position, truth.force, knee.actuated, name="run")


def altered(log, rows=slice(None), **changes):
    fields = {name: getattr(log, name) for name in ("time", "position", "force", "segments")}
    fields = {name: values[rows] for name, values in (fields | changes).items()}
    return Log(name="run", joints=log.joints, checked=True, **fields)  # values are no matter


@pytest.fixture(scope="module")
def recording(knee, log):
    return prepared(knee, log)


def at_times(truth, recording):
    """Rows of the truth at the times of a recording."""
    rows = np.round(recording.motion.time * 100).astype(int)
    np.testing.assert_allclose(truth.time[rows], recording.motion.time, atol=1e-9)
    return rows


def test_the_motion_is_the_true_one(knee, truth, recording):
    rows, motion = at_times(truth, recording), recording.motion
    assert np.abs(motion.configurations - truth.motion.configurations[rows]).max() < 1e-5
    for name, scale in (("velocities", 2e-3), ("accelerations", 2e-2)):
        exact = getattr(truth.motion, name)[rows]
        error = np.sqrt(((getattr(motion, name) - exact) ** 2).mean(axis=0))
        assert (error < scale * np.abs(exact).max(axis=0)).all()
    assert np.abs(constraint_residual(knee, motion.configurations)).max() < 1e-10


def test_without_a_filter_nothing_is_smoothed(knee, truth, log):
    recording = prepared(knee, log, cutoff=None)
    assert recording.cutoff is None
    np.testing.assert_array_equal(recording.force, truth.force)
    np.testing.assert_array_equal(recording.motion.time, truth.time)
    expected = differentiate(truth.position, 100.0)
    np.testing.assert_allclose(recording.motion.velocities, expected, atol=1e-12)


RATES = {
    "velocity": {"columns": [f"v_{k}" for k in range(4)]},
    "acceleration": {"columns": [f"a_{k}" for k in range(4)]},
}


def read_with(knee, truth, folder, quantities=(), **options):
    """The log of coarse encoders, with measured rates of the motors: speeds in mm/s."""
    velocities, accelerations = 1e3 * truth.motion.velocities, truth.motion.accelerations
    arrays = {"position": np.round(truth.position, 4), "v": velocities, "a": accelerations}
    np.savez(folder / "run.npz", time=truth.time, force=truth.force, **arrays)
    given = {"velocity_scale": 1e-3} | {quantity: RATES[quantity] for quantity in quantities}
    return read_log(folder / "run.npz", knee, mapping=LogMapping(**(given | options)))


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_measured_rates_stand_for_derivatives_of_positions(knee, truth, tmp_path, quantity):
    errors = []
    for quantities in ((), (quantity,)):
        recording = loopid.prepare(
            knee,
            read_with(knee, truth, tmp_path, quantities),
            filter=FilterOptions(cutoff=10.0),
        )
        name = {"velocity": "velocities", "acceleration": "accelerations"}[quantity]
        exact = getattr(truth.motion, name)[at_times(truth, recording)]
        errors.append(np.sqrt(((getattr(recording.motion, name) - exact) ** 2).mean()))
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_rates_that_are_not_those_of_the_positions_are_named(knee, truth, tmp_path, quantity):
    scale = dict.fromkeys(knee.actuated, 1.0 if quantity == "acceleration" else 0.001)
    for factor in (2.0, -1.0, 1e-3):
        wrong = {f"{quantity}_scale": scale | {"leg2_stroke": factor * scale["leg2_stroke"]}}
        with pytest.raises(LogError, match=f"{quantity} of leg2_stroke is .*{quantity}_") as said:
            read_with(knee, truth, tmp_path, [quantity], **wrong)
        assert float(str(said.value).split()[6]) == pytest.approx(factor, rel=0.02)
    wrong = {f"{quantity}_scale": scale | {"leg2_stroke": 1.15 * scale["leg2_stroke"]}}
    with pytest.warns(DataWarning, match=f"{quantity} of leg2_stroke is 1.1.* times .* by 1.%"):
        read_with(knee, truth, tmp_path, [quantity], **wrong)


def test_positions_and_forces_are_filtered_alike(knee, log):
    mixed = altered(log, force=100 * log.position)
    recording = prepared(knee, mixed, decimate=False)
    strokes = knee.velocity_indices(knee.actuated)
    found = recording.motion.configurations[:, strokes]
    np.testing.assert_allclose(recording.force, 100 * found, atol=1e-9)


def test_decimation_keeps_every_kth_sample_of_the_same(knee, log, recording):
    whole = prepared(knee, log, decimate=False)
    rows = np.arange(0, len(whole), 4)
    np.testing.assert_allclose(recording.motion.time, whole.motion.time[rows])
    np.testing.assert_array_equal(recording.force, whole.force[rows])
    for name in ("velocities", "accelerations"):
        kept, full = getattr(recording.motion, name), getattr(whole.motion, name)
        np.testing.assert_array_equal(kept, full[rows])
    configurations = whole.motion.configurations[rows]
    np.testing.assert_allclose(recording.motion.configurations, configurations, atol=1e-9)


@pytest.mark.parametrize("cutoff", [0.7, 1.0, 3.0, 5.0, 9.0])
def test_the_rate_stays_above_five_times_the_cutoff(knee, log, cutoff):
    recording = quietly(prepared, knee, log, cutoff)
    rate = 1 / np.diff(recording.motion.time).mean()
    assert 5 * cutoff * (1 - 1e-9) <= rate < 2 * 5 * cutoff


def test_the_ends_are_left_out(recording):
    (end,) = (part for part in recording.dropped if part.reason == "end of a segment")
    assert end.count == 40
    assert recording.motion.time[0] == pytest.approx(0.2)


def stands(knee, recording, speed):
    """At or below a speed, or within 0.2 s of half a provisional period or more of that."""
    idle = np.abs(recording.history.velocity) <= speed
    half = int(100.0 / provisional_cutoff(knee, recording.log) / 4)
    found = idle.copy()
    for k, column in enumerate(idle.T):
        ends = np.flatnonzero(np.diff(np.r_[0, np.pad(column, half, "edge"), 0]))
        for start, stop in ends.reshape(-1, 2) - half:
            if stop - start > 2 * half:
                found[max(start - 20, 0) : stop + 20, k] = True
    return found[recording.history.rows]


def test_idle_speeds_come_from_the_mapping_or_the_motion(knee, log, recording):
    own = 0.05 * np.percentile(np.abs(recording.motion.velocities), 99, axis=0)
    np.testing.assert_array_equal(recording.used, ~stands(knee, recording, own))
    found = prepared(knee, replace(log, idle_speed=0.004))
    idle = stands(knee, recording, 0.004)
    np.testing.assert_array_equal(found.used, ~idle)
    counts = {part.reason: part.count for part in found.dropped}
    for k, joint in enumerate(knee.actuated):
        assert counts.get(f"{joint} stands still", 0) == idle[:, k].sum()


def test_a_motor_that_turns_back_stands_for_as_long_as_it_is_slow(knee, log):
    swing = np.sin(np.pi * np.arange(len(log)) / 100.0)  # 0.5 Hz, slow for 32 ms at each end
    rest = np.repeat(swing, np.where(np.arange(len(log)) == 250, 150, 1))[: len(log)]
    turning, resting = (
        prepared(knee, altered(log, position=log.position[:1] + 0.005 * way[:, None]))
        for way in (swing, rest)
    )
    phase = turning.motion.time - log.time[0] - 0.5
    near = np.abs(phase - np.round(phase)) < 0.05
    assert turning.used[~near].all()
    assert not turning.used[np.abs(phase - np.round(phase)) < 0.01].any()
    still = np.abs(resting.motion.time - log.time[0] - 3.25) < 0.9
    assert not resting.used[still].any()
    for found in (turning, resting):  # friction there may be anything, however the filter mixes it
        assert (found.resting[~found.used] == 1).all()
        assert ((found.resting >= 0) & (found.resting <= 1)).all()
        assert (found.resting[found.used] < 0.5).mean() > 0.9


def test_saturated_samples_are_masked_with_their_neighbours(knee, log, truth):
    limit = 80.0
    clipped = altered(log, force=np.clip(truth.force, -limit, limit))
    recording = prepared(knee, replace(clipped, saturation=np.full(4, limit)), decimate=False)
    rows = at_times(truth, recording)
    clean = np.abs(truth.force) < 0.99 * limit
    for k, joint in enumerate(knee.actuated):
        bad = np.flatnonzero(~clean[:, k])
        near = np.array([np.abs(bad - row).min(initial=10**6) <= 20 for row in rows])
        assert not recording.used[near, k].any()
        assert (
            any(part.reason == f"{joint} is saturated" for part in recording.dropped) == near.any()
        )
    # Where it is used, clipping a force has not changed it but by what is left after a period.
    honest = prepared(knee, log, decimate=False)
    changed = np.abs(recording.force - honest.force)
    assert changed[recording.used].max() < 0.02 * np.abs(truth.force - clipped.force).max()


def test_clipped_forces_are_masked_and_named(knee, log, truth):
    limit = 0.8 * np.abs(truth.force[:, 0]).max()
    force = truth.force.copy()
    force[:, 0] = np.clip(force[:, 0], -limit, limit)
    with pytest.warns(DataWarning, match=r"force of leg1_stroke stays at .* clipped"):
        found = prepared(knee, altered(log, force=force))
    told = replace(altered(log, force=force), saturation=np.array([limit, 1e9, 1e9, 1e9]))
    told = prepared(knee, told)
    np.testing.assert_array_equal(found.used, told.used)
    assert not found.used[:, 0].all()


@pytest.mark.parametrize("bias", [0.0, 500.0])  # with it all forces are nearly as large
def test_forces_clipped_at_any_level_are_named_and_coarse_ones_are_not(log, bias):
    force = log.force.copy()
    force[:, 0] = np.sign(force[:, 0]) * (bias + np.abs(force[:, 0]))
    limit = np.percentile(np.abs(force[:, 0]), 95)
    force[:, 0] = np.clip(force[:, 0], -limit, limit)
    with pytest.warns(DataWarning, match="force of leg1_stroke stays"):
        limits = clipped_from(altered(log, force=force))
    np.testing.assert_array_equal(limits, [limit, np.inf, np.inf, np.inf])
    coarse = np.round(log.force / 5) * 5
    assert np.isinf(clipped_from(altered(log, force=coarse))).all()


def test_logs_one_after_the_other_are_segments_of_their_own(knee, log):
    early, late = log.select(log.time < 4), log.select(log.time > 7.3)
    count, joints = len(early) + len(late), knee.actuated
    signals = (
        np.concatenate([getattr(one, name) for one in (early, late)])
        for name in ("position", "force")
    )
    time = np.arange(count) / log.rate(slice(None))
    one = Log.from_arrays(time, *signals, joints)
    with pytest.warns(DataWarning, match=f"jumps at {time[len(early)]:.6g} s: what follows is a"):
        found = apart_at_jumps(one)
    np.testing.assert_array_equal(found.segments, np.arange(count) >= len(early))
    assert {*apart_at_jumps(log).segments} == {0}


@pytest.mark.parametrize("speed", [1.0, 0.2])  # of the fastest
@pytest.mark.parametrize("rows", [slice(0, 400), slice(100, 700), slice(-300, None)])
def test_samples_of_a_frozen_encoder_are_left_out_and_named(knee, log, recording, rows, speed):
    position = log.position.copy()
    held = position[rows, 1].copy()
    way, fastest = np.abs(np.diff(held)), np.abs(np.diff(position[:, 1])).max()
    start = int(np.abs(way - speed * fastest).argmin())
    position[rows, 1] = np.where(np.arange(len(held)) < start, held, held[start])
    with pytest.warns(DataWarning, match="position of leg2_stroke is frozen"):
        found = prepared(knee, altered(log, position=position))
    lost = log.time[rows][start + 1 : -1]
    assert not np.isin(found.motion.time, lost).any()
    assert len(found) > 0.2 * len(recording)


@pytest.mark.parametrize("step", [0.0, 2e-6, 1e-3])
@pytest.mark.parametrize("rate", [10, 1000])
def test_motors_that_move_in_turns_are_not_frozen(rate, step):
    random, joints, count = np.random.default_rng(0), ("a", "b", "c"), 20 * rate
    for _ in range(10):
        time, position = np.arange(count) / rate, np.zeros((count, 3))
        moves = np.cumsum(random.uniform(1.0, 2.0, size=20))
        for k, (start, end) in enumerate(pairwise(moves)):
            s = np.clip((time - start) / (end - start), 0, 1)
            position[:, k % 3] += random.uniform(-1, 1) * s**3 * (10 - 15 * s + 6 * s**2)
        position = np.round(position / step) * step if step else position
        log = Log.from_arrays(time, position, position, joints)
        assert without_frozen(log) is log


def test_a_motor_that_stands_where_another_log_begins_is_not_frozen(knee):
    """Two motors start and stop smoothly, and the same motion follows from where it began."""
    s = np.linspace(0, 1, 1500)
    eased = np.clip((s - 0.1) / 0.8, 0, 1)  # stands for 150 samples at either end
    eased = eased**3 * (10 - 15 * eased + 6 * eased**2)
    swings = 0.6 + 0.05 * np.sin(20 * s)
    position = np.stack([0.5 + 0.1 * eased, 0.6 - 0.1 * eased, swings, swings], axis=1)
    twice = np.concatenate([position, position])
    time = np.arange(len(twice)) / 100
    both = Log.from_arrays(time, twice, twice, knee.actuated)
    assert without_frozen(both) is both
    with pytest.warns(DataWarning, match="jumps at 15 s: what follows is a segment apart"):
        assert {*apart_at_jumps(both).segments} == {0, 1}


def test_encoders_that_freeze_all_at_once_are_left_out(log):
    position, gap = log.position.copy(), slice(300, 400)
    position[gap] = position[300]
    with pytest.warns(DataWarning, match="is frozen"):
        found = without_frozen(altered(log, position=position))
    assert not np.isin(log.time[301:399], found.time).any()


def test_effort_limits_saturate_unless_a_tenth_of_the_forces_exceeds_them(knee, log, truth):
    limits = knee.model.upperEffortLimit[knee.velocity_indices(knee.actuated)]
    force = truth.force.copy()
    force[800:820] = limits
    force[900, 1] = 1.1 * limits[1]
    force[: len(force) // 8, 2] = np.linspace(1.1, 1.3, len(force) // 8) * limits[2]
    recording = prepared(knee, altered(log, force=force))
    named = [part.reason for part in recording.dropped if "saturated" in part.reason]
    assert named == [f"leg{k}_stroke is saturated" for k in (1, 2, 4)]


def test_a_segment_is_not_filtered_across_its_ends(knee, log, truth):
    # The second half is another run: joined, the jump would ring.
    rows = np.r_[0:700, 900 : len(log)]
    numbers = np.repeat([0, 1], [700, len(rows) - 700])
    recording = prepared(knee, altered(altered(log, rows), segments=numbers))
    kept = at_times(truth, recording)
    error = np.abs(recording.motion.velocities - truth.motion.velocities[kept]).max(axis=0)
    assert (error < 2e-3 * np.abs(truth.motion.velocities).max(axis=0)).all()


def far_away(log, rows):
    """The fourth leg goes where the others cannot follow, and back."""
    position = log.position.copy()
    position[rows, 3] += 0.1 * np.hanning(len(rows))
    return altered(log, position=position)


def test_samples_that_do_not_assemble_are_left_out(knee, log, truth):
    strange = far_away(log, np.arange(700, 900))
    message = r"run: the loops do not close in \d+ of 391 samples, between .* m\): left out"
    with pytest.warns(DataWarning, match=message):
        recording = prepared(knee, strange)
    (open_loops,) = (part for part in recording.dropped if part.reason == "loops do not close")
    assert 7 < open_loops.first < open_loops.last < 9
    assert len(recording) == 391 - open_loops.count
    np.testing.assert_array_equal(np.unique(recording.segments), [0, 1])
    outside = (recording.motion.time < 6.8) | (recording.motion.time > 9.2)
    exact = truth.motion.configurations[at_times(truth, recording)]
    assert np.abs(recording.motion.configurations - exact)[outside].max() < 1e-4


def test_a_log_of_another_robot_does_not_assemble(knee, log):
    short = altered(log, slice(0, 500))
    position = short.position + np.array([0.0, 0.0, 0.0, 0.1])
    with pytest.raises(AssemblyError, match=r"run: the loops do not close in (\d+) of \1 samples"):
        prepared(knee, altered(short, position=position))


def test_near_a_singularity_samples_are_left_out(knee, log, truth):
    threshold = float(np.median(truth.motion.singularity))
    with pytest.warns(DataWarning, match="run: the robot is near a singularity in .* left out"):
        recording = prepared(knee, log, singularity_threshold=threshold)
    assert (recording.motion.singularity >= threshold).all()
    assert any(part.reason == "near a singularity" for part in recording.dropped)
    steps = np.diff(recording.motion.time)[np.diff(recording.segments) == 0]
    np.testing.assert_allclose(steps, 0.04, atol=1e-9)
    said = r"near a singularity in 391 of 391 samples.*lower 'singularity_threshold'"
    with pytest.raises(LogError, match=said):
        prepared(knee, log, singularity_threshold=1.0)


def test_the_geometry_decides_how_near_to_singularities_samples_come(knee):
    assert least_logged(knee) == 0.005
    assert least_logged(replace(knee, singularity_threshold=0.2)) == 0.05
    near = SamplingOptions(singularity_threshold=1e-3)
    drawn = random_configurations(knee, 200, options=near)
    measures = singularity_measure(knee, drawn)
    flat = replace(knee, reference=drawn[measures.argmin()])
    assert least_logged(flat) == pytest.approx(max(measures.min() / 8, 0.001))


def test_progress_ends_complete(knee, log, monkeypatch):
    monkeypatch.setattr("loopid.logs.preparing.BLOCK", 512)
    told = []
    prepared(knee, log, decimate=False, progress=lambda done, all_: told.append((done, all_)))
    assert told == [(512, 1561), (1024, 1561), (1536, 1561), (1561, 1561)]


def test_with_an_idle_speed_of_zero_standing_motors_count(knee, log):
    still = altered(log, position=np.broadcast_to(log.position[:1], log.position.shape))
    with pytest.raises(LogError, match="all motors stand"):
        prepared(knee, replace(still, idle_speed=1e-6))
    assert prepared(knee, replace(still, idle_speed=0.0)).used.all()


def test_what_cannot_be_prepared_is_refused(knee, log, four_bars):
    with pytest.raises(OptionError, match=r"log run is of leg1_stroke, .* of small are crank"):
        prepared(four_bars["3d"], log)
    with pytest.raises(OptionError):
        replace(log, idle_speed=-1.0)
    for wrong in (np.zeros(4), np.ones(3)):
        with pytest.raises(DataError, match="saturation must"):
            replace(log, saturation=wrong)
    with pytest.raises(LogError, match="no force can be used, as all motors stand or are saturat"):
        prepared(knee, replace(log, idle_speed=1.0))
    with pytest.raises(LogError, match="too short to filter, the longest has 50 samples"):
        prepared(knee, altered(log, slice(50)))
    with pytest.raises(OptionError, match="cut-off frequency must be below half"):
        prepared(knee, log, 60.0)


def test_an_encoder_that_only_dithers_stands(knee, log):
    generator = np.random.default_rng(3)
    position = log.position.copy()
    position[:, 1] = position[0, 1] + 1e-6 * generator.integers(0, 2, len(log))
    recording = prepared(knee, altered(log, position=position))
    assert recording.used[:, 1].sum() == 0
    assert recording.used[:, [0, 2, 3]].mean() > 0.6


def test_a_crank_that_turns_on_and_on(four_bars):
    robot = four_bars["3d"]
    time = np.arange(0, 6, 0.01)
    angle = 1.0 + 2.0 * time + 0.5 * np.sin(time)
    motion = joint_motion(
        robot,
        Motion(
            robot.actuated,
            time,
            angle[:, None],
            (2 + 0.5 * np.cos(time))[:, None],
            (-0.5 * np.sin(time))[:, None],
        ),
    )
    measured = loopid.simulate(robot, motion)
    log = Log.from_arrays(time, angle, measured.force, robot.actuated)
    recording = prepared(robot, log)
    rows = np.round(recording.motion.time * 100).astype(int)
    assert recording.used.all()
    for name, tolerance in (("velocities", 1e-3), ("accelerations", 1e-2)):
        error = getattr(recording.motion, name) - getattr(motion, name)[rows]
        assert np.abs(error).max() < tolerance
    # Passive hinges are known up to whole turns.
    error = recording.motion.configurations - motion.configurations[rows]
    assert np.abs(np.sin(0.5 * error)).max() < 1e-5


@pytest.fixture(scope="module")
def real(mechanism, real_log):
    return read_log(real_log, mechanism)


def test_nearly_all_rows_are_read(real, real_log):
    stamps, positions = read_stream(real_log / "joint_position.txt.gz")
    assert len(stamps) - 5 < len(real) <= len(stamps)
    assert not real.segments.any()
    assert {part.reason for part in real.dropped} == {"not in all streams"}
    assert real.rate(slice(None)) == pytest.approx(100, abs=0.01)
    nearest = np.searchsorted((stamps - stamps[0]) / 1e9, real.time - 0.005)
    # Stamps jitter by 0.2 ms at 0.03 m/s, and drift against the even grid by less than half a row.
    assert np.abs(real.position - positions[nearest]).max() < 0.03 * 0.006


@pytest.mark.validate
def test_strokes_give_the_logged_pose(mechanism, real, real_log):
    real_recording = prepared(mechanism, real, cutoff=None)
    assert len(real_recording) == len(real)
    found = platform_coordinates(mechanism, real_recording.motion.configurations)
    read_at, _ = read_stream(real_log / "joint_position.txt.gz")
    written_at, poses = read_stream(real_log / "x_coord.txt.gz")
    # Of a cycle the position comes first: its pose is the next row.
    nearest = read_at[np.searchsorted((read_at - read_at[0]) / 1e9, real.time - 0.005)]
    following = np.minimum(np.searchsorted(written_at, nearest), len(poses) - 1)
    assert np.median(np.abs(found - poses[following])) < 2e-6


def test_a_split_counts_samples_that_move(recording):
    used = recording.used.copy()
    used[: len(used) // 2] = False  # half of the log stands still
    run = replace(recording, used=used)
    first, rest = run.split(0.6)
    moving = [part.used.any(axis=1).sum() for part in (first, rest)]
    assert abs(moving[0] - 0.6 * sum(moving)) <= 1
    assert len(first) + len(rest) == len(run)
    for fraction in (0.01, 0.5, 0.99):
        assert min(len(part) for part in run.split(fraction)) > 0


def test_a_part_of_the_time(recording):
    time = recording.motion.time
    part = recording.between(time[10], time[20])
    np.testing.assert_array_equal(part.motion.time, time[10:21])
    assert len(recording.between()) == len(recording)
    with pytest.raises(LogError, match=r"no motor moves between 1000 and .* samples from"):
        recording.between(1000.0)
    for start, end, named in ((-3.0, 5.0, "start"), (5.0, 2.0, "end"), (5.0, 5.0, "end")):
        with pytest.raises(OptionError, match=f"{named} must be"):
            recording.between(start, end)


def test_the_steps_called_one_by_one_are_the_whole(knee, log, recording):
    options = FilterOptions(cutoff=5.0)
    lowpass = options.lowpass(provisional_cutoff(knee, log))
    whole = long_enough(without_frozen(log), lowpass)
    signals = filter_log(whole, lowpass)
    rows, ends = kept_rows(whole, lowpass, options)
    found = assemble_samples(knee, whole, signals.position[rows], rows, least_logged(knee))
    assert found.good.all()
    np.testing.assert_array_equal(found.configurations, recording.motion.configurations)
    np.testing.assert_array_equal(signals.velocity[rows], recording.motion.velocities)
    np.testing.assert_array_equal(signals.force[rows], recording.force)
    np.testing.assert_array_equal(rows, recording.history.rows)
    assert ends[0] in recording.dropped
    stuck = sticking(whole, signals.velocity)
    slow = idle_samples(knee, whole, signals.velocity, rows)
    idle = standing(knee, whole, slow, lowpass, stuck)[rows]
    limits = saturation_of(knee, whole)
    clipped = near_saturation(whole, limits, lowpass)[rows]
    np.testing.assert_array_equal(recording.used, ~(idle | clipped))


def to_and_fro(seconds, rate=500.0, rest=0.0):
    """Positions (N,) of a motor that turns back each second, and rests there; where it rests."""
    time = np.arange(0.0, seconds, 1 / rate)
    phase, left = np.divmod(time, 1.0 + rest)
    return np.cos(np.pi * (phase + np.minimum(left, 1.0))), left > 1.0


@pytest.mark.parametrize("step", [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize("spoil", ["steps", "held", "noise"])
def test_a_motor_that_turns_back_smoothly_does_not_stick(step, spoil):
    stuck = {}
    for rest in (0.0, 0.2):
        exact, rests = to_and_fro(20.0, rest=rest)
        position = step * np.round(exact / step) if step else exact
        if spoil == "held":
            position = position[np.arange(len(position)) // 5 * 5]
        if spoil == "noise":
            position = exact + step / 3 * np.random.default_rng(0).normal(size=len(exact))
        time = np.arange(len(position)) / 500.0
        log = Log.from_arrays(time, position[:, None], 0 * position[:, None], ("motor",))
        velocity = np.gradient(exact, time)[:, None]
        stuck[rest] = sticking(log, velocity)[:, 0]
    assert not stuck[0.0].any()
    # Steps of a thousandth hide that it goes on for 20 ms before and after.
    assert stuck[0.2][rests].mean() > 0.7
    assert stuck[0.2][~rests].mean() < 0.05
