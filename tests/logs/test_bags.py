"""Joint states by name: whoever sends them, in whatever order, on whatever topic."""

import numpy as np
import pytest
from recorded_logs import TOPIC, joint_state, states, types_of, write_ros1, write_ros2

from loopid.errors import DataWarning, LogError, OptionError
from loopid.logs import LogMapping, read_log

COUNT = 400


@pytest.fixture(params=["ros1", "ros2"])
def ros(request):
    return request.param


@pytest.fixture
def write(ros, tmp_path):
    """Write messages (received, topic, message), sorted by when they were received."""

    def bag(messages, name="run"):
        messages = sorted(messages, key=lambda message: message[0])
        if ros == "ros1":
            return write_ros1(tmp_path / f"{name}.bag", messages)
        return write_ros2(tmp_path / name, messages)

    return bag


@pytest.fixture(scope="session")
def run(truth):
    stamps = np.round(truth.time[:COUNT] * 1e9).astype(np.int64) + 10**9
    return stamps, truth.position[:COUNT], truth.force[:COUNT]


def check(log, run, atol=1e-12):
    """All rows are there, none has changed but by round-off."""
    stamps, position, force = run
    np.testing.assert_allclose(log.time, (stamps - stamps[0]) / 1e9, atol=1e-12)
    np.testing.assert_allclose(log.position, position, atol=atol)
    np.testing.assert_allclose(log.force, force, atol=max(1e-9, 1e4 * atol))
    assert log.dropped == ()


def test_joints_may_stand_in_another_order_in_every_message(knee, ros, write, run):
    rng, names = np.random.default_rng(0), np.array([*knee.actuated, "thumb"])
    messages = []
    for stamp, q, f in zip(*run, strict=True):
        order = rng.permutation(5)
        q, f = np.append(q, 7.0)[order], np.append(f, 7.0)[order]
        messages.append((int(stamp), TOPIC, joint_state(ros, stamp, names[order], q, (), f)))
    check(read_log(write(messages), knee), run)


@pytest.mark.parametrize("topics", [(TOPIC, TOPIC), ("/left/joint_states", "/right/joint_states")])
def test_publishers_of_other_joints_with_the_same_stamps(knee, ros, write, run, topics):
    stamps, q, f = run
    messages = []
    for topic, part in zip(topics, (slice(0, 3), slice(3, 4)), strict=True):
        found = states(ros, knee.actuated[part], stamps, q[:, part], f[:, part])
        messages += [(received, topic, message) for received, _, message in found]
    check(read_log(write(messages), knee), run)


def test_publishers_with_stamps_of_their_own_are_put_on_one_grid(knee, ros, write, truth, run):
    stamps, q, f = run
    late = stamps[:-1] + 3_000_000
    exact = np.stack([np.interp(late, stamps, column) for column in q[:, 3:].T], axis=1)
    messages = [
        *states(ros, knee.actuated[:3], stamps, q[:, :3], f[:, :3]),
        *states(ros, knee.actuated[3:], late, exact, f[:-1, 3:]),
    ]
    log = read_log(write(messages), knee)
    # Only stamps that both have: the second starts 3 ms later and ends 7 ms earlier.
    assert len(log) == COUNT - 2
    assert {part.reason for part in log.dropped} == {"not in all streams"}
    np.testing.assert_allclose(log.position[:, :3], q[1:-1, :3], atol=1e-12)
    # Interpolated twice, each time off by less than h² / 8 times the acceleration.
    assert np.abs(log.position[:, 3] - q[1:-1, 3]).max() < 2 * 0.5 * 0.01**2 / 8


def test_any_subset_of_the_joints_in_a_message(knee, ros, write, run):
    rng, messages = np.random.default_rng(1), []
    stamps, q, f = run
    with_joint = rng.random((COUNT, 4)) < 0.9
    with_joint[[0, -1]] = True
    for k, stamp in enumerate(stamps):
        here = np.flatnonzero(with_joint[k])
        names = [knee.actuated[j] for j in here]
        messages.append(
            (int(stamp), TOPIC, joint_state(ros, stamp, names, q[k, here], (), f[k, here]))
        )
    log = read_log(write(messages), knee)
    for j in range(4):
        at = np.searchsorted(log.time, (stamps[with_joint[:, j]] - stamps[0]) / 1e9 - 1e-6)
        np.testing.assert_allclose(log.position[at, j], q[with_joint[:, j], j], atol=1e-7)


def test_positions_and_efforts_may_come_in_messages_of_their_own(knee, ros, write, run):
    stamps, q, f = run
    messages = []
    for stamp, here, force in zip(stamps, q, f, strict=True):
        messages.append((int(stamp), TOPIC, joint_state(ros, stamp, knee.actuated, here)))
        message = joint_state(ros, stamp, knee.actuated, effort=force)
        messages.append((int(stamp) + 1, TOPIC, message))
    check(read_log(write(messages), knee), run)


def test_messages_without_joints_are_passed_over(knee, ros, write, run):
    empty = (int(run[0][0]) - 5, TOPIC, joint_state(ros, 0, []))
    check(read_log(write([empty, *states(ros, knee.actuated, *run)]), knee), run)


def test_headers_without_time_leave_the_time_of_recording(knee, ros, write, run):
    messages = [
        (received, topic, joint_state(ros, 0, m.name, m.position, m.velocity, m.effort))
        for received, topic, m in states(ros, knee.actuated, *run)
    ]
    with pytest.warns(DataWarning, match=r"no header of leg1_stroke\.position.*time"):
        check(read_log(write(messages), knee), run)


def test_the_time_of_recording_may_be_asked_for(knee, ros, write, run):
    messages = [(t + 50, *rest) for t, *rest in states(ros, knee.actuated, run[0], *run[1:])]
    messages[7] = (messages[7][0] + 40, *messages[7][1:])
    path = write(messages)
    check(read_log(path, knee), run)
    mapping = LogMapping(time={"column": "received_ns", "unit": "ns"})
    received = read_log(path, knee, mapping=mapping)
    assert 0 < np.abs(received.position - run[1]).max() < 1e-7


def test_alike_topics_are_told_apart_by_the_mapping(knee, ros, write, run):
    messages = list(states(ros, knee.actuated, *run))
    other = states(ros, knee.actuated, run[0], run[1] + 1e-3, run[2])
    messages += [(received, "/wanted", message) for received, _, message in other]
    path = write(messages)
    message = (
        r"2 columns for the position of leg1_stroke: /joint_states:leg1_stroke\.position, "
        r"/wanted:leg1_stroke\.position; name one, or a topic, in a mapping"
    )
    with pytest.raises(LogError, match=message):
        read_log(path, knee)
    check(read_log(path, knee, mapping=LogMapping(topic=TOPIC)), run)
    log = read_log(path, knee, mapping=LogMapping(topic="/wanted"))
    np.testing.assert_allclose(log.position, run[1] + 1e-3, atol=1e-12)
    mixed = {joint: f"/wanted:{joint}.position" for joint in knee.actuated}
    forces = {joint: f"/joint_states:{joint}.effort" for joint in knee.actuated}
    both = read_log(path, knee, mapping=LogMapping(position=mixed, force=forces))
    np.testing.assert_allclose(both.position, run[1] + 1e-3, atol=1e-12)
    with pytest.raises(
        LogError, match=r"unknown topic '/other' of joint states in .*: choose among /joint_st"
    ):
        read_log(path, knee, mapping=LogMapping(topic="/other"))


def test_bad_values_are_left_out_by_message(knee, ros, write, run):
    stamps, q, f = run
    q = q.copy()
    q[[5, 9], 2] = np.nan, np.inf
    path = write(states(ros, knee.actuated, stamps, q, f))
    message = r"/joint_states: no number in leg3_stroke\.position in rows 6, 10 of 400: left out"
    with pytest.warns(DataWarning, match=message):
        read_log(path, knee)


@pytest.mark.parametrize(
    ("names", "values"),
    [(("a", "b"), (1.0, 2.0, 3.0)), (("a", "b"), (1.0,)), (("a", "a"), (1.0, 2.0))],
)
def test_messages_that_contradict_themselves(knee, ros, write, run, names, values):
    spoilt = (int(run[0][-1]) + 1, TOPIC, joint_state(ros, 5, names, values))
    path = write([*states(ros, knee.actuated, *run), spoilt])
    with pytest.raises(LogError, match=r"/joint_states: message 401 has \d values for \d columns"):
        read_log(path, knee)


def test_topics_of_other_types_are_listed(knee, ros, write):
    text = types_of(ros).types["std_msgs/msg/String"]
    path = write([(5, "/chatter", text("hello")), (6, "/chatter", text("again"))])
    with pytest.raises(
        LogError, match=r"no topic of type sensor_msgs/msg/JointState: .*/chatter \("
    ):
        read_log(path, knee)


def test_topics_of_other_types_do_no_harm(knee, ros, write, run):
    text = types_of(ros).types["std_msgs/msg/String"]
    chatter = [(int(t) + 1, "/chatter", text("hello")) for t in run[0]]
    check(read_log(write([*chatter, *states(ros, knee.actuated, *run)]), knee), run)


def test_columns_of_a_topic_have_no_order(knee, ros, write, run):
    path = write(states(ros, knee.actuated, *run))
    with pytest.raises(LogError, match=r"columns of /joint_states stand in no order: list them"):
        read_log(path, knee, mapping=LogMapping(position={"stream": TOPIC}))


@pytest.mark.parametrize("key", ["topic", "group"])
def test_choices_of_other_formats_are_refused(knee, good_text, write_text, key):
    with pytest.raises(
        LogError, match=f"{key} 'x' of the mapping chooses nothing in .* format csv"
    ):
        read_log(write_text(good_text), knee, mapping=LogMapping(**{key: "x"}))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            {"topics": "/a"},
            "unknown key 'topics' .did you mean 'topic'..: choose among format, topic, group",
        ),
        ({"time": 3}, "time: "),
    ],
)
def test_bad_mappings_are_refused_in_python_too(content, message):
    with pytest.raises(OptionError, match=message) as caught:
        LogMapping(**content)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("storage", "packed"),
    [("ros1", "BZ2"), ("ros1", "LZ4"), ("db3", "message"), ("db3", "file"), ("mcap", "storage")],
)
def test_packed_bags_are_read(knee, run, tmp_path, storage, packed):
    ros = storage if storage == "ros1" else "ros2"
    messages = states(ros, knee.actuated, *run)
    if ros == "ros1":
        path = write_ros1(tmp_path / "run.bag", messages, packed)
    else:
        path = write_ros2(tmp_path / "run", messages, storage, packed)
    check(read_log(path, knee), run)
