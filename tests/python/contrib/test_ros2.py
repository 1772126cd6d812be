"""Source and node of ROS 2, with a stand-in of rclpy, tf2_ros and the messages: nobody has run them with ROS."""

import _thread
import threading
import time
from dataclasses import replace
from itertools import chain, count, repeat
from types import SimpleNamespace

import numpy as np
import pytest
from granular_id_contrib import NOT_RUN, ros2, ros2_node
from granular_id_contrib.ros2_node import ArmedTrigger, main

import granular_id as gid
from adapter_fakes import Fake
from granular_id.live import WrenchBuffer, open_source
from granular_id.live.rows import Rows
from granular_id.recording import Dataset, transform
from live_view_cases import pushes_and_model
from sink_cases import rows_of


class Message:
    """Any message, with the fields that it is given."""

    def __init__(self, **fields):
        self.header = SimpleNamespace(stamp=None, frame_id="")
        vars(self).update(fields)


class DiagnosticStatus(Message):
    """Of diagnostic_msgs; rclpy gives a byte as bytes."""

    OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"


class TransformError(Exception):
    """Of tf2."""


def named(names, values):
    return SimpleNamespace(**dict(zip(names, values, strict=True)))


class FakeRos(Fake):
    """A graph with one node: an executor that hands it what a script yields, five messages at a turn.

    The script yields rows (6,), None for a message that is lost, or nothing any more: silence.
    """

    def __init__(self):
        super().__init__()
        self.script = iter(())
        self.types, self.rate_hz, self.frame_ids = ["geometry_msgs/msg/WrenchStamped"], 500.0, repeat("tool0")
        self.pose = None
        self.published, self.services, self.timers = {}, {}, []
        self._n = count()

    def modules(self):
        calls = {"init": self._init, "shutdown": lambda *, context: self.calls.append("shutdown")}
        reliability = SimpleNamespace(BEST_EFFORT="best effort")
        durability = SimpleNamespace(TRANSIENT_LOCAL="transient local")
        qos = {"QoSProfile": dict, "ReliabilityPolicy": reliability, "DurabilityPolicy": durability}
        messages = {"DiagnosticStatus": DiagnosticStatus, "DiagnosticArray": Message, "KeyValue": Message}
        tf = {"Buffer": lambda: SimpleNamespace(lookup_transform=self._lookup)}
        tf |= {"TransformListener": lambda buffer, node: None, "TransformException": TransformError}
        return {
            "rclpy": {"Context": object, "create_node": self._node, **calls},
            "rclpy.qos": qos,
            "rclpy.executors": {"SingleThreadedExecutor": self._executor},
            "rclpy.time": {"Time": lambda: 0},
            "geometry_msgs.msg": {"WrenchStamped": "WrenchStamped"},
            "diagnostic_msgs.msg": messages,
            "std_srvs.srv": {"Trigger": "Trigger"},
            "tf2_ros": tf,
        }

    def _init(self, *, args, context):
        self.calls.append(("init", args))
        if "wrong" in args:
            raise RuntimeError("Failed to parse ROS arguments: wrong")

    def _node(self, name, *, context):
        return SimpleNamespace(
            context=context,
            get_name=lambda: name,
            get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now")),
            create_publisher=self._publisher,
            create_subscription=self._subscribe,
            create_timer=lambda period_s, call: self.timers.append(call),
            create_service=lambda kind, name, answer: self.services.update({name: answer}),
            get_publishers_info_by_topic=lambda _: [SimpleNamespace(topic_type=one) for one in self.types],
            destroy_node=lambda: self.calls.append("destroy_node"),
        )

    def _publisher(self, kind, topic, profile):
        self.published[topic] = []
        return SimpleNamespace(publish=self.published[topic].append)

    def _subscribe(self, kind, topic, take, profile):
        assert (kind, profile) == ("WrenchStamped", {"depth": 500, "reliability": "best effort"})
        self._take = take
        return SimpleNamespace(topic_name=topic)

    def _executor(self, *, context):
        shutdown = lambda: self.calls.append("executor shutdown")  # noqa: E731
        return SimpleNamespace(add_node=lambda node: None, spin_once=self._spin, shutdown=shutdown)

    def _spin(self, timeout_sec):
        time.sleep(0.001)  # as a spin waits for its messages
        for call in self.timers:
            call()
        for _ in range(5):
            row = next(self.script, self)
            if row is self:
                return
            ns = round(1e9 * (1000 + (next(self._n) / self.rate_hz if self.rate_hz else 0)))
            if row is not None:
                stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
                header = SimpleNamespace(stamp=stamp, frame_id=next(self.frame_ids))
                wrench = SimpleNamespace(force=named("xyz", row[:3]), torque=named("xyz", row[3:]))
                self._take(SimpleNamespace(header=header, wrench=wrench))

    def _lookup(self, target, source, when):
        if self.pose is None:
            raise TransformError(f"{source!r} is not in the tree")
        turn, shift = self.pose
        found = SimpleNamespace(rotation=named("xyzw", turn), translation=named("xyz", shift))
        return SimpleNamespace(transform=found)

    def arm(self):
        return self.services["~/arm"](None, SimpleNamespace())

    def answers(self):
        """Level, message and values of each answer."""
        every = [array.status[0] for array in self.published["~/answer"]]
        return [(one.level, one.message, {v.key: v.value for v in one.values}) for one in every]


@pytest.fixture
def ros(monkeypatch):
    monkeypatch.setattr(ros2, "_LOOK_S", 0.02)
    monkeypatch.setattr(ros2, "WAIT_S", 0.2)
    return FakeRos().installed(monkeypatch)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Of recordings in the frame tool0."""
    data = Dataset([replace(one, meta={**one.meta, "frame": "tool0"}) for one in pushes_and_model()[0]])
    path = tmp_path_factory.mktemp("ros2") / "m.safetensors"
    gid.Identifier.fit(data, "hfmh", estimate=False).save(path)
    return str(path)


PUSH = gid.synthesize(["rice"], n_per_class=1, seed=7)[0].wrench


def rest(n=30_000):
    """So many rows; by default for some seconds: a test that fails must end."""
    yield from (PUSH[k % 40] for k in range(n))


def until_armed(ros):
    for _ in range(1000):
        if ros.arm().success:
            break
        yield from rest(25)


def pushes(ros, *, lost=(), last=True):
    """Arm as soon as it can be, and push."""
    yield from chain(until_armed(ros), rest(100))
    yield from (None if k in lost else row for k, row in enumerate(PUSH))
    yield from rest() if last else rest(300)


@pytest.fixture
def run(model, capsys):
    """Run the command; return what it prints, or, where it is refused, its error."""

    def call(*words, code=None):
        arguments = ["--topic", "/ft", "--model", model, *words]
        if code is None:
            main(arguments)
            return capsys.readouterr().out
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == code
        printed = capsys.readouterr()
        return printed.err if code == 2 else printed.out

    return call


def test_node_push_after_arming_is_answered(ros, run):
    ros.script = chain(rest(300), PUSH, rest(300), pushes(ros))  # the first push was not armed
    assert "rice after 1.00 s, final" in run("--n", "1", "--", "-r", "__ns:=/left")
    [(_, message, values)] = ros.answers()
    assert message.startswith("rice, margin")
    assert (values["label"], values["unknown"], values["synthetic_model"]) == ("rice", "null", "true")
    assert (values["missing"], values["push"]) == ("0", "1")
    assert {array.status[0].message for array in ros.published["/diagnostics"]} == {
        "waits for ~/arm",
        "armed",
    }
    assert ros.calls[0] == ("init", ["--ros-args", "-r", "__ns:=/left"])
    assert ros.calls[1:] == ["executor shutdown", "destroy_node", "shutdown"]


def test_node_always_takes_every_push_without_service(ros, run):
    ros.script = chain(rest(300), PUSH, rest(300), PUSH, rest())
    run("--n", "2", "--always")
    assert [values["push"] for _, _, values in ros.answers()] == ["1", "2"]
    assert ros.services == {}


def test_node_is_not_armed_in_motion_or_during_a_push(ros, run, monkeypatch):
    answers, is_busy, index = [], threading.Event(), ArmedTrigger.index

    def noting(trigger, rows):
        found = index(trigger, rows)
        if found is not None:
            is_busy.set()
        return found

    def script():
        yield from chain(rest(300), PUSH[:300])
        answers.append(ros.arm().message)
        yield from chain(rest(300), until_armed(ros), PUSH[:400])
        assert is_busy.wait(20)
        answers.append(ros.arm().message)
        yield from chain(PUSH[400:], rest())

    monkeypatch.setattr(ArmedTrigger, "index", noting)
    ros.script = script()
    run("--n", "1")
    assert "the force moved by" in answers[0]
    assert answers[1] == "a push is being captured"


def test_node_lost_message_fails_the_push(ros, run):
    ros.script = chain(pushes(ros, lost={300}, last=False), pushes(ros))
    assert "no answer: 1 sample (2 ms) is missing" in run("--n", "1")
    (level, _, values), (_, _, second) = ros.answers()
    assert (level, values["failure"], "label" in values) == (DiagnosticStatus.ERROR, "gap", False)
    assert second["label"] == "rice"


TURNED = ((0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)), (0.0, 0.0, -0.1))


def test_source_turns_messages_of_another_frame(ros):
    ros.script, ros.frame_ids, ros.pose = rest(), repeat("ft"), TURNED
    source = ros2.Ros2Source("/ft", 500.0, frame_for=lambda _: "tool0")
    rows = rows_of(source, 40)
    assert {row.tobytes() for row in rows.wrench} == {transform(row, *TURNED).tobytes() for row in PUSH[:40]}
    assert source.info.frame == "tool0"
    assert source.info.meta["tf"]["from"] == "ft"


def test_node_does_not_turn_an_accepted_frame(ros, run):
    ros.script, ros.frame_ids = pushes(ros), repeat("ft")
    out = run("--n", "1", "--accept", "frame")
    assert "warning: another set-up than in the training: frame 'ft', in training 'tool0'" in out


def test_node_frames_that_move_against_each_other_end_it(ros, run):
    def script():
        yield from rest(500)
        ros.pose = (TURNED[0], (0.0, 0.0, -0.102))
        yield from rest()

    ros.frame_ids, ros.pose, ros.script = repeat("ft"), TURNED, script()
    assert "the frames 'ft' and 'tool0' move against each other" in run(code=2)


@pytest.mark.parametrize(
    ("changes", "words", "wanted"),
    [
        ({"types": []}, (), "/ft: TimeoutError: nobody publishes it: see `ros2 topic list` (waited 0.2 s)"),
        ({}, (), "its publisher says nothing (waited 0.2 s)"),
        ({"types": ["geometry_msgs/msg/Wrench"]}, (), "it is of the type geometry_msgs/msg/Wrench, wanted"),
        ({"script": rest(), "rate_hz": 505.0}, (), "it comes at 505 Hz by its stamps, wanted 500 Hz"),
        ({"script": rest(), "rate_hz": 0}, (), "the stamps of its headers stand still"),
        ({"script": rest(), "frame_ids": chain(repeat("tool0", 300), repeat("b"))}, (), "'tool0' and 'b'"),
        ({"script": rest(), "frame_ids": repeat("ft")}, (), "tf has no transform between them ('ft' is not"),
        ({}, ("--", "wrong"), "ROS 2 did not start: Failed to parse ROS arguments"),
    ],
    ids=["nobody", "silent", "type", "rate", "stamps", "publishers", "tf", "arguments"],
)
def test_node_refuses_what_is_wrong_in_one_line(changes, words, wanted, ros, run):
    for name, value in changes.items():
        setattr(ros, name, value)
    error = run(*words, code=2)
    assert wanted in error
    assert error.count("\n") == 1


def test_node_ctrl_c_ends_it_with_the_summary(ros, run, heeding_interrupts):
    def script():
        yield from pushes(ros, last=False)
        while not ros.answers():
            yield from rest(25)
        _thread.interrupt_main()
        yield from rest()

    ros.script = script()
    assert "1 answer" in run(code=130)
    assert ros.calls[-3:] == ["executor shutdown", "destroy_node", "shutdown"]


def test_source_of_a_url_reads_the_topic(ros):
    ros.script = rest()
    source = open_source("ros2://ft_sensor/Wrench?rate_hz=500")
    rows = rows_of(source, 40)
    assert source.info.meta["topic"] == "/ft_sensor/Wrench"
    assert (source.info.meta["status"], source.info.frame) == (NOT_RUN, "tool0")
    assert np.array_equal(rows.wrench[:40], PUSH[:40])
    assert np.allclose(np.diff(rows.time_s), 0.002, atol=1e-6)


def forces(force_n, from_s=0.0):
    numbers = np.zeros(len(force_n), np.int64)
    wrench = np.outer(force_n, [1.0, 0, 0, 0, 0, 0])
    return Rows(wrench, from_s + np.arange(len(force_n)), numbers, numbers.astype(np.uint8), numbers)


def test_armed_trigger_runs_out(monkeypatch):
    trigger = ArmedTrigger(0.5)
    assert trigger.allow(forces([0.0] * 10)) is None
    monkeypatch.setattr(ros2_node.time, "monotonic", lambda: trigger._until_s)
    assert trigger.index(forces([1.0] * 10)) is None


def test_armed_trigger_motion_before_the_rest_is_no_push():
    trigger = ArmedTrigger(0.5)
    assert trigger.allow(forces([0.0] * 10, from_s=5.0)) is None
    assert trigger.index(forces([3.0] * 5 + [0.0] * 10 + [1.0])) == 15


@pytest.mark.parametrize("lost", [(), (300,), (300, 301, 302)])
def test_stamp_line_jittered_stamps_count_lost_rows(lost):
    rng, line, buffer = np.random.default_rng(0), ros2.StampLine(500.0), WrenchBuffer(10.0, rate_hz=500.0)
    for k in range(1500):
        if k not in lost:
            buffer.push(np.zeros(6), line.at(1000 + 1.00005 * (k + rng.uniform(-0.4, 0.4)) / 500))
    counts = buffer.stats()
    assert (counts["written"], counts["missing"]) == (1500 - len(lost), len(lost))


def test_stamp_line_same_stamp_is_no_row_an_old_one_begins_anew():
    line = ros2.StampLine(500.0)
    times = [line.at(1000 + k / 500) for k in (0, 1, 2, 2, 3)]
    assert times[2] == times[3] < times[4]
    assert line.at(900.0) == 900.0
