"""The figure of an explanation: what it shows is what the arrays hold."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.plotting import plot_explanation
from granular_id.spaces import DFT, HFMH, BlockUnion, RangeNormalizer, RawHFMH

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def data():
    random = np.random.default_rng(0)
    y = np.repeat(["oat", "rice"], 8)
    X = random.normal(scale=0.1, size=(16, 400, 6))
    X[y == "oat", 200:300, 2] += 0.5
    return X, y


def explained(space, data, first="oat", second="rice", labels=None):
    X, y = data
    model = make_pipeline(space, ECOCClassifier()).fit(X, y)
    return explain(model, first, second, X, y if labels is None else labels)


def bars(panel):
    return [bar.get_width() for bar in panel.patches]


def test_curves_and_bars_hold_all_of_the_difference(data):
    seen = explained(RawHFMH(), data)
    figure = plot_explanation(seen, title="SYNTHETIC recordings")
    assert figure.get_suptitle().startswith("SYNTHETIC recordings\nWhat tells oat from rice: mean scores +")
    curves, shares = figure.axes[::2], figure.axes[1::2]
    assert [panel.get_title() for panel in curves] == ["raw", "hfmh"]
    drawn = sum(
        line.get_ydata().sum() for panel in curves for line in panel.lines if len(line.get_xdata()) > 2
    )
    assert drawn == pytest.approx(seen.difference)
    assert sum(sum(bars(panel)) for panel in shares) == pytest.approx(100)
    fz = curves[0].lines[2]
    peak = fz.get_xdata()[np.argmax(fz.get_ydata())]
    assert 0.4 <= peak <= 0.6
    assert shares[0].get_xlim() == shares[1].get_xlim()


def test_a_range_for_each_axis_is_one_row(data):
    figure = plot_explanation(explained(HFMH(bin_range="auto"), data))
    assert len(figure.axes) == 2
    assert len(figure.axes[1].patches) == 6
    assert "range of its axis" in figure.axes[0].get_xlabel()


def test_spectra_and_normalised_signals(data):
    union = BlockUnion([("norm", RangeNormalizer(rate_hz=500)), ("dft", DFT("magnitude", rate_hz=500))])
    figure = plot_explanation(explained(union, data))
    assert [panel.get_xlabel() for panel in figure.axes[::2]] == ["time, s", "frequency, Hz"]


def test_where_the_model_fails_bars_are_scores(data):
    swapped = np.where(data[1] == "oat", "rice", "oat")
    seen = explained(RawHFMH(), data, labels=swapped)
    figure = plot_explanation(seen)
    assert figure.axes[1].get_xlabel() == "units of the score"
    assert sum(sum(bars(panel)) for panel in figure.axes[1::2]) == pytest.approx(seen.difference)


def test_other_than_six_axes(data):
    figure = plot_explanation(explained(RawHFMH(), (data[0][:, :, 1:3], data[1])))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["axis0", "axis1"]


def test_saved(data, tmp_path):
    target = tmp_path / "why.png"
    plot_explanation(explained(RawHFMH(), data), path=target)
    assert target.read_bytes().startswith(b"\x89PNG")
