"""The figure of an explanation: what it shows is what the arrays hold."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.plotting import plot_explanation
from granular_id.spaces import DFT, HFMH, BlockUnion, MultiBand, RangeNormalizer, RawHFMH
from multiband_cases import ALL, louder, two_materials

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def data():
    """Oat differs from rice by half a newton in fz, from 0.4 s to 0.6 s."""
    random = np.random.default_rng(0)
    y = np.repeat(["oat", "rice"], 8)
    X = random.normal(scale=0.1, size=(16, 400, 6))
    X[y == "oat", 200:300, 2] += 0.5
    return X, y


def swapped(y):
    return np.where(y == "oat", "rice", "oat")


def explained(space, data, labels=None):
    X, y = data
    model = make_pipeline(space, ECOCClassifier()).fit(X, y)
    return explain(model, "oat", "rice", X, y if labels is None else labels)


def explained_bands(blocks=ALL, data=None, labels=None):
    X, y = louder() if data is None else data
    model = make_pipeline(MultiBand(blocks=blocks), StandardScaler(), ECOCClassifier()).fit(X, y)
    return explain(model, "rice", "oat", X, y if labels is None else labels)


@pytest.fixture(scope="module")
def bands():
    return explained_bands()


@pytest.fixture(scope="module")
def drawn(bands):
    return plot_explanation(bands, title="SYNTHETIC recordings")


def widths(panel):
    return [bar.get_width() for bar in panel.patches]


def titles(figure):
    return [panel.get_title() for panel in figure.axes]


# -- blocks of one coordinate


def test_curves_and_bars_hold_all_of_the_difference(data, tmp_path):
    seen = explained(RawHFMH(), data)
    figure = plot_explanation(seen, title="SYNTHETIC recordings", path=tmp_path / "why.png")
    assert (tmp_path / "why.png").read_bytes().startswith(b"\x89PNG")
    assert figure.get_suptitle().startswith("SYNTHETIC recordings\nWhat tells oat from rice: mean scores +")
    curves, shares = figure.axes[::2], figure.axes[1::2]
    assert [panel.get_title() for panel in curves] == ["raw", "hfmh"]
    lines = [line for panel in curves for line in panel.lines if len(line.get_xdata()) > 2]
    assert sum(line.get_ydata().sum() for line in lines) == pytest.approx(seen.difference)
    assert sum(sum(widths(panel)) for panel in shares) == pytest.approx(100)
    fz = curves[0].lines[2]
    assert 0.4 <= fz.get_xdata()[np.argmax(fz.get_ydata())] <= 0.6
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


def test_where_the_model_fails_bars_and_cells_are_scores(data):
    seen = explained(RawHFMH(), data, labels=swapped(data[1]))
    figure = plot_explanation(seen)
    assert figure.axes[1].get_xlabel() == "units of the score"
    assert sum(sum(widths(panel)) for panel in figure.axes[1::2]) == pytest.approx(seen.difference)
    seen = explained_bands(labels=swapped(louder()[1]))
    table = plot_explanation(seen).axes[0]
    assert "units of the score" in table.get_title()
    assert table.images[0].get_array().sum() == pytest.approx(seen.difference)


def test_other_than_six_axes(data):
    figure = plot_explanation(explained(RawHFMH(), (data[0][:, :, 1:3], data[1])))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["axis0", "axis1"]


# -- bands


def test_the_table_and_the_bars_hold_all_of_the_difference(bands, drawn):
    assert drawn.get_suptitle().startswith("SYNTHETIC recordings\nWhat tells rice from oat: mean scores +")
    table, bars = drawn.axes[:2]
    assert table.images[0].get_array().sum() == pytest.approx(100)
    assert [text.get_text() for text in table.texts][-1] == "100.0"
    rows = [label.get_text() for label in table.get_yticklabels()]
    assert rows == ["whole signal", *list(bands.by_band())[1:], "sum"]
    last = [text.get_text() for text in table.texts if text.get_position()[1] == len(rows) - 1]
    below = [float(text.replace("\N{MINUS SIGN}", "-")) for text in last]
    shares = [100 * value / bands.difference for value in bands.by_axis().values()]
    assert below[:6] == pytest.approx(shares, abs=0.06)
    assert sum(widths(bars)) == pytest.approx(100)
    assert [label.get_text() for label in bars.get_yticklabels()] == list(ALL)


def test_matrices_are_those_of_the_bands_with_the_strongest_couplings(bands, drawn):
    panels = drawn.axes[2:8]
    totals = {
        str(band): sum(bands.by_pair(number).values()) for number, band in enumerate(bands.columns.bands)
    }
    named = {str(one.band) for one in bands.strongest_couplings()}
    others = sorted(totals.keys() - named, key=totals.get, reverse=True)
    strongest = {*named, *others[: 3 - len(named)]}
    assert strongest != set(sorted(totals, key=totals.get)[-3:])  # totals alone would leave one out
    assert all(f"in {name}, " in str(bands) for name in named)
    assert {panel.get_title() for panel in panels[:3]} == {name.removeprefix("the ") for name in strongest}
    values = [panel.images[0].get_array().filled(0.0) for panel in panels]
    shares = 100 * sum(totals[name] for name in strongest) / bands.difference
    assert sum(one.sum() for one in values) == pytest.approx(shares)
    assert panels[3].get_xlabel().startswith("columns ")
    for panel, one in zip(panels, values, strict=True):  # what speaks against is marked without colour
        assert len(panel.texts) == np.sum(one < -0.1 * panel.images[0].norm.vmax)


def test_strips_of_spectrum_and_level(bands, drawn):
    strips = drawn.axes[9:]
    assert len(strips) == 12
    for start, block in enumerate(("spectrum", "level")):
        steps = [patch.get_data().values.sum() for panel in strips[start::2] for patch in panel.patches]
        assert sum(steps) == pytest.approx(100 * bands.by_block()[block] / bands.difference)
        assert strips[start].get_title().startswith(f"{block.capitalize()}: tallest ")


def test_a_block_that_the_model_does_not_use_has_no_strip():
    X, y = louder()
    model = make_pipeline(MultiBand(blocks=ALL), StandardScaler(), ECOCClassifier()).fit(X, y)
    model[-1].coef_[:, -model[0].block_sizes_["level"] :] = 0.0
    seen = explain(model, "rice", "oat", X, y)
    assert "  nothing from the level of the signal (level)" in str(seen).splitlines()
    figure = plot_explanation(seen)
    assert any(title.startswith("Spectrum: ") for title in titles(figure))
    assert not any(title.startswith("Level: ") for title in titles(figure))
    assert figure.axes[1].get_yticklabels()[-1].get_text() == "level"  # nothing of the difference, it says


@pytest.mark.parametrize("blocks", [("coupling",), ("quantiles",), ("level",), ("envelope", "spectrum")])
def test_some_blocks_only(blocks):
    X, y = louder()
    figure = plot_explanation(explained_bands(blocks, (X[:8], y[:8])))
    figure.draw_without_rendering()
    assert any("Bands and axes" in title for title in titles(figure))
    assert ("whole signal" in titles(figure)) <= ("coupling" in blocks)


@pytest.mark.parametrize("n_axes", [1, 2, 13])
def test_other_numbers_of_axes(n_axes):
    X, y, _ = two_materials(n_each=3, n_samples=64, n_axes=n_axes)
    X[y == "rice"] *= 2
    figure = plot_explanation(explained_bands(ALL, (X, y)))
    figure.draw_without_rendering()
    assert figure.axes[0].images[0].get_array().shape[1] == n_axes
