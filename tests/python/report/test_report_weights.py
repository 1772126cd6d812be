"""Weights of a linear model in the multi-band space: in the report data, figure and page."""

import json

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from granular_id._files import json_value
from granular_id._schema import from_json
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.report_data import ReportData, gather_report_data
from granular_id.evaluation.weights import is_traceable, weight_blocks
from granular_id.recording import Dataset, Recording
from granular_id.spaces import BlockScaler, MultiBand, RawSignal, WithinClassWhitening
from granular_id.spaces.multiband import band_columns
from multiband_cases import ALL, louder
from report_cases import small_result


@pytest.fixture(scope="module")
def data():
    X, y = louder()
    y = np.where(np.arange(len(y)) % 5 == 4, "peas", y)
    return X, y


@pytest.fixture(scope="module")
def seen(data):
    recordings = [Recording(wrench, 500.0, label=str(label)) for wrench, label in zip(*data, strict=True)]
    return gather_report_data(Dataset(recordings), {"multiband": MultiBand(blocks=ALL), "raw": RawSignal()})


@pytest.mark.parametrize("whitened", [False, True])
def test_influence_equals_that_of_the_weights_themselves(data, whitened):
    X, y = data
    space = MultiBand(blocks=ALL).fit(X)
    columns = band_columns(space)
    sizes = [columns.of(block=block).size for block in columns.blocks]
    after = [BlockScaler(sizes), *([WithinClassWhitening(0.1)] if whitened else [])]
    model = make_pipeline(*after, ECOCClassifier()).fit(space.transform(X), y)
    coef = model[-1].coef_
    for _, step in model.steps[-2::-1]:
        coef = step.transform(coef) if isinstance(step, WithinClassWhitening) else coef * step.factor_
    share = np.abs(coef) * space.transform(X).std(axis=0)
    share = (share / share.sum(axis=1, keepdims=True)).mean(axis=0)
    # Without steps behind it a multi-band space is scaled block by block.
    fitted = make_pipeline(space, *model[:-1]) if whitened else space
    blocks = weight_blocks(X, y, fitted)
    assert [(block.name, block.kind) for block in blocks] == [
        ("coupling", "band"),
        ("quantiles", "band"),
        ("envelope", "band"),
        ("spectrum", "frequency"),
        ("level", "time"),
    ]
    assert sum(block.shares.sum() for block in blocks) == pytest.approx(1.0, abs=1e-4)
    for block in blocks:
        own = columns.of(block=block.name)
        assert block.shares.sum() == pytest.approx(share[own].sum(), rel=1e-4)
        assert block.influence.sum() == pytest.approx(share[own].sum(), rel=1e-3)
    quantiles = blocks[1]
    number = next(k for k, c in enumerate(quantiles.coordinates) if 15 < c < 31)
    named = [k for k, name in enumerate(columns.names) if name.startswith("b4_") and name.endswith("_fz")]
    cell = [k for k in named if columns.columns[k].block == "quantiles"]
    assert len(cell) == 8
    assert quantiles.influence[2, number] == pytest.approx(share[cell].sum(), rel=1e-4)
    assert quantiles.weights[2, number] == pytest.approx(np.abs(coef).mean(axis=0)[cell].mean(), rel=1e-4)
    assert quantiles.coordinates[0] == 0
    assert (np.diff(quantiles.coordinates) > 0).all()


def test_scaled_columns_keep_their_place(data):
    X, y = data
    scaled = make_pipeline(RawSignal(), StandardScaler()).fit(X)
    assert is_traceable(scaled)
    (block,) = weight_blocks(X, y, scaled)
    assert (block.name, block.kind) == ("raw", "time")
    assert block.weights.sum() > 0


def test_the_portrait_holds_it_and_survives_json(seen):
    assert seen.looked_at == "multiband"
    again = from_json(ReportData, json.loads(json.dumps(json_value(seen), allow_nan=False)))
    assert json_value(again) == json_value(seen)


def test_it_is_drawn(seen, tmp_path):
    pytest.importorskip("matplotlib")
    from granular_id.plotting import plot_weights

    figure = plot_weights(seen, path=tmp_path / "weights.png")
    assert (tmp_path / "weights.png").stat().st_size > 10_000
    titles = [panel.get_title() for panel in figure.axes if panel.get_title()]
    assert titles == list(ALL)
    panels = [panel for panel in figure.axes if panel.get_xlabel()]
    assert [panel.get_xlabel() for panel in panels] == [
        *["bands, Hz"] * 3,
        "frequency, Hz",
        "time, s",
    ]
    ticks = [tick.get_text() for tick in panels[0].get_xticklabels()]
    assert ticks[0] == "all"
    assert ticks[-3:] == ["61", "122", "245"]
    coupling = seen.weights[0]
    heights = [bar.get_height() for bar in figure.axes[0].patches]
    assert heights == pytest.approx(coupling.influence[0].tolist())


def test_the_report_shows_it(data, tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    recordings = [
        Recording(wrench[:128], 500.0, label=str(label)) for wrench, label in zip(*data, strict=True)
    ]
    counts = {"n_partitions": 1, "train_per_class": 3, "test_per_class": 1}
    result = small_result(
        Dataset(recordings), {"multiband": MultiBand()}, ["paper"], controls=False, **counts
    )
    assert result.portrait.looked_at == "multiband"
    result.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Bars of bands add up all features of a band" in page
    assert "Influence in coupling by axis" in page
