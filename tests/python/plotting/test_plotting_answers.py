"""The figure of answers over a recording: a row a material, the signal by unit, and its marks."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id.identifier import Timeline
from granular_id.plotting import plot_answers
from granular_id.recording import Recording

IMU = ("wx", "wy", "wz", "ax", "ay", "az")
UNITS = dict(zip(IMU, ["rad/s"] * 3 + ["m/s2"] * 3, strict=True))


def timeline(classes=("asphalt", "grass", "gravel"), n=40, **fields):
    rng = np.random.default_rng(0)
    usual = {
        "name": "drive",
        "classes": tuple(classes),
        "times_s": 2.0 + 0.5 * np.arange(n),
        "losses": rng.uniform(0, 1, (n, len(classes))),
        "probabilities": None,
        "candidates": ((),) * n,
        "unknown": None,
        "flagged": np.zeros(n, bool),
        "trained_on": None,
        "window_s": 2.0,
        "hop_s": 0.5,
        "duration_s": 22.0,
    }
    return Timeline(**{**usual, **fields})


def recording(axes=IMU, n=2200, units=UNITS):
    wrench = np.random.default_rng(1).normal(size=(n, len(axes)))
    return Recording(wrench, rate_hz=100.0, axes=axes, meta={"units": dict(units)})


def rows(panel):
    return [label.get_text() for label in panel.get_yticklabels()]


def words(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_each_material_has_a_row_and_each_unit_a_panel():
    figure = plot_answers(timeline(), recording())
    *signals, answers = figure.axes
    assert rows(answers) == ["asphalt", "grass", "gravel"]
    assert [panel.get_ylabel() for panel in signals] == ["rad/s\nless median", "m/s2\nless median"]
    assert [[line.get_label() for line in panel.lines[:3]] for panel in signals] == [
        list(IMU[:3]),
        list(IMU[3:]),
    ]
    assert words(figure) == ["answer"]


def test_axes_without_a_unit_are_grouped_by_their_names():
    *signals, _ = plot_answers(timeline(), recording(units={})).axes
    assert [panel.get_ylabel() for panel in signals] == ["less median"] * 2
    *signals, _ = plot_answers(timeline(units=("g",) * 6), recording(units={})).axes
    assert [panel.get_ylabel() for panel in signals] == ["g\nless median"]


def test_the_bars_of_a_row_are_its_answers():
    losses = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    fields = {"times_s": np.array([2.0, 2.5, 3.0]), "losses": losses, "candidates": ((),) * 3}
    figure = plot_answers(timeline(("grass", "gravel"), 3, **fields), recording())
    spans = [
        path.get_extents().intervalx.tolist()
        for bars in figure.axes[-1].collections
        for path in bars.get_paths()
    ]
    assert spans == [[0.0, 2.5], [2.5, 3.0]]


def test_unknown_label_and_candidates_are_marked(tmp_path):
    unknown = np.zeros(40, bool)
    unknown[5:9] = True
    candidates = (("grass", "gravel"),) * 40
    marked = timeline(unknown=unknown, candidates=candidates, truth="grass", synthetic="SYNTHETIC recordings")
    figure = plot_answers(marked, recording(), tmp_path / "answers.png")
    assert (tmp_path / "answers.png").read_bytes().startswith(b"\x89PNG")
    assert figure.get_suptitle() == "Answers over drive, SYNTHETIC recordings"
    assert rows(figure.axes[-1])[-1] == "like none of them"
    assert words(figure) == [
        "answer",
        "may be, or nearest",
        "like no known material",
        "label of the recording",
    ]


@pytest.mark.parametrize(("n", "shown"), [(11, 11), (30, 15)])
def test_of_many_materials_the_most_named_are_shown(n, shown):
    classes = tuple(f"material {i:02d}" for i in range(n))
    figure = plot_answers(timeline(classes), recording())
    assert len(rows(figure.axes[-1])) == shown
    assert ("15 materials that are named least" in figure.axes[-1].get_xlabel()) == (n > shown)


def test_a_long_signal_keeps_its_extremes():
    one = recording(n=90_000)
    figure = plot_answers(timeline(duration_s=900.0), one)
    line = figure.axes[0].lines[0]
    assert len(line.get_xdata()) < 4000
    signal = one.wrench[:, 0] - np.median(one.wrench[:, 0])
    assert (line.get_ydata().min(), line.get_ydata().max()) == (signal.min(), signal.max())


def test_another_recording_is_refused():
    with pytest.raises(ValueError, match="lasts 10 s, the answers are about one of 22 s"):
        plot_answers(timeline(), recording(n=1000))
