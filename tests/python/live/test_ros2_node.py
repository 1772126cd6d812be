"""The node of ROS 2, with a stand-in of rclpy, tf2_ros and the messages: nobody has run it with ROS."""

import _thread
import json
import sys
import time
from dataclasses import replace
from itertools import chain, count, repeat
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import granular_id as gid
from cli_cases import refused, run
from granular_id.live import WrenchBuffer, ros2
from granular_id.live.rows import Rows
from granular_id.recording import Dataset, transform
from live_view_cases import push as rows_of_push, pushes_and_model
from sink_cases import Sink

RATE_HZ = 500.0


class Message:
    """Any message, with the fields that it is given."""

    def __init__(self, **fields):
        self.header = SimpleNamespace(stamp=None, frame_id="")
        vars(self).update(fields)


class WrenchStamped:
    """Of geometry_msgs."""


class DiagnosticStatus(Message):
    """Of diagnostic_msgs; rclpy gives a byte as bytes."""

    OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"


class TransformError(Exception):
    """Of tf2."""


class QoSProfile:
    """Of rclpy: depth alone is keep last, reliable, volatile."""

    def __init__(self, *, depth, history="keep last", reliability="reliable", durability="volatile"):
        self.depth, self.history, self.reliability, self.durability = depth, history, reliability, durability


def compatible(offered, wanted):
    bad = (offered.reliability, wanted.reliability) == ("best effort", "reliable")
    return ("error", "ERROR: Best effort publisher and reliable subscription;") if bad else ("ok", "")


class Ros:
    """A graph with one node: an executor that hands it what a script yields, five messages at a turn.

    The script yields rows (6,), None for a message that is lost, or nothing any more: silence.
    """

    def __init__(self):
        self.script = iter(())
        self.types, self.offered = ["geometry_msgs/msg/WrenchStamped"], QoSProfile(depth=5)
        self.rate_hz, self.frame_ids, self.pose = RATE_HZ, repeat("tool0"), None
        self.published, self.profiles, self.services, self.calls = {}, {}, {}, []
        self._n = count()

    def installed(self, monkeypatch):
        reliability = SimpleNamespace(RELIABLE="reliable", BEST_EFFORT="best effort")
        qos = {"QoSProfile": QoSProfile, "ReliabilityPolicy": reliability, "qos_check_compatible": compatible}
        qos |= {"HistoryPolicy": SimpleNamespace(KEEP_LAST="keep last")}
        qos |= {"QoSCompatibility": SimpleNamespace(ERROR="error")}
        qos |= {"DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL="transient local")}
        messages = {"DiagnosticStatus": DiagnosticStatus, "DiagnosticArray": Message, "KeyValue": Message}
        tf = {"Buffer": self._buffer, "TransformListener": lambda buffer, node: None}
        modules = {
            "rclpy": {
                "Context": object,
                "init": self._init,
                "shutdown": self._shutdown,
                "create_node": self._node,
            },
            "rclpy.qos": qos,
            "rclpy.executors": {"SingleThreadedExecutor": self._executor},
            "rclpy.time": {"Time": lambda: 0},
            "geometry_msgs.msg": {"WrenchStamped": WrenchStamped},
            "diagnostic_msgs.msg": messages,
            "std_srvs.srv": {"Trigger": "Trigger"},
            "tf2_ros": tf | {"TransformException": TransformError},
        }
        for name, content in modules.items():
            module = ModuleType(name)
            vars(module).update(content)
            monkeypatch.setitem(sys.modules, name, module)
        return self

    def _init(self, *, args, context):
        self.calls.append(("init", args))
        if "wrong" in args:
            raise RuntimeError("Failed to parse ROS arguments: wrong")

    def _shutdown(self, *, context):
        self.calls.append("shutdown")

    def _node(self, name, *, context):
        clock = SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now"))
        return SimpleNamespace(
            context=context,
            get_name=lambda: name,
            get_clock=lambda: clock,
            create_publisher=self._publisher,
            create_subscription=self._subscribe,
            create_service=lambda kind, name, answer: self.services.update({name: answer}),
            get_publishers_info_by_topic=lambda topic: [
                SimpleNamespace(topic_type=one, qos_profile=self.offered) for one in self.types
            ],
            destroy_node=lambda: self.calls.append("destroy_node"),
        )

    def _publisher(self, kind, topic, profile):
        self.profiles[topic], self.published[topic] = profile, []
        return SimpleNamespace(publish=self.published[topic].append)

    def _subscribe(self, kind, topic, take, profile):
        assert kind is WrenchStamped
        if " " in topic:
            raise Exception(f"Invalid topic name: must not hold blanks:\n  {topic!r}\n   ^")  # noqa: TRY002
        self.profiles[topic], self._take = profile, take
        return SimpleNamespace(topic_name=topic)

    def _executor(self, *, context):
        shutdown = lambda: self.calls.append("executor shutdown")  # noqa: E731
        return SimpleNamespace(add_node=lambda node: None, spin_once=self._spin, shutdown=shutdown)

    def _spin(self, timeout_sec):
        time.sleep(0.001)
        for _ in range(5):
            row = next(self.script, self)
            if row is self:
                return
            seconds = 1000.0 if self.rate_hz == 0 else 1000.0 + next(self._n) / self.rate_hz
            if row is not None:
                self._take(self._message(row, round(seconds * 1e9)))

    def _message(self, row, stamp_ns):
        force, torque = (
            SimpleNamespace(**dict(zip("xyz", part, strict=True))) for part in (row[:3], row[3:])
        )
        stamp = SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        header = SimpleNamespace(stamp=stamp, frame_id=next(self.frame_ids))
        return SimpleNamespace(header=header, wrench=SimpleNamespace(force=force, torque=torque))

    def _buffer(self):
        def lookup(target, source, when):
            if self.pose is None:
                raise TransformError(f"{source!r} is not in the tree")
            self.calls.append(("lookup", target, source))
            turn, shift = (
                SimpleNamespace(**dict(zip(names, part, strict=True)))
                for names, part in zip(("xyzw", "xyz"), self.pose, strict=True)
            )
            return SimpleNamespace(transform=SimpleNamespace(rotation=turn, translation=shift))

        return SimpleNamespace(lookup_transform=lookup)

    def arm(self):
        return self.services["~/arm"](None, SimpleNamespace())

    def said(self, topic):
        """Level, message and values of each message."""
        every = [array.status[0] for array in self.published[topic]]
        return [(one.level, one.message, {v.key: v.value for v in one.values}) for one in every]


@pytest.fixture
def ros(monkeypatch):
    monkeypatch.setattr(ros2, "_LOOK_S", 0.02)
    return Ros().installed(monkeypatch)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Of recordings in the frame tool0."""
    data = Dataset([replace(one, meta={**one.meta, "frame": "tool0"}) for one in pushes_and_model()[0]])
    path = tmp_path_factory.mktemp("ros2") / "m.safetensors"
    gid.Identifier.fit(data, "hfmh", estimate=False).save(path)
    return path


def called(model, *words):
    return ("ros2", "--topic", "/ft", "--model", model, "--wait-s", 0.2, *words)


PUSH = rows_of_push("rice", seed=7, rest=0)[1]


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
    yield from until_armed(ros)
    yield from rest(100)
    yield from (None if k in lost else row for k, row in enumerate(PUSH))
    yield from rest() if last else rest(300)


def ended_well(*words):
    result = run(*words)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_push_after_arming_is_answered(ros, model):
    ros.script = pushes(ros)
    assert "rice after 1.00 s, final" in ended_well(*called(model, "--n", 1))
    [(_, message, values)] = ros.said("~/answer")
    assert message.startswith("rice, margin")
    assert values["label"] == "rice"
    assert json.loads(values["candidates"]) == []
    assert {values[name] for name in ("unknown", "probability")} == {"null"}
    assert float(values["margin"]) > 0
    assert float(values["lag_s"]) >= 0
    assert (values["missing"], values["missed"], values["push"], values["synthetic_model"]) == (
        "0",
        "0",
        "1",
        "true",
    )


def test_topics_have_the_quality_of_service_that_is_stated(ros, model):
    ros.script = pushes(ros)
    ended_well(*called(model, "--n", 1, "--depth", 7))
    heard, kept = ros.profiles["/ft"], ros.profiles["~/answer"]
    assert (heard.reliability, heard.history, heard.depth) == ("best effort", "keep last", 7)
    assert (kept.reliability, kept.durability, kept.depth) == ("reliable", "transient local", 1)


def test_it_leaves_nothing_behind(ros, model):
    ros.script = pushes(ros)
    ended_well(*called(model, "--n", 1, "--", "-r", "__ns:=/left"))
    assert ros.calls == [
        ("init", ["--ros-args", "-r", "__ns:=/left"]),
        "executor shutdown",
        "destroy_node",
        "shutdown",
    ]


def test_pushes_that_nobody_armed_are_left_alone(ros, model):
    ros.script = chain(rest(300), PUSH, rest(300), pushes(ros))
    ended_well(*called(model, "--n", 1))
    assert len(ros.said("~/answer")) == 1


def test_always_takes_every_push_and_has_no_service(ros, model):
    ros.script = chain(rest(300), PUSH, rest(300), PUSH, rest())
    ended_well(*called(model, "--n", 2, "--always"))
    assert [values["push"] for _, _, values in ros.said("~/answer")] == ["1", "2"]
    assert ros.services == {}


def test_it_is_not_armed_while_the_tool_moves(ros, model):
    answers = []

    def script():
        yield from rest(300)
        yield from PUSH[:300]
        answers.append(ros.arm())
        yield from pushes(ros)

    ros.script = script()
    ended_well(*called(model, "--n", 1))
    assert not answers[0].success
    assert "the force moved by" in answers[0].message


def test_it_is_armed_though_a_message_was_lost_at_rest(ros, model):
    answers = []

    def script():
        yield from until_armed(ros)
        yield from [None, *rest(30)]
        answers.append(ros.arm().success)
        yield from pushes(ros)

    ros.script = script()
    ended_well(*called(model, "--n", 1))
    assert answers == [True]


def test_it_is_not_armed_again_during_a_push(ros, model):
    answers = []

    def script():
        yield from until_armed(ros)
        yield from PUSH[:400]
        while len(answers) < 500 and "a push is being captured" not in answers:
            time.sleep(0.01)  # the capture reads its rows meanwhile
            answers.append(ros.arm().message)
        yield from PUSH[400:]
        yield from rest()

    ros.script = script()
    ended_well(*called(model, "--n", 1))
    assert answers[-1] == "a push is being captured"
    assert "armed: the next motion is the push" not in answers


def test_lost_messages_are_filled_in_and_counted_where_that_is_allowed(ros, model):
    ros.script = pushes(ros, lost={300, 301})
    ended_well(*called(model, "--n", 1, "--max-gap", 2))
    [(level, _, values)] = ros.said("~/answer")
    assert (level, values["missing"]) == (DiagnosticStatus.WARN, "2")
    assert "gap" in json.loads(values["warnings"])


def test_else_there_is_no_answer_and_it_is_published_why(ros, model):
    ros.script = chain(pushes(ros, lost={300}, last=False), pushes(ros))
    assert "no answer: 1 sample (2 ms) is missing" in ended_well(*called(model, "--n", 1))
    (level, message, values), (_, _, second) = ros.said("~/answer")
    assert level == DiagnosticStatus.ERROR
    assert "1 sample (2 ms) is missing" in message
    assert (values["failure"], values["push"], "label" in values) == ("gap", "1", False)
    assert second["label"] == "rice"


def test_diagnostics_tell_whether_it_is_armed_and_how_the_stream_is(ros, model):
    def told():
        return {message: values for _, message, values in ros.said("/diagnostics")}

    def script():
        for _ in range(1000):
            if "waits for ~/arm" in told():
                break
            yield from rest(25)
        yield from pushes(ros)

    ros.script = script()
    ended_well(*called(model, "--n", 1))
    assert told()["waits for ~/arm"]["armed"] == "false"
    assert {"lag_s", "missing", "missed"} < set(told()["waits for ~/arm"])
    assert "complete" in told()


TURNED = ((0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)), (0.0, 0.0, -0.1))


def test_messages_of_another_frame_are_turned_into_that_of_the_model(ros):
    ros.script, ros.frame_ids, ros.pose = rest(), repeat("ft"), TURNED
    source = ros2.Ros2Source(ros._node("n", context=None), "/ft", RATE_HZ, frame_for=lambda _: "tool0")
    sink = Sink()
    source.start(sink)
    sink.wait(40)
    source.stop()
    assert ("lookup", "tool0", "ft") in ros.calls
    assert {row.tobytes() for row in sink.wrench} == {transform(row, *TURNED).tobytes() for row in PUSH[:40]}
    assert source.info.frame == "tool0"
    assert source.info.meta["tf"]["from"] == "ft"


def test_a_model_of_another_frame_answers_by_tf(ros, model):
    ros.frame_ids, ros.pose = repeat("ft"), TURNED
    turn, shift = Rotation.from_quat(TURNED[0]).inv(), np.array(TURNED[1])
    ros.script = (transform(row, turn, -turn.apply(shift)) for row in pushes(ros))
    assert "rice after" in ended_well(*called(model, "--n", 1))


def test_an_accepted_frame_is_not_turned(ros, model):
    ros.script, ros.frame_ids = pushes(ros), repeat("ft")
    out = ended_well(*called(model, "--n", 1, "--accept", "frame"))
    assert "warning: another set-up than in the training: frame 'ft', in training 'tool0'" in out


def test_messages_without_a_frame_are_warned_of(ros, model):
    ros.script, ros.frame_ids = pushes(ros), repeat("")
    assert "warning: messages name no frame" in ended_well(*called(model, "--n", 1))


@pytest.mark.parametrize(
    "moved", [(TURNED[0], (0.0, 0.0, -0.102)), ((0.0, 0.0, 0.6, 0.8), TURNED[1])], ids=["shifted", "turned"]
)
def test_a_frame_that_moves_against_that_of_the_model_ends_it(moved, ros, model):
    ros.frame_ids, ros.pose = repeat("ft"), TURNED

    def script():
        yield from rest(500)
        ros.pose = moved
        yield from rest()

    ros.script = script()
    assert "the frames 'ft' and 'tool0' move against each other" in refused(*called(model))


@pytest.mark.parametrize(
    ("changes", "words", "wanted"),
    [
        ({"types": []}, (), "/ft: TimeoutError: nobody publishes it: see `ros2 topic list` (waited 0.2 s)"),
        ({}, (), "its publisher says nothing (waited 0.2 s)"),
        (
            {"types": ["geometry_msgs/msg/Wrench"]},
            (),
            "TypeError: it is of the type geometry_msgs/msg/Wrench, wanted",
        ),
        (
            {"offered": QoSProfile(depth=5, reliability="best effort")},
            ("--reliable",),
            "(ERROR: Best effort publisher and reliable subscription): leave out --reliable",
        ),
        (
            {"script": rest(), "rate_hz": 125.0},
            (),
            "it comes at 125 Hz by its stamps, the model is for 500 Hz",
        ),
        ({"script": rest(), "rate_hz": 505.0}, (), "it comes at 505 Hz by its stamps"),
        ({"script": rest(), "rate_hz": 0}, (), "the stamps of its headers stand still"),
        (
            {"script": rest(), "frame_ids": chain(repeat("tool0", 300), repeat("b"))},
            (),
            "frames 'tool0' and 'b'",
        ),
        (
            {"script": rest(), "frame_ids": repeat("ft")},
            (),
            "tf has no transform between them ('ft' is not in the tree)",
        ),
        ({}, ("--", "wrong"), "ROS 2 did not start: Failed to parse ROS arguments"),
        ({}, ("--topic", "f t"), "ROS 2 did not start: Invalid topic name: must not hold blanks: 'f t' ^"),
        ({}, ("--topic", ""), "--topic must name a topic"),
        ({}, ("--depth", 0), "--depth must be at least 1, got 0"),
    ],
    ids=[
        "nobody",
        "silent",
        "type",
        "qos",
        "rate",
        "rate, a little off",
        "stamps",
        "publishers",
        "tf",
        "arguments",
        "topic",
        "no topic",
        "depth",
    ],
)
def test_what_is_wrong_is_said_in_one_line(changes, words, wanted, ros, model):
    for name, value in changes.items():
        setattr(ros, name, value)
    assert wanted in refused(*called(model, *words))


def test_a_topic_that_falls_silent_is_published_as_a_failure(ros, model):
    ros.script = rest(500)
    assert "ROS 2 topic /ft delivered nothing for 1 s" in refused(*called(model))
    [(level, _, values)] = ros.said("~/answer")
    assert (level, values["failure"]) == (DiagnosticStatus.ERROR, "no rows")


def test_without_ros_it_is_said_how_to_source_it(model, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    result = run(*called(model))
    assert result.exit_code == 1
    assert (
        "rclpy is needed, which comes with ROS 2: first `source /opt/ros/DISTRO/setup.bash`" in result.stderr
    )
    assert result.stderr.count("\n") == 1


def test_ctrl_c_ends_it_with_the_tally(ros, model, heeding_interrupts):
    def script():
        yield from pushes(ros, last=False)
        while not ros.said("~/answer"):
            yield from rest(25)
        _thread.interrupt_main()
        yield from rest()

    ros.script = script()
    result = run(*called(model))
    assert result.exit_code == 130, result.output
    assert "1 answer" in result.stdout
    assert ros.calls[-3:] == ["executor shutdown", "destroy_node", "shutdown"]


def rows_of(force_n, from_s=0.0):
    numbers = np.zeros(len(force_n), np.int64)
    wrench = np.outer(force_n, [1.0, 0, 0, 0, 0, 0])
    return Rows(wrench, from_s + np.arange(len(force_n)), numbers, numbers.astype(np.uint8), numbers)


def test_arming_runs_out():
    trigger = ros2.ArmedTrigger(0.5, arm_s=0.0)
    assert trigger.allow(rows_of([0.0] * 10)) is None
    assert trigger.index(rows_of([1.0] * 10)) is None


def test_what_moved_before_the_rest_that_armed_is_no_push():
    trigger = ros2.ArmedTrigger(0.5, arm_s=30.0)
    assert trigger.allow(rows_of([0.0] * 10, from_s=5.0)) is None
    assert trigger.index(rows_of([3.0] * 5 + [0.0] * 10 + [1.0])) == 15


@pytest.mark.parametrize("lost", [(), (300,), (300, 301, 302)])
def test_stamps_may_jitter_by_almost_half_a_period_and_lost_rows_are_counted_all_the_same(lost):
    rng, line, buffer = np.random.default_rng(0), ros2.StampLine(500.0), WrenchBuffer(10.0, rate_hz=500.0)
    for k in range(1500):
        if k not in lost:
            buffer.push(np.zeros(6), line.at(1000 + 1.00005 * (k + rng.uniform(-0.4, 0.4)) / 500))
    counts = buffer.stats()
    assert (counts["written"], counts["missing"]) == (1500 - len(lost), len(lost))


def test_a_stamp_that_comes_again_is_no_row_and_one_of_long_before_begins_anew():
    line = ros2.StampLine(500.0)
    times = [line.at(1000 + k / 500) for k in (0, 1, 2, 2, 3)]
    assert times[2] == times[3] < times[4]
    assert line.at(900.0) == 900.0
