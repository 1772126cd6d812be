"""Adapters against stand-ins of the libraries they use; Bota's also against the dummy of its own driver."""

from __future__ import annotations

import sys
import threading

import numpy as np
import pytest
from granular_id_contrib import NOT_RUN, ur as ur_module
from granular_id_contrib.bota import BotaSource

from adapter_fakes import FakeBota, FakeUR
from granular_id.live import open_robot, open_source, opened, setup_of
from granular_id.live.source import WrenchSource
from granular_id.recording import SampleFlag
from sink_cases import begun, rows_in, rows_of


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


def test_ur_source(ur):
    source = open_source("ur://192.168.0.3?rate_hz=500")
    assert isinstance(source, WrenchSource)
    assert source.info.meta["status"] == NOT_RUN
    assert ur.calls == [], "nothing is connected before the start"
    rows = rows_of(source, 30)
    assert ur.calls == [("receive", "192.168.0.3", 500.0), ("receive disconnect",)]
    assert rows.wrench[0].tolist() == [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    steps = np.diff(rows.time_s) / 0.002
    assert steps.min() > 0.9, "each sample once"
    assert np.allclose(steps, np.rint(steps))


def test_ur_controller_that_is_lost_ends_the_source(ur):
    source = open_source("ur://arm")
    buffer = begun(source)
    rows_in(buffer, 1)
    ur.began_s = 1.0  # it was started anew
    _, epochs = rows_in(buffer, buffer.stats()["written"] + 3)
    assert len(epochs) == 2
    ur.connected = False
    source._thread.join(20)
    assert source.health().error == "ConnectionError: the connection to arm is lost"
    assert ur.calls[-1] == ("receive disconnect",)


def test_ur_robot_pushes_and_goes_back(ur):
    robot = open_source("ur://arm").robot()
    assert robot.move_back() is None, "nothing was pushed"
    motion = robot.move_line((0, 2, 0), 0.03, 3.0)
    name, target, speed, acceleration, asynchronous = ur.calls[-1]
    assert (name, speed, acceleration, asynchronous) == ("moveL", 0.03, 1.2, True)
    assert target == pytest.approx([0.4, -0.1 + 0.03 * (3.0 - 0.03 / 1.2), 0.2, 0.0, 3.1, 0.0])
    assert not motion.finished()
    assert motion.report()["robot"] == "ur"
    start, ur.pose, ur.moving = ur.pose, tuple(target), False
    assert motion.finished()
    back = robot.move_back()
    assert ur.calls[-1] == ("moveL", list(start), 0.03, 1.2, True)
    assert (back.finished(), back.report()["start"]) == (False, target)
    robot.close()
    assert [call[0] for call in ur.calls[-3:]] == ["stopScript", "control disconnect", "receive disconnect"]
    ur.refuse = True
    with pytest.raises(RuntimeError, match="refused moveL"):
        open_robot("ur://arm").move_line((1, 0, 0), 0.03, 3.0)


def test_ur_robot_stops_again_beside_a_call_that_hangs(ur, monkeypatch):
    monkeypatch.setattr(ur_module, "_CROSSING_S", 0.0)
    robot = open_robot("ur://arm")
    motion = robot.move_line((1, 0, 0), 0.03, 3.0)
    ur.hangs, ur.release = threading.Event(), threading.Event()
    hanging = threading.Thread(target=robot.stop)
    hanging.start()
    assert ur.hangs.wait(20)
    robot.stop()
    assert motion.finished()
    assert ur.calls[-2:] == [("stopL", 10.0, True)] * 2
    ur.release.set()
    hanging.join(20)


def test_ur_robot_shares_the_clock_of_its_own_source_only(ur):
    source = open_source("ur://arm")
    own, other = (setup_of(source, robot).robot for robot in ("source", "ur://arm"))
    assert isinstance(own.move_line((1, 0, 0), 0.03, 3.0).start_time_s, float)
    assert other.move_line((1, 0, 0), 0.03, 3.0).start_time_s is None, "a sensor of its own has its own clock"
    assert setup_of(source).robot is None, "no machine moves unasked"


def test_bota(bota, config):
    source = open_source(f"bota:{config}")
    assert bota.calls == [("config", str(config))]
    assert (source.info.rate_hz, source.info.tick_hz) == (1000.0, 1e6)
    rows = rows_of(source, 80)
    assert bota.calls[1:] == [("activate",), ("deactivate",), ("shutdown",)]
    assert rows.wrench[7].tolist() == [1.0, 2.0, 7.0, 0.1, 0.2, 0.3]
    assert rows.time_s[:3] == pytest.approx([5.0, 5.001, 5.002])
    assert np.flatnonzero(rows.flags == SampleFlag.SATURATED)[0] == 49
    assert np.flatnonzero(rows.flags == SampleFlag.BAD_STATUS)[0] == 69


@pytest.mark.parametrize("fails", ["configures", "activates"])
def test_bota_that_does_not_start(bota, config, fails):
    setattr(bota, fails, False)
    with pytest.raises(ConnectionError, match=f"could not be {fails[:-1]}d"), opened(f"bota:{config}"):
        pass
    assert (("shutdown",) in bota.calls) == (fails == "activates")


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
    time_s = rows_of(source, 10).time_s
    assert (time_s[-1] - time_s[1]) / (len(time_s) - 2) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(
    ("url", "error", "match"),
    [
        ("ros2://topic", ValueError, "there is no rate of the topic"),
        ("ur://", ValueError, "there is no host; wanted ur://HOST"),
        ("bota:none.json", FileNotFoundError, r"none\.json: no such configuration"),
        ("ur://arm", ImportError, "rtde_receive is needed .* pip install ur-rtde"),
        ("ros2://t?rate_hz=1", ImportError, "first `source /opt/ros"),
    ],
)
def test_open_source_bad_url_of_contrib_is_refused(url, error, match, bota, monkeypatch):
    for missing in ("rtde_receive", "rclpy"):
        monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(error, match=match):
        open_source(url)
