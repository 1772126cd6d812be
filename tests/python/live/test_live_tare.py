"""A model of tared recordings names tared pushes: the same bits as from recordings that were tared whole."""

from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from granular_id.live import HopIdentifier, LiveIdentifier, opened
from granular_id.live.replay import ReplaySource
from granular_id.recording import Dataset

LEAD_S, N = 0.1, 400


@pytest.fixture(scope="module")
def measured():
    """Pushes as a sensor with a zero of its own tells them."""
    data = gid.synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=1.2, seed=5)
    rng = np.random.default_rng(3)
    return Dataset([replace(one, wrench=one.wrench + rng.normal(0, 3, 6)) for one in data])


def aligned(data, lead_s=LEAD_S):
    return data.align(trigger="recorded", lead_s=lead_s, n_samples=N)


def fitted(data, space="raw+hfmh"):
    return gid.Identifier.fit(data, space, estimate=False)


def named(recordings, model):
    """Losses of each push, its recording, and what differs from the training."""
    with opened(ReplaySource(Dataset(recordings), speed=100, pause_s=0.5)) as stream:
        live = LiveIdentifier(stream, model)
        pushes = [live.push() for _ in recordings]
    losses = [[dict(push.decision.ranking)[name] for name in model.classes] for push in pushes]
    return np.array(losses), [push.recording for push in pushes], live.differences


@pytest.mark.parametrize(("space", "lead_s"), [("raw+hfmh", 0.1), ("multiband", 0.1), ("hfmh", 0.05)])
def test_pushes_are_tared_bit_for_bit_and_stored_as_measured(measured, space, lead_s):
    tared, plain = aligned(measured.tare(lead_s=lead_s)), aligned(measured)
    model, chosen = fitted(tared, space), [0, 7]
    losses, stored, differences = named([plain[k] for k in chosen], model)
    assert losses.tobytes() == model.losses(tared.X[chosen]).tobytes()
    assert [one.wrench.tobytes() for one in stored] == [plain[k].wrench.tobytes() for k in chosen]
    assert not any("tare" in one.meta for one in stored)
    assert differences == ()


@pytest.mark.parametrize("trained", ["tared", "of unknown rest", "as measured"])
def test_a_push_is_tared_as_the_training_was(measured, trained):
    tared, plain = aligned(measured.tare(lead_s=LEAD_S)), aligned(measured)
    data = {"tared": tared, "of unknown rest": Dataset(tared.recordings), "as measured": plain}[trained]
    model, pushed = fitted(data), tared if trained == "tared" else plain
    losses, _, differences = named([pushed[0]], model)
    assert losses.tobytes() == model.losses(data.X[:1]).tobytes()
    assert differences == ()


def test_another_tare_differs_unless_the_push_is_tared_here(measured):
    box = Dataset([replace(one, meta={**one.meta, "tare": "box, 9:00"}) for one in aligned(measured)])
    tared = aligned(measured.tare(lead_s=LEAD_S))
    assert named([box[0]], fitted(tared))[2] == ()
    assert named([tared[0]], fitted(box))[2] == ("tare 'rest', in training 'box, 9:00'",)


def test_answers_at_hops_have_no_rest_and_are_not_tared(measured):
    model, differences = fitted(aligned(measured.tare(lead_s=LEAD_S))), ("tare 'none', in training 'rest'",)
    with opened(ReplaySource(aligned(measured)[:1], speed=100)) as stream:
        live = HopIdentifier(stream, model, 0.2)
        assert next(live.pushes()).decision.warnings == live.differences == differences


def test_a_tare_by_more_rest_than_a_push_has_is_refused(measured):
    model = fitted(aligned(measured.tare(lead_s=LEAD_S), lead_s=0.04))
    with pytest.raises(ValueError, match=r"tared by 0\.1 s of rest, and a push begins 0\.04 s before"):
        named([aligned(measured)[0]], model)
