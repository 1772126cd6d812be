"""The figure of an explanation in the multi-band space: what it shows is what the arrays hold."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.plotting import plot_explanation
from granular_id.spaces import MultiBand
from multiband_cases import ALL, louder, two_materials

pytest.importorskip("matplotlib")


def explained(blocks=ALL, data=None, labels=None):
    X, y = louder() if data is None else data
    model = make_pipeline(MultiBand(blocks=blocks), StandardScaler(), ECOCClassifier()).fit(X, y)
    return explain(model, "rice", "oat", X, y if labels is None else labels)


@pytest.fixture(scope="module")
def seen():
    return explained()


def number(text):
    return float(text.get_text().replace("\N{MINUS SIGN}", "-"))


def titles(figure):
    return [panel.get_title() for panel in figure.axes]


def test_the_table_and_the_bars_hold_all_of_the_difference(seen):
    figure = plot_explanation(seen, title="SYNTHETIC recordings")
    assert figure.get_suptitle().startswith("SYNTHETIC recordings\nWhat tells rice from oat: mean scores +")
    table, bars = figure.axes[:2]
    cells = table.images[0].get_array()
    assert cells.sum() == pytest.approx(100)
    assert [text.get_text() for text in table.texts][-1] == "100.0"
    rows = [label.get_text() for label in table.get_yticklabels()]
    assert rows == ["whole signal", *list(seen.by_band())[1:], "sum"]
    below = [number(text) for text in table.texts if text.get_position()[1] == len(rows) - 1]
    assert below[:6] == pytest.approx([100 * v / seen.difference for v in seen.by_axis().values()], abs=0.06)
    assert sum(bar.get_width() for bar in bars.patches) == pytest.approx(100)
    assert [label.get_text() for label in bars.get_yticklabels()] == list(ALL)


def test_matrices_are_those_of_the_bands_with_the_strongest_couplings(seen):
    figure = plot_explanation(seen)
    panels = figure.axes[2:8]
    totals = {str(band): sum(seen.by_pair(number).values()) for number, band in enumerate(seen.columns.bands)}
    named = {str(one.band) for one in seen.strongest_couplings()}
    others = sorted(totals.keys() - named, key=totals.get, reverse=True)
    strongest = {*named, *others[: 3 - len(named)]}
    assert strongest != set(sorted(totals, key=totals.get)[-3:])  # totals alone would leave one out
    assert all(f"in {name}, " in str(seen) for name in named)
    assert {panel.get_title() for panel in panels[:3]} == {name.removeprefix("the ") for name in strongest}
    drawn = sum(np.nansum(panel.images[0].get_array().filled(np.nan)) for panel in panels)
    assert drawn == pytest.approx(100 * sum(totals[name] for name in strongest) / seen.difference)
    assert panels[3].get_xlabel().startswith("columns ")


def test_strips_of_spectrum_and_level(seen):
    figure = plot_explanation(seen)
    wanted = 100 * np.array([seen.by_block()["spectrum"], seen.by_block()["level"]]) / seen.difference
    strips = figure.axes[9:]
    assert len(strips) == 12
    sums = [
        sum(patch.get_data().values.sum() for panel in strips[start::2] for patch in panel.patches)
        for start in (0, 1)
    ]
    assert sums == pytest.approx(wanted.tolist())
    assert strips[0].get_title().startswith("Spectrum: tallest ")
    assert strips[1].get_title().startswith("Level: tallest ")


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
def test_some_blocks_only(blocks, tmp_path):
    figure = plot_explanation(explained(blocks), path=tmp_path / "part.svg")
    assert (tmp_path / "part.svg").stat().st_size > 1000
    assert any("Bands and axes" in title for title in titles(figure))
    assert ("whole signal" in titles(figure)) <= ("coupling" in blocks)


@pytest.mark.parametrize("n_axes", [1, 2, 13])
def test_other_numbers_of_axes(n_axes, tmp_path):
    X, y, _ = two_materials(n_each=3, n_samples=64, n_axes=n_axes)
    X[y == "rice"] *= 2
    figure = plot_explanation(explained(ALL, (X, y)), path=tmp_path / "axes.png")
    assert figure.axes[0].images[0].get_array().shape[1] == n_axes


def test_where_the_model_fails_numbers_are_scores():
    _, y = louder()
    seen = explained(labels=np.where(y == "oat", "rice", "oat"))
    figure = plot_explanation(seen)
    assert "units of the score" in figure.axes[0].get_title()
    assert figure.axes[0].images[0].get_array().sum() == pytest.approx(seen.difference)


def test_a_coupling_that_speaks_against_is_marked_without_colour(seen):
    figure = plot_explanation(seen)
    for panel in figure.axes[2:8]:
        values = panel.images[0].get_array().filled(0.0)
        limit = panel.images[0].norm.vmax
        assert len(panel.texts) == np.sum(values < -0.1 * limit)
