"""Coverage over partitions, everything in one call, the figure, the command."""

import json
import re
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from sklearn.datasets import load_iris
from sklearn.pipeline import make_pipeline

from cli_cases import ended_well, make, refused, saved
from granular_id.confidence import ConformalRule, CoverageResult, UnknownRule, assess
from granular_id.confidence.conformal import LEVELS
from granular_id.confidence.coverage import Covered, coverage_study
from granular_id.confidence.held_out import rows_of
from granular_id.ecoc import ECOCClassifier
from granular_id.partitions import random_partition
from granular_id.plotting.confidence import plot_confidence
from granular_id.recording import Dataset
from granular_id.spaces import RawHFMH
from granular_id.synthetic import synthesize

X, Y = load_iris(return_X_y=True)


@pytest.fixture(scope="module")
def found():
    return assess(X, ECOCClassifier(), Y, n_seeds=4, in_time_order=True)


def test_coverage_over_100_random_partitions_is_within_two_points():
    """Tested 45 rows at a time: half a point of noise, and steps of 1 / 106."""
    rng = np.random.default_rng(0)
    noisy = X + rng.normal(scale=0.5, size=X.shape)
    study = coverage_study(rows_of(noisy, Y), ECOCClassifier(), LEVELS, n_seeds=100)
    for row in study.rows:
        assert row.mean == pytest.approx(row.attainable, abs=0.02)
        assert len(row.coverage) == 100
    assert [row.size for row in study.rows] == sorted(row.size for row in study.rows)


def test_levels_keep_their_digits_and_no_minus_stands_before_zero():
    row = Covered("random", True, 0.975, 0.975, (0.9749, 0.975), 1.0, 0.0)
    (cells,) = CoverageResult((row,), n_classes=3).table().rows
    assert (cells[1], cells[4]) == ("97.5 %", "+0.0")


def test_drift_shows():
    """Rows that wander in time are exchangeable at random, and not by halves."""
    rng = np.random.default_rng(0)
    y = np.tile([0, 1, 2], 60)
    wandering = 3 * np.eye(3)[y] + rng.normal(size=(180, 3)) + np.linspace(0, 5, 180)[:, None] * [1, -1, 0]
    study = coverage_study(rows_of(wandering, y, in_time_order=True), ECOCClassifier(), [0.9], n_seeds=20)
    random, halves = study.rows
    assert (random.random, halves.random) == (True, False)
    assert random.mean == pytest.approx(0.9, abs=0.04)
    assert halves.mean < random.mean - 0.1
    assert len(halves.coverage) == 2


def test_assess_in_threads_gives_the_same():
    one, two = (assess(X, ECOCClassifier(), Y, n_seeds=3, n_jobs=jobs).to_dict() for jobs in (1, 2))
    assert one == two
    assert one["coverage"]["rows"][0]["attainable"] == pytest.approx(85 / 106)  # of 105 rows


def test_random_partitions_keep_rows_of_every_class():
    codes = np.array([0] * 2 + [1] * 3 + [2] * 40)
    part = random_partition(codes, 3)
    assert np.bincount(codes[part.train]).tolist() == [1, 2, 28]
    assert np.intersect1d(part.train, part.test).size == 0


def test_everything_in_one_call(found, tmp_path):
    text = str(found)
    for part in (
        "Probabilities of 150 rows",
        "Coverage of prediction",
        "Each material left out",
    ):
        assert part in text
    found.save(tmp_path / "c.json")
    stored = json.loads((tmp_path / "c.json").read_text())
    assert ConformalRule.from_dict(stored["conformal"]) == found.conformal
    assert UnknownRule.from_dict(stored["unknown"]) == found.unknown
    for part in ("coverage", "open_set"):
        assert stored[part] == getattr(found, part).to_dict()
    assert not found.notes


def test_two_classes_only_and_synthetic_recordings_are_marked():
    pytest.importorskip("matplotlib")
    data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.3)
    seen = assess(data, make_pipeline(RawHFMH(), ECOCClassifier()), n_seeds=2)
    assert (seen.open_set, seen.to_dict()["open_set"]) == (None, None)
    assert "none can be left out" in seen.notes[-1]
    assert seen.synthetic
    assert all("SYNTHETIC" in table.title for table in seen.tables())
    figure = plot_confidence(seen)
    assert len(figure.axes) == 2
    assert figure.get_suptitle() == "RawHFMH, ECOCClassifier, SYNTHETIC recordings"


def test_figure_shows_the_figures(found, tmp_path):
    pytest.importorskip("matplotlib")
    target = tmp_path / "f.png"
    figure = plot_confidence(found, path=target)
    assert target.read_bytes().startswith(b"\x89PNG")
    reliable, coverage, unknown = figure.axes
    dots = reliable.collections[0].get_offsets()
    assert dots[:, 1].tolist() == [part.accuracy for part in found.reliability.bins]
    lines = {line.get_label(): line for line in coverage.lines}
    for name in ("random 30 %", "halves in time order"):
        own = [row.mean for row in found.coverage.rows if row.held_out == name]
        assert lines[name].get_ydata().tolist() == own
    intervals = coverage.collections[0]
    assert intervals.get_label() == "random 30 %: 95 % of partitions"
    assert "random 30 %: 95 % of partitions" in {
        text.get_text() for text in coverage.get_legend().get_texts()
    }
    assert f"AUROC {found.open_set.mean('auroc'):.3f}" in unknown.get_xlabel()


def test_no_legend_covers_what_it_explains(found):
    pytest.importorskip("matplotlib")
    bins = tuple(replace(found.reliability.bins[0], confidence=at, accuracy=1.0) for at in (0.02, 0.2, 0.42))
    seen = replace(found.reliability, bins=bins, n=bins[0].n)  # circles of the largest size
    figure = plot_confidence(replace(found, reliability=seen))
    figure.canvas.draw()
    for panel in figure.axes[:2]:
        box = panel.get_legend().get_window_extent()
        radius = 0.5 * np.sqrt(320.0) * figure.dpi / 72
        drawn = panel.collections[0].get_offsets() if panel is figure.axes[0] else panel.lines[0].get_xydata()
        points = panel.transData.transform([*drawn, (panel.get_xlim()[0], 1.0)])
        assert (points[:, 1] + (radius if panel is figure.axes[0] else 3) < box.y0).all()


def test_one_partition_is_one(found):
    pytest.importorskip("matplotlib")
    rows = tuple(replace(row, coverage=row.coverage[:1]) for row in found.coverage.rows)
    panel = plot_confidence(replace(found, coverage=replace(found.coverage, rows=rows))).axes[1]
    assert panel.get_xlabel() == "coverage asked for\n1 random partition"


def test_what_lies_beyond_the_bars_has_a_bar_that_says_so(found):
    pytest.importorskip("matplotlib")
    known, left_out = np.linspace(0.0, 0.9, 50), np.linspace(0.5, 1.5, 45)
    for more, labels, height in (([50.0], ["> 2"], 1 / 46), ([], [], 0.0)):
        strange = known, np.append(left_out, more)
        panel = plot_confidence(replace(found, open_set=replace(found.open_set, novelty=strange))).axes[2]
        named = [label.get_text() for label in panel.get_xticklabels() if ">" in label.get_text()]
        assert named == labels
        across, up = panel.patches[1].get_xy().T
        assert up[across > 2.0].max(initial=0.0) == pytest.approx(height)


def few(*counts):
    """So many rows of each of the classes a, b, ..., and their labels."""
    labels = [name for name, n in zip("abcd", counts, strict=False) for _ in range(n)]
    return np.random.default_rng(0).normal(size=(len(labels), 3)), labels


class Untrained(ECOCClassifier):
    def fit(self, X, y):
        raise AssertionError("nothing must be trained")


@pytest.mark.parametrize(
    ("counts", "known", "message"),
    [
        (
            (8, 2, 8),
            {},
            "of 'b' (2): at least 3 of each are needed, so that 2 train while others are held out",
        ),
        (
            (8, 3, 2),
            {"in_time_order": True},
            "of 'b' (3), 'c' (2): at least 4 of each are needed, so that either",
        ),
        (
            (4, 4, 3),
            {"sessions": list("xxyyxxyyxxy")},
            "of 'c' (3): at least 2 of each must train while whole",
        ),
    ],
)
def test_too_few_recordings_are_refused_before_anything_is_trained(counts, known, message):
    X, y = few(*counts)
    with pytest.raises(ValueError, match=re.escape(f"too few recordings {message}")):
        assess(X, Untrained(), y, **known)


@pytest.mark.parametrize(
    ("counts", "known"),
    [
        ((8, 3, 8), {}),
        ((8, 4, 8), {"in_time_order": True}),
        ((4, 4, 3), {"sessions": list("xxyyxxyyxyz")}),
    ],
)
def test_as_few_as_are_asked_for_do(counts, known):
    X, y = few(*counts)
    assert assess(X, ECOCClassifier(), y, n_seeds=3, levels=[0.5], **known).open_set is not None


def test_the_command_says_which_material_to_leave_out(tmp_path):
    data = Dataset([r for r in make(4) if r.name != "rice/rice_03.csv"])
    folder = saved(data, tmp_path / "set")
    assert refused("confidence", folder, "--space", "hfmh", "--quiet") == (
        "error: too few recordings of 'rice' (3): at least 4 of each are needed, so that either half in time order "
        "holds 2; leave out with --exclude rice, or record more"
    )
    ended_well("confidence", folder, "--space", "hfmh", "--quiet", "--exclude", "rice", "--seeds", "1")


class Told(ECOCClassifier):
    """Remembers what it was told about the rows it trains on."""

    seen: ClassVar[list] = []

    def fit(self, X, y, sessions=None, order=None):
        self.seen.append((X, sessions, order))
        return super().fit(X, y)


def test_a_classifier_that_asks_is_told_sessions_and_order_of_its_training_rows():
    Told.seen.clear()
    days = np.repeat(["mon", "tue", "wed"], 9)
    X, y = np.arange(27.0)[:, np.newaxis] * [1.0, -1.0], list("abc") * 9
    rows = rows_of(X, y, sessions=days, in_time_order=True)
    assess(rows, make_pipeline("passthrough", Told()), n_seeds=1)
    assert Told.seen
    for seen, sessions, order in Told.seen:
        places = seen[:, 0].astype(int)  # the features are the places in time
        assert sessions.tolist() == days[places].tolist()
        assert places[order].tolist() == sorted(places)


def test_the_command_takes_what_train_takes(tmp_path):
    folder = saved(make(4), tmp_path / "set")
    output = ended_well("confidence", folder, "--seeds", "1", "--levels", "0.5")
    assert "best: Coverage of prediction sets" in output


def test_command(tmp_path):
    pytest.importorskip("matplotlib")
    folder = saved(make(6), tmp_path / "set")
    figure, json_file = tmp_path / "f.svg", tmp_path / "c.json"
    words = ["--space", "hfmh", "--n-bins", "10", "--seeds", "2", "--levels", "0.6,0.8", "--quiet"]
    output = ended_well("confidence", folder, *words, "--figure", figure, "--json", json_file)
    assert "Coverage of prediction sets" in output
    assert "held out: " in output
    assert output.count("hfmh: ") == 3
    stored = json.loads(json_file.read_text())
    assert stored["conformal"]["levels"] == [0.6, 0.8]
    assert (stored["data"]["n_recordings"], stored["name"]) == (18, "hfmh")
    assert figure.read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--levels", "0.9,1.5"],
            "--levels must be numbers between 0 and 1, separated by commas, each once, got",
        ),
        (["--levels", "0.9,0.9"], "each once, got '0.9,0.9'"),
        (["--space", "paper"], "there is no feature space 'paper'"),
        (["--figure", "f.xyz"], "--figure must end in .png, .svg or .pdf"),
        (["--figure", "one.svg", "--json", "one.svg"], "would be written twice"),
    ],
)
def test_command_is_refused_before_anything_is_read(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused("confidence", tmp_path, *words)
    assert list(tmp_path.iterdir()) == []
