"""The simulated bench: the same samples whatever the clock, the same physics as `synthesize`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from granular_id.live.sim import SimSource, SimWorld
from granular_id.recording import SampleFlag
from granular_id.synthetic import PAPER_MATERIALS, Sensor, synthesize
from sink_cases import begun, rows_in

RICE = PAPER_MATERIALS[1]
RATE_HZ = 500.0


def world(seed=1):
    return SimWorld([RICE], RATE_HZ, seed)


def played(bench, push, chunk=10_000):
    """All samples of a push that was just commanded."""
    parts = []
    while (left := push.end_tick - bench.tick) > 0:
        parts.append(bench.advance(min(chunk, left))[0])
    return np.concatenate(parts)


@settings(max_examples=8)
@given(rests=st.lists(st.integers(0, 300), min_size=2, max_size=3), chunk=st.integers(1, 500))
def test_sim_push_does_not_depend_on_when_it_is_commanded(rests, chunk):
    bench, other = world(), world()
    for rest in rests:
        bench.advance(rest)
        one = played(bench, bench.plan(0.03, 0.2), chunk)
        two = played(other, other.plan(0.03, 0.2))
        assert np.array_equal(one, two)


def test_sim_pushes_differ_from_each_other_and_synthesize():
    bench, other = world(0), world(2)
    one, two = bench.plan(0.03, 0.5), other.plan(0.03, 0.5)
    made = {r.meta["conditions"]["depth_offset_m"] for r in synthesize(["rice"], n_per_class=4, seed=0)}
    assert not np.array_equal(one.wrench, two.wrench)
    pushes = [one]
    for _ in range(2):
        bench.cut()
        pushes.append(bench.plan(0.03, 0.5))
    assert len({push.wrench.tobytes() for push in pushes}) == 3
    assert len({push.meta["conditions"]["depth_offset_m"] for push in pushes} | made) == 3 + len(made)


def test_sim_rest_reads_zero_point_and_noise():
    bench, other = world(), world()
    rest, flags = bench.advance(5000)
    assert np.array_equal(rest, np.concatenate([other.advance(n)[0] for n in (1, 2, 97, 4900)]))
    tare = bench.plan(0.03, 0.1).meta["conditions"]["tare"]
    assert np.allclose(rest.mean(axis=0), tare, atol=4 * np.max(Sensor().noise_rms) / np.sqrt(5000))
    assert np.allclose(rest.std(axis=0), Sensor().noise_rms, rtol=0.1)
    assert not flags.any()


def test_sim_saturation_is_flagged():
    weak = world()
    weak.sensor = Sensor(full_scale=(1.0, 145, 290, 5, 5, 5))
    push = weak.plan(0.03, 1.0)
    wrench, flags = weak.advance(push.end_tick)
    assert wrench[:, 0].max() == 1.0
    assert np.array_equal(flags == SampleFlag.SATURATED, np.abs(wrench[:, 0]) >= 1.0)


@pytest.mark.parametrize("materials", ["unknown", ["rice", "fine sugar"]])
def test_sim_materials_are_drawn(materials):
    source = SimSource(materials, seed=4)
    assert source.truth is None
    seen = set()
    for _ in range(12):
        push = source.world.plan(0.03, 0.1)
        assert push.meta["material"]["name"] == source.truth
        seen.add(source.truth)
        source.world.cut()
    assert len(seen) >= 5 if materials == "unknown" else seen == set(materials)


def test_sim_push_that_cannot_be_is_refused():
    bench = world()
    bench.plan(0.03, 0.5)
    with pytest.raises(RuntimeError, match="still moving"):
        bench.plan(0.03, 0.5)
    with pytest.raises(RuntimeError, match="simulated rice is not started"):
        SimSource("rice", seed=1).robot().move_line((1, 0, 0), 0.03, 1.0)


def test_sim_source_and_robot_share_a_clock():
    source = SimSource("rice", seed=1, speed=20)
    buffer = begun(source)
    rows_in(buffer, 100)
    robot = source.robot()
    motion = robot.move_line((1, 0, 0), 0.03, 1.0)
    rows, _ = rows_in(buffer, source.world.push.end_tick + 1)
    assert motion.finished()
    source.stop()
    assert np.allclose(np.diff(rows.time_s), 1 / RATE_HZ)
    start = int(np.searchsorted(rows.time_s, motion.start_time_s))
    push = world().plan(0.03, 1.0)
    lead = int(np.ceil(push.start_tick - push.first_tick))
    assert np.array_equal(rows.wrench[start - lead :][: len(push.wrench)], push.wrench)
    assert motion.report()["synthetic"] is True
    assert motion.report()["material"]["name"] == "rice"


def test_sim_robot_stop_takes_the_tool_out():
    source = SimSource("rice", seed=1)
    source.host_ns_at = lambda tick: 0  # a clock that stands
    robot = source.robot()
    motion = robot.move_line((0, 2, 0), 0.03, 2.9)
    source.world.advance(round((motion.start_time_s + 0.5) * RATE_HZ))
    assert source.world.advance(20)[0][:, 0].mean() > 1.0
    robot.stop()
    assert motion.finished()
    assert abs(source.world.advance(50)[0][:, 0]).max() < 1.0
