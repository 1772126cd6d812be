"""A model of tared recordings names tared pushes: the same bits as from recordings that were tared whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import granular_id as gid
from granular_id.live import LiveIdentifier, opened
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


def fitted(data, space="hfmh"):
    return gid.Identifier.fit(data, space, estimate=False)


def named(recordings, model, **options):
    """Losses of each push, its recording, and what the session warns of."""
    with opened(ReplaySource(Dataset(recordings), speed=10, pause_s=0.5)) as stream:
        live = LiveIdentifier(stream, model, **options)
        pushes = [live.push() for _ in recordings]
    losses = [dict(push.decision.ranking) for push in pushes]
    rows = np.array([[one[name] for name in model.classes] for one in losses])
    return rows, [push.recording for push in pushes], live.differences


@pytest.mark.parametrize(("space", "lead_s"), [("raw+hfmh", 0.1), ("multiband", 0.1), ("hfmh", 0.05)])
def test_pushes_are_tared_as_recordings_are_bit_for_bit_and_kept_as_measured(measured, space, lead_s):
    tared, plain = aligned(measured.tare(lead_s=lead_s)), aligned(measured)
    model, chosen = fitted(tared, space), [0, 7]
    losses, kept, differences = named([plain[k] for k in chosen], model)
    assert losses.tobytes() == model.losses(tared.X[chosen]).tobytes()
    assert [one.wrench.tobytes() for one in kept] == [plain[k].wrench.tobytes() for k in chosen]
    assert not any("tare" in one.meta for one in kept)
    assert differences == ()


def test_what_is_tared_already_is_not_tared_again(measured):
    tared = aligned(measured.tare(lead_s=LEAD_S))
    model = fitted(tared, "raw+hfmh")
    losses, _, differences = named([tared[0]], model)
    assert losses.tobytes() == model.losses(tared.X[:1]).tobytes()
    assert differences == ()


def test_where_nobody_knows_by_how_much_rest_recordings_were_tared_all_of_it_is_taken(measured):
    tared = aligned(measured.tare(lead_s=LEAD_S))
    model = fitted(Dataset(tared.recordings))
    assert model.trained["history"] == []
    losses, _, _ = named([aligned(measured)[0]], model)
    assert losses.tobytes() == model.losses(tared.X[:1]).tobytes()


def test_a_model_of_recordings_as_measured_takes_pushes_as_measured(measured):
    plain = aligned(measured)
    model = fitted(plain, "raw+hfmh")
    losses, _, _ = named([plain[0]], model)
    assert losses.tobytes() == model.losses(plain.X[:1]).tobytes()


def test_a_stream_with_another_tare_is_another_set_up_unless_it_is_tared_here(measured):
    plain = aligned(measured)
    box = Dataset([replace(one, meta={**one.meta, "tare": "box, 9:00"}) for one in plain])
    tared = aligned(measured.tare(lead_s=LEAD_S))
    assert named([box[0]], fitted(tared))[2] == ()
    assert named([tared[0]], fitted(box))[2] == ("tare 'rest', in training 'box, 9:00'",)


def test_answers_at_hops_have_no_rest_and_say_that_they_are_not_tared(measured):
    tared = aligned(measured.tare(lead_s=LEAD_S))
    model = fitted(tared)
    for recordings, differences in ((aligned(measured), ("tare 'none', in training 'rest'",)), (tared, ())):
        with opened(ReplaySource(Dataset(recordings[:1]), speed=20)) as stream:
            live = LiveIdentifier(stream, model, hop_s=0.2)
            warned = next(live.pushes()).decision.warnings
        assert live.differences == warned == differences


def test_a_model_that_was_tared_by_more_rest_than_a_push_begins_with_is_refused(measured):
    model = fitted(aligned(measured.tare(lead_s=LEAD_S), lead_s=0.04))
    with (
        opened(ReplaySource(aligned(measured), speed=20)) as stream,
        pytest.raises(
            ValueError, match=r"tared by 0\.1 s of rest, and a push begins 0\.04 s before its motion"
        ),
    ):
        LiveIdentifier(stream, model)
