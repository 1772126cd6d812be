"""The figure of an explanation: what it shows is what the arrays hold."""

import numpy as np
import pytest
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.plotting import plot_explanation
from granular_id.spaces import DFT, HFMH, MultiBand, RangeNormalizer, RawHFMH
from multiband_cases import ALL, two_materials

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


def explained(space, data, *after, labels=None):
    X, y = data
    model = make_pipeline(space, *after, ECOCClassifier()).fit(X, y)
    return explain(model, "oat", "rice", X, y if labels is None else labels)


def shown(table):
    """Numbers of a heat map with its sums, one row of text each."""
    n = len(table.get_yticklabels())
    words = [text.get_text().replace("\N{MINUS SIGN}", "-") for text in table.texts]
    return np.array(words, dtype=float).reshape(n, -1)


def curves(panel):
    return [line for line in panel.lines if len(line.get_xdata()) > 2]


def test_tables_and_curves_hold_all_of_the_difference(data, tmp_path):
    seen = explained(RawHFMH(), data)
    figure = plot_explanation(seen, title="SYNTHETIC recordings", path=tmp_path / "why.png")
    assert (tmp_path / "why.png").read_bytes().startswith(b"\x89PNG")
    assert figure.get_suptitle().startswith("SYNTHETIC recordings\noat against rice, mean scores +")
    blocks, times, *along = figure.axes
    assert [panel.get_title() for panel in figure.axes] == ["by block", "by time", "raw", "hfmh"]
    for table in (blocks, times):
        assert table.images[0].get_array().sum() == pytest.approx(100)
        assert shown(table)[-1, -1] == 100.0
    wanted = [100 * value / seen.difference for value in seen.by_axis().values()]
    assert shown(blocks)[-1, :6] == pytest.approx(wanted, abs=0.06)
    assert [label.get_text() for label in blocks.get_yticklabels()] == ["raw", "hfmh", "sum"]
    lines = [line for panel in along for line in curves(panel)]
    assert sum(line.get_ydata().sum() for line in lines) == pytest.approx(100)
    fz = curves(along[0])[2]
    assert 0.4 <= fz.get_xdata()[np.argmax(fz.get_ydata())] <= 0.6


@pytest.mark.parametrize(
    ("space", "labels"),
    [
        (HFMH(bin_range="auto"), ["bin, share of the range of its axis"]),
        (
            FeatureUnion([("norm", RangeNormalizer(rate_hz=500)), ("dft", DFT("magnitude", rate_hz=500))]),
            ["time, s", "frequency, Hz"],
        ),
        (MultiBand(blocks=ALL), ["frequency, Hz", "time, s"]),
        (MultiBand(blocks=["coupling"]), []),
    ],
)
def test_each_block_that_is_read_along_has_a_panel(data, space, labels):
    figure = plot_explanation(explained(space, data))
    figure.draw_without_rendering()
    along = [panel for panel in figure.axes if not panel.images]
    assert [panel.get_xlabel() for panel in along] == labels
    assert all(len(curves(panel)) == 6 for panel in along)


def test_bands_have_a_table(data):
    seen = explained(MultiBand(blocks=ALL), data, StandardScaler())
    figure = plot_explanation(seen)
    tables = {panel.get_title(): panel for panel in figure.axes if panel.images}
    assert list(tables) == ["by block", "by band", "by time"]
    rows = [label.get_text() for label in tables["by band"].get_yticklabels()]
    assert rows == [*seen.by_band(), "sum"]
    for by in ("block", "band", "time"):
        assert tables[f"by {by}"].images[0].get_array().sum() == pytest.approx(100)


def test_where_the_model_fails_numbers_are_scores(data):
    seen = explained(RawHFMH(), data, labels=swapped(data[1]))
    figure = plot_explanation(seen)
    assert figure.get_suptitle().endswith("units of the score")
    assert figure.axes[0].images[0].get_array().sum() == pytest.approx(seen.difference)


@pytest.mark.parametrize("n_axes", [1, 2, 13])
def test_any_number_of_axes_is_drawn(n_axes):
    X, y, _ = two_materials(n_each=3, n_samples=64, n_axes=n_axes)
    X[y == "rice"] *= 2
    figure = plot_explanation(explained(MultiBand(blocks=ALL), (X, y), StandardScaler()))
    figure.draw_without_rendering()
    assert figure.axes[0].images[0].get_array().shape[1] == n_axes
    assert [text.get_text() for text in figure.legends[0].get_texts()][-1] == f"axis{n_axes - 1}"
