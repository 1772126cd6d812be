"""Set-ups: what a model was trained with, and what follows where recordings or a sensor have another one."""

import re
from dataclasses import fields, replace
from unittest.mock import Mock

import numpy as np
import pytest

import granular_id as gid
from granular_id.identifier import describe_model, describe_performance
from granular_id.live import ForceTrigger, LiveIdentifier, SimSource, opened, setup_of
from granular_id.live.replay import ReplaySource
from granular_id.live.robot import Robot
from granular_id.recording import (
    Dataset,
    Setup,
    data_warnings,
    mixed_setup_warnings,
    setups_in,
    unit_differences,
    values_in,
)
from granular_id.recording.setup import ACCEPTABLE

FLANGE = {field.name: f"the {field.name}" for field in fields(Setup)} | {"compensated": False}


def with_meta(data, **meta):
    return Dataset([replace(recording, meta=meta) for recording in data])


@pytest.fixture(scope="module")
def data():
    """Half a second each, the motion after 0.1 s."""
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.6, seed=5)
    return with_meta(data.align(trigger="recorded", lead_s=0.1, n_samples=200), **FLANGE)


@pytest.fixture(scope="module")
def model(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("setup") / "m.safetensors"
    gid.Identifier.fit(data, "hfmh", estimate=False).save(path)
    return gid.Identifier.load(path)


def replayed(data, model, **keywords):
    with opened(ReplaySource(data, speed=50)) as stream:
        live = LiveIdentifier(stream, model, **keywords)
        return live.differences, live.push().decision


def of_two(data, name, values):
    """Recordings with one value of a thing, then with the other."""
    metas = [{**FLANGE, name: value} for value in values]
    return Dataset([replace(one, meta=metas[k % 2]) for k, one in enumerate(data)], data.history)


@pytest.mark.parametrize("name", ["frame", "motion"])  # refused, and warned of
def test_a_replay_of_several_set_ups_is_compared_one_by_one(data, name):
    both = of_two(data, name, ("one", "other"))
    model = gid.Identifier.fit(both, "hfmh", estimate=False)
    assert replayed(both, model)[0] == ()
    changed = of_two(data, name, ("one", "third"))
    expected = f"{name} 'third', in training 'one' or 'other'"
    assert replayed(changed, model, accept=name if name in ACCEPTABLE else ())[0] == (expected,)
    if name in ACCEPTABLE:
        with pytest.raises(ValueError, match=re.escape(expected)):
            replayed(changed, model)


@pytest.mark.parametrize("name", [field.name for field in fields(Setup)])
def test_setup_each_difference_has_its_consequence(name):
    trained = Setup.of(FLANGE)
    (found,) = trained.differences(replace(trained, **{"serial": None, name: "another"}))
    wanted = "refuse" if name in ACCEPTABLE else "warn"
    assert (found.name, found.now, found.consequence) == (name, "another", wanted)


@pytest.mark.parametrize("name", ["units", "frame", "sensor", "read_as"])
def test_setup_mismatch_is_refused_or_warned_of(data, model, name):
    other = {"units": {"fx": "mN"}} if name == "units" else {name: "another"}
    meta = {**FLANGE, **other}
    if name == "sensor":
        del meta["serial"]
    changed = with_meta(data, **meta)
    refused = name in ACCEPTABLE
    accept = (name,) if refused else ()
    if refused:
        for refuses in (lambda: model.identify(changed[0]), lambda: model.requirements.check(changed)):
            with pytest.raises(ValueError, match=rf"{data[0].name}.*{name}"):
                refuses()
    (expected,) = model.requirements.check(changed, accept)
    assert expected.startswith(name)
    with pytest.raises(ValueError, match="accept must be of frame"):
        model.identify(changed[0], accept=(*accept, "sensor"))
    decision = model.identify(changed[0], accept=accept)
    assert decision.warnings == (expected,)
    assert decision.ranking == model.identify(data[0]).ranking
    if name == "units":  # live they are N and N m
        return
    differences, decision = replayed(changed, model, accept=accept)
    assert differences == decision.warnings == (expected,)
    if refused:
        with pytest.raises(ValueError, match=f"replay of .* {name} 'another', in training '{FLANGE[name]}'"):
            replayed(changed, model)


def test_the_same_set_up_an_unknown_one_and_an_array_say_nothing(data, model):
    for same in (data, with_meta(data), with_meta(data, frame=None, tool="")):
        assert model.requirements.check(same) == model.identify(same[0]).warnings == ()
        assert replayed(same, model)[0] == ()
    assert model.identify(np.asarray(data[0].wrench)).warnings == ()
    known_by_its_number = replace(data[0], meta={**FLANGE, "sensor": "Mini45 at the gantry"})
    assert model.identify(known_by_its_number).warnings == ()


def test_a_turned_sensor_is_refused_before_anything_moves(data):
    """The case that went unnoticed: forces and torques turned by 90 degrees about z, the frame another one."""
    trained = gid.Identifier.fit(with_meta(data, frame="sensor"), "hfmh", estimate=False)

    class Turned(SimSource):
        @property
        def info(self):
            return replace(super().info, frame="sensor, turned by 90 degrees about z")

    robot = Mock(spec=Robot)
    with pytest.raises(ValueError, match="frame 'sensor, turned"):
        next(gid.identify(Turned("rice", seed=1, speed=20), trained, robot=robot))
    robot.move_line.assert_not_called()


def test_a_live_trigger_and_speed_are_compared(data):
    source = SimSource("rice", seed=1, speed=20)
    pushed = with_meta(data, trigger="motion", robot={"speed_m_s": 0.03})
    trained = gid.Identifier.fit(pushed, "hfmh", estimate=False)
    with opened(source) as stream:
        assert LiveIdentifier(stream, trained).differences == ()
        other = LiveIdentifier(stream, trained, setup_of(source, trigger=ForceTrigger), speed_m_s=0.02)
        by_force = "trigger 'force', in training 'motion'"
        assert other.differences == (by_force, "motion '0.02 m/s', in training '0.03 m/s'")


def test_a_training_on_several_set_ups_knows_each(data):
    several = [{"tool": "spoon", "frame": "flange"}, {"tool": "fork", "frame": "sensor"}]
    mixed = Dataset([replace(recording, meta=several[k % 2]) for k, recording in enumerate(data)])
    model = gid.Identifier.fit(mixed, "hfmh", estimate=False)
    assert model.trained["setup"] == {"frame": ["flange", "sensor"], "tool": ["fork", "spoon"]}
    assert model.requirements.check(mixed) == ()
    expected = ("tool 'knife', in training 'fork' or 'spoon'",)
    assert model.requirements.check(with_meta(data, tool="knife")) == expected
    with pytest.raises(ValueError, match="flange"):
        model.requirements.check(with_meta(data, frame="table"))
    note = "recordings differ in their frame: 'flange', 'sensor'"
    assert note in "\n".join(describe_performance(model))
    assert note in "\n".join(data_warnings(mixed))
    varied = Dataset([replace(r, meta={"tool": f"spoon {k}"}) for k, r in enumerate(data)])
    assert gid.Identifier.fit(varied, "hfmh", estimate=False).trained["setup"] == {}


@pytest.mark.parametrize(("axis", "trained", "now"), [("fx", "N", "mN"), ("wx", "rad/s", "deg/s")])
def test_units_differ_where_both_are_known(axis, trained, now):
    assert unit_differences({axis: trained}, {"units": {axis: now}})
    assert not unit_differences({axis: trained}, {})
    assert not unit_differences({"wx": ""}, {"units": {"wx": now}})


def test_recordings_of_other_units_train_nothing(data):
    with pytest.raises(ValueError, match=r"tz: N m.*tz: N mm"):
        gid.Identifier.fit(Dataset([*data[:6], *with_meta(data[6:], units={"tz": "N mm"})]), "hfmh")


TARED, COMPENSATED = {"tare": "rest"}, {"compensated": True, "payload": "0.306 kg"}
BY_DRIVER, BY_NONE = {"compensated": "yes"}, {"compensated": "no"}


@pytest.mark.parametrize(
    ("trained", "now", "differences"),
    [
        ({}, TARED, ["tare 'rest', in training not stated"]),
        (TARED, {}, ["tare not stated, in training 'rest'"]),
        ({}, COMPENSATED, ["payload '0.306 kg', in training not stated"]),
        (COMPENSATED, {}, ["payload not stated, in training '0.306 kg'"]),
        # what the tare took off is not missed, nor what the driver did
        (TARED, TARED | COMPENSATED, []),
        (TARED | COMPENSATED, TARED, []),
        (COMPENSATED, BY_DRIVER, []),
        (BY_DRIVER, COMPENSATED, []),
        (
            COMPENSATED,
            BY_NONE,
            ["compensated 'no', in training 'yes'", "payload not stated, in training '0.306 kg'"],
        ),
        # a payload that is identified twice is one
        (COMPENSATED, COMPENSATED | {"payload": "0.31 kg"}, []),
        *(
            (COMPENSATED, COMPENSATED | {"payload": other}, [f"payload '{other}', in training '0.306 kg'"])
            for other in ("0.33 kg", "1.5e+03 kg", "1.2.3 kg")
        ),
    ],
)
def test_setup_what_was_taken_off_is_missed_once(trained, now, differences):
    assert [str(found) for found in Setup.of(trained).differences(Setup.of(now))] == differences


def test_what_a_step_took_off_is_missed_by_a_model(data):
    model = gid.Identifier.fit(with_meta(data), "hfmh", estimate=False)
    wanted = ("payload '0.306 kg', in training not stated",)
    assert model.requirements.check(with_meta(data, **COMPENSATED)) == wanted
    assert replayed(with_meta(data, **COMPENSATED), model)[0] == wanted


def test_what_some_recordings_of_a_training_lack_is_none(data):
    half = Dataset([*with_meta(data[:6]), *with_meta(data[6:], **TARED)])
    assert values_in(setups_in(half)) == {"tare": ["rest", "not stated"]}
    model = gid.Identifier.fit(half, "hfmh", estimate=False)
    assert model.requirements.check(half) == ()
    expected = ("tare 'by hand', in training 'rest' or not stated",)
    assert model.requirements.check(with_meta(data, tare="by hand")) == expected
    (warned,) = mixed_setup_warnings(half)
    assert warned.startswith("warning: recordings differ in their tare: 'rest', not stated")


def test_recordings_of_other_topics_or_arrays_are_warned_of(data):
    for first, other in [
        [{"topic": topic} for topic in ("/raw", "/comp")],
        [{"read_as": x} for x in ("a", "b")],
    ]:
        mixed = Dataset([*with_meta(data[:6], **first), *with_meta(data[6:], **other)])
        (warned,) = mixed_setup_warnings(mixed)
        assert warned.startswith("warning: recordings differ in their read_as: '")
        assert mixed_setup_warnings(Dataset(with_meta(data, **first))) == []


def test_recordings_in_other_units_are_warned_of(data):
    axes = ("wx", "wy", "wz", "ax", "ay", "az")
    units = [{"units": dict.fromkeys(axes, unit)} for unit in ("m/s2", "g")]
    mixed = Dataset([gid.Recording(data[0].wrench, rate_hz=500, axes=axes, meta=one) for one in units])
    (warned,) = mixed_setup_warnings(mixed)
    assert "recordings differ in the units of their axes" in warned


def test_model_without_set_up_says_nothing_false(data):
    bare = gid.Identifier.fit(with_meta(data), "hfmh", estimate=False)
    turned = with_meta(data, frame="another", tool="spoon")
    assert bare.identify(turned[0]).warnings == replayed(turned, bare)[0] == ()
    assert any("set-up: not stated" in line for line in describe_model(bare))


NETFT = {"name": "Net F/T 10.0.0.1", "serial": "FT1", "compensated": False}
TURNED_PAGE = {"page": {"cfgtfx": "0;0;0;0;0;90", "setuserfilter": "0"}}
REPLAY = {"name": "replay", "meta": {"sensor": None, "trigger": "force"}}


def filtered(number):
    return {"source": {"meta": {"page": {"setuserfilter": number}}}}


@pytest.mark.parametrize(
    ("meta", "known"),
    [
        ({}, {}),
        ({"frame": "flange", "filter_hz": 73}, {"frame": "flange", "filter": "73 Hz"}),
        (
            {"source": {**NETFT, "meta": TURNED_PAGE}, "trigger": "force"},
            {"sensor": NETFT["name"], "serial": "FT1", "compensated": "no", "trigger": "force"}
            | {"transform": "0;0;0;0;0;90"},
        ),
        ({"source": {"name": "simulated rice", "synthetic": True}}, {}),
        ({"source": REPLAY, "trigger": "time"}, {"trigger": "force"}),
        ({"source": "bench", "robot": 3, "tool": {"width_mm": 17}}, {"tool": '{"width_mm": 17}'}),
        ({"frame": "x" * 300, "tare": [0, 1]}, {"frame": "x" * 200, "tare": "[0, 1]"}),
        (filtered("0"), {}),
        (filtered(3), {"filter": "setuserfilter 3"}),
        ({"serial": 12345678.0, "speed_m_s": 0.03}, {"serial": "12345678", "motion": "0.03 m/s"}),
    ],
)
def test_metadata_are_read_where_recorders_and_people_put_them(data, meta, known):
    assert Setup.of(replace(data[0], meta=meta).meta) == Setup(**known)


def test_onsets_that_were_found_are_the_trigger(data):
    found = data.find_onsets(replace=True, rest_s=0.1)
    assert {setup.trigger for setup in setups_in(found)} == {"onset"}
    assert "trigger" not in values_in(setups_in(data.find_onsets(rest_s=0.1)))
