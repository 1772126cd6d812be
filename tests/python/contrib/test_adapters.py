"""Adapters against stand-ins of the libraries they use; Bota's also against the dummy of its own driver."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest
from granular_id_contrib import NOT_RUN
from granular_id_contrib.bota import BotaSource

from adapter_fakes import FakeBota, FakeUR
from granular_id.live import Robot, WrenchSource, open_robot, open_source, opened, setup_of
from granular_id.recording import SampleFlag
from sink_cases import eventually


@pytest.fixture
def ur(monkeypatch):
    return FakeUR().installed(monkeypatch)


@pytest.fixture
def bota(monkeypatch):
    return FakeBota().installed(monkeypatch)


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "sensor.json"
    path.write_text("{}")
    return path


def watched(source, n_rows):
    """Run a source until so many rows are there; nothing is written after its stop. Returns the rows."""
    with opened(source) as stream:
        reader = stream.buffer.reader(from_oldest=True)
        eventually(lambda: stream.buffer.stats()["written"] >= n_rows)
        assert source.health().running
    source.stop()
    assert (source.health().running, source.health().error) == (False, None)
    written = stream.buffer.stats()["written"]
    time.sleep(0.01)
    assert stream.buffer.stats()["written"] == written
    return reader.read()


def test_ur_source(ur):
    source = open_source("ur://192.168.0.3?rate_hz=500")
    assert isinstance(source, WrenchSource)
    assert source.info.meta["status"] == NOT_RUN
    assert ur.calls == [], "nothing is connected before the start"
    rows = watched(source, 30)
    assert ur.calls == [("receive", "192.168.0.3", 500.0), ("receive disconnect",)]
    assert rows.wrench[0].tolist() == [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    steps = np.diff(rows.time_s) / 0.002
    assert steps.min() > 0.9, "each sample once"
    assert np.allclose(steps, np.rint(steps))


def test_ur_controller_that_starts_anew_and_one_that_is_lost(ur):
    with opened("ur://arm") as stream:
        ur.began_s = 1.0
        eventually(lambda: stream.health().counters["epochs"] == 1)
        ur.connected = False
        eventually(lambda: stream.health().error is not None)
        assert "ConnectionError: the connection to arm is lost" in stream.health().error
        assert not stream.health().running


def test_ur_robot(ur):
    robot = open_source("ur://arm").robot()
    motion = robot.move_line((0, 2, 0), 0.03, 3.0)
    name, target, speed, acceleration, asynchronous = ur.calls[-1]
    assert (name, speed, acceleration, asynchronous) == ("moveL", 0.03, 1.2, True)
    assert target[:3] == pytest.approx([0.4, -0.1 + 0.03 * (3.0 - 0.03 / 1.2), 0.2])
    assert target[3:] == [0.0, 3.1, 0.0]
    assert not motion.finished()
    robot.stop()
    assert ur.calls[-1] == ("stopL", 1.2)
    assert motion.finished()
    assert motion.report()["robot"] == "ur"
    robot.close()
    assert [call[0] for call in ur.calls[-3:]] == ["stopScript", "control disconnect", "receive disconnect"]
    ur.refuse = True
    with pytest.raises(RuntimeError, match="refused moveL"):
        open_robot("ur://arm").move_line((1, 0, 0), 0.03, 3.0)


def test_the_clock_of_an_arm_is_that_of_its_own_source_only(ur):
    source = open_source("ur://arm")
    own, other = setup_of(source, "source").robot, setup_of(source, "ur://arm").robot
    assert isinstance(own, Robot)
    assert isinstance(own.move_line((1, 0, 0), 0.03, 3.0).start_time_s, float)
    assert setup_of(source).robot is None, "no machine moves unasked"
    alone = other.move_line((1, 0, 0), 0.03, 3.0)
    assert alone.start_time_s is None, "a sensor beside the arm has a clock of its own"
    assert alone.start_host_ns > 0


def test_an_arm_does_not_push_on_from_where_it_ended(ur):
    robot, at = open_robot("ur://arm"), [0.4]
    robot.tcp_pose = lambda: (at[0], 0.0, 0.2, 0.0, 0.0, 0.0)
    robot.move_line((1, 0, 0), 0.03, 3.0)
    n, at[0] = len(ur.calls), 0.487
    with pytest.raises(RuntimeError, match="stands 87 mm ahead of where the last push began: bring it back"):
        robot.move_line((1, 0, 0), 0.03, 3.0)
    assert len(ur.calls) == n, "nothing was commanded"
    robot.move_line((-1, 0, 0), 0.03, 3.0)
    for at[0] in (0.4, 0.407):
        robot.move_line((1, 0, 0), 0.03, 3.0)
    at[0] = 0.411
    with pytest.raises(RuntimeError, match="11 mm ahead"):
        robot.move_line((1, 0, 0), 0.03, 3.0)


def test_bota(bota, config):
    source = open_source(f"bota:{config}")
    assert bota.calls == [("config", str(config))]
    assert (source.info.rate_hz, source.info.tick_hz) == (1000.0, 1e6)
    rows = watched(source, 80)
    assert bota.calls[1:] == [("activate",), ("deactivate",), ("shutdown",)]
    assert rows.wrench[7].tolist() == [1.0, 2.0, 7.0, 0.1, 0.2, 0.3]
    assert rows.time_s[:3] == pytest.approx([5.0, 5.001, 5.002])
    assert np.flatnonzero(rows.flags == SampleFlag.SATURATED)[0] == 49
    assert np.flatnonzero(rows.flags == SampleFlag.BAD_STATUS)[0] == 69
    assert source.health().counters == {"throttled": 1}


@pytest.mark.parametrize("fails", ["configures", "activates"])
def test_bota_that_does_not_start(bota, config, fails):
    setattr(bota, fails, False)
    with pytest.raises(ConnectionError, match=f"could not be {fails[:-1]}d"), opened(f"bota:{config}"):
        pass


def test_bota_dummy_of_the_real_driver():
    driver = pytest.importorskip("bota_driver")
    config = driver.BotaDriverConfig()
    config.product_name, config.serial_number = "BFT-DUMMY-DUMMY-DUMMY", "SN000001"
    config.communication_interface_name = "Bota_Dummy"
    config.dummy_communication_interface_params = driver.BotaDummyCommunicationInterfaceConfig()
    config.genA_sensor_operation_params = driver.GenASensorOperationConfig()
    config.genA_sensor_operation_params.app_mode = 0
    config.genA_sensor_operation_params.app_submode = 1
    source = BotaSource(config)
    assert source.info.rate_hz == 20
    rows = watched(source, 10)
    assert rows.wrench.shape[1] == 6
    assert (rows.time_s[-1] - rows.time_s[1]) / (len(rows) - 2) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(
    ("url", "error", "match"),
    [
        ("ros2://topic", ValueError, "needs the rate of the topic"),
        ("ros2://?rate_hz=500", ValueError, "has no topic"),
        ("ur://", ValueError, "has no host; wanted ur://HOST"),
        ("bota:x?speed=3", ValueError, "has no option 'speed'; known: none"),
        ("ur://arm?rate_hz=fast", ValueError, "option rate_hz='fast'"),
        ("bota:none.json", FileNotFoundError, r"none\.json: no such configuration"),
        ("ur://arm", ImportError, "rtde_receive is needed .* pip install ur-rtde"),
        ("ros2://t?rate_hz=1", ImportError, "first `source /opt/ros"),
    ],
)
def test_what_cannot_be_opened(url, error, match, bota, monkeypatch):
    for missing in ("rtde_receive", "rclpy"):
        monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(error, match=match):
        open_source(url)
