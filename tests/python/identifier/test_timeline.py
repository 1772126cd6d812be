"""Answers about recordings and over long ones: those of each window alone, in stretches, as tables and files."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from granular_id.identifier import identify_all
from granular_id.recording import Recording
from timeline_cases import timeline

N = 80
RATE = 500.0


def long(data, *places, **fields):
    """Some recordings, one after another, as one."""
    return Recording(np.concatenate([data.X[i] for i in places]), rate_hz=RATE, name="drive", **fields)


@pytest.fixture(scope="module")
def drive(new):
    return long(new, 0, 0, 11, 11, 3)


@pytest.mark.parametrize("kind", ["raw+hfmh", "best"])
@pytest.mark.parametrize("hop_s", [0.03, 0.16, 0.21])
def test_each_answer_is_that_about_its_window_alone(models, drive, kind, hop_s, monkeypatch):
    model = models[kind]
    monkeypatch.setattr("granular_id.identifier.answers._BLOCK", 3 * N * 6)  # three windows at a time
    answers = model.predict_over(drive, hop_s)
    n_hop = round(hop_s * RATE)
    starts = range(0, drive.n_samples - N + 1, n_hop)
    assert answers.times_s.tolist() == [(start + N) / RATE for start in starts]
    for i, start in enumerate(starts):
        alone = model.identify(drive.wrench[start : start + N])
        assert (answers.labels[i], answers.margins[i]) == (alone.label, alone.margin)
        assert dict(zip(answers.classes, answers.losses[i], strict=True)) == dict(alone.ranking)
        assert (answers.candidates[i], answers.unknown[i]) == (alone.candidates, alone.unknown)


def test_windows_share_nothing_by_default(plain, drive):
    answers = plain.predict_over(drive)
    assert (answers.hop_s, answers.window_s, len(answers)) == (0.16, 0.16, 5)
    assert answers.labels.tolist() == plain.predict(drive.wrench.reshape(5, N, 6)).tolist()
    assert plain.predict_over(drive.wrench).labels.tolist() == answers.labels.tolist()


def made(labels, unknown=None, **fields):
    """A timeline of these labels."""
    classes = ("oat", "rice", "salt")
    losses = [[0.1 + 0.3 * (name != label) for name in classes] for label in labels]
    unknown = None if unknown is None else np.array(unknown, dtype=bool)
    return timeline(losses, classes, unknown=unknown, **fields)


SENTENCES = [
    (["rice"], None, "0.0 to 2.0 s rice"),
    (["rice", "rice", "oat"], None, "0.0 to 3.0 s rice, then 3.0 to 4.0 s oat"),
    # those like nothing known are one stretch, whatever each is nearest to
    (["rice", "oat", "salt"], [0, 1, 1], "0.0 to 2.0 s rice, then 2.0 to 4.0 s unknown, nearest oat"),
    (["oat", "oat"], [True, False], "0.0 to 2.0 s unknown, nearest oat, then 2.0 to 3.0 s oat"),
]


@pytest.mark.parametrize(("labels", "unknown", "sentence"), SENTENCES)
def test_stretches_are_answers_in_a_row_that_say_the_same(labels, unknown, sentence):
    answers = made(labels, unknown)
    assert answers.sentence() == sentence
    assert sum(one.n_answers for one in answers.stretches) == len(answers)
    assert str(answers) == f"drive: {sentence}"


def test_the_table_says_what_the_answers_are_worth():
    answers = made(
        ["rice", "rice", "oat"],
        truth="rice",
        synthetic="SYNTHETIC recordings",
        flagged=np.array([True, False, False]),
        trained_on=np.array([True, True, False]),
        duration_s=4.5,
        differences=("speed",),
    )
    table = answers.table()
    assert table.title == "Answers over drive, SYNTHETIC recordings"
    assert table.rows[0] == ("0.00 to 3.00", "rice", "2", "0.300")
    notes = "\n".join(table.notes)
    words = (
        "rice 67 %, oat 33 %",
        "2 of 3 name it",
        "last 0.50 s",
        "a flag",
        "2 of these 3 windows",
        "speed",
    )
    assert [word for word in words if word not in notes] == []
    every = replace(answers, trained_on=np.array([True] * 3)).table().notes
    assert any("trained on 3 of these 3 windows: answers" in note for note in every)
    foam = made(["oat"], truth="foam").table().notes
    assert any("foam, which the model does not know" in note for note in foam)
    assert any(note.endswith("unknown 100 %") for note in made(["oat"], [True]).table().notes)


def test_windows_of_the_training_are_known_again(plain, data):
    answers = plain.predict_over(long(data, 0, 1, 2), 0.08)
    assert answers.trained_on.tolist() == [True, False, True, False, True]


def test_flags_are_those_of_the_window(plain, new):
    flags = np.zeros(3 * N, np.uint8)
    flags[N] = 1
    answers = plain.predict_over(long(new, 0, 1, 2, flags=flags), 0.08)
    assert answers.flagged.tolist() == [False, True, True, False, False]


def test_files_hold_every_answer(models, drive, tmp_path):
    answers = models["best"].predict_over(drive, 0.08)
    answers.to_csv(tmp_path / "answers.csv")
    with (tmp_path / "answers.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["label"] for row in rows] == answers.labels.tolist()
    assert [float(row["to_s"]) for row in rows] == pytest.approx(answers.times_s)
    assert {row["unknown"] for row in rows} <= {"true", "false"}
    ends = np.cumsum([one.n_answers for one in answers.stretches])[:-1]
    means = [part.mean() for part in np.split(answers.margins, ends)]
    assert [one.margin for one in answers.stretches] == pytest.approx(means)
    stored = json.loads(json.dumps(answers.to_dict()))
    assert [row["losses"] for row in stored["answers"]] == answers.losses.tolist()
    assert stored["stretches"][0]["from_s"] == 0.0


REFUSED = {
    "too short": (lambda new: Recording(new.X[0][:70], rate_hz=RATE), None, "record for longer"),
    "no hop": (lambda new: long(new, 0), 0.0005, "hop_s=0.0005 is less than a sample: at 500 Hz"),
    "a hop of nothing": (lambda new: long(new, 0), 0.0, "hop_s must be positive"),
    "a data set": (lambda new: new, None, "one by one"),
}


@pytest.mark.parametrize(("make", "hop_s", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_with_the_way_out(plain, new, make, hop_s, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        plain.predict_over(make(new), hop_s)


def test_refused_recording_of_another_material_is_no_mistake(plain, new):
    batch = identify_all(plain, new[:4])
    unknown, truth = np.array([False, True, True, False]), ("oat", "rice", "foam", "foam")
    seen = replace(batch, losses=np.eye(4)[[1] * 4], unknown=unknown, truth=truth)
    assert [row[-1] for row in seen.table().rows] == ["oat", "rice (!)", "foam", "foam (!)"]
