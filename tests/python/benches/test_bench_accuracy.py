"""``benches/accuracy.py``: its tests, its table, a run; the peers where they are installed."""

import importlib
import json
import math

import numpy as np
import pytest

import granular_id as gid
from bench_accuracy_cases import bench, recordings, saved, split
from granular_id.spaces import FeatureSpace, RawSignal
from granular_id.spaces.best import BestClassifier
from granular_id.statistics import corrected_resampled_t

__all__ = ["bench"]


def row(bench, method, accuracies, *, data_set="a", ours=False, **others):
    made = bench["run"].Row(data_set, "g", method, "", ours, **others)
    made.accuracies = list(accuracies)
    made.n_train, made.n_test = [80] * len(accuracies), [20] * len(accuracies)
    made.seconds = {stage: [0.001] * len(accuracies) for stage in bench["run"].STAGES}
    return made


# -- tests and table


def test_the_test_is_the_corrected_one_and_holm_counts_all_methods(bench):
    ours, peer, other = [0.9, 0.8, 0.95, 0.9], [0.8, 0.75, 0.9, 0.7], [0.9, 0.7, 0.9, 0.9]
    rows = [row(bench, "best", ours, ours=True), row(bench, "peer", peer), row(bench, "other", other)]
    base, first, second = bench["table"].compare(rows)
    wanted = [corrected_resampled_t(np.subtract(a, ours), 80, 20).p_value for a in (peer, other)]
    assert math.isnan(base.p_value)
    assert base.difference == 0
    assert [first.p_value, second.p_value] == wanted
    assert first.adjusted == 2 * min(wanted)
    assert second.adjusted == max(wanted[1], first.adjusted)
    assert first.difference == pytest.approx(np.mean(peer) - np.mean(ours))


def test_another_reference_and_rows_that_did_not_run(bench):
    rows = [
        row(bench, "best", [], status="not available", why="no such space"),
        row(bench, "a", [0.5, 0.6]),
        row(bench, "b", [0.6, 0.8]),
    ]
    assert [line.method for line in bench["table"].compare(rows)] == ["a", "b"]
    a, b = bench["table"].compare(rows, reference="b")
    assert (a.difference, b.difference) == (pytest.approx(-0.15), 0)
    assert bench["table"].compare(rows[:1]) == []
    text = bench["table"].table("title", rows, "b")
    assert "not available: no such space" in text
    assert "(compared with)" in next(line for line in text.splitlines() if line.startswith(" b "))


def test_one_partition_has_no_spread_and_no_test(bench):
    rows = [row(bench, "a", [0.5], ours=True), row(bench, "b", [0.6])]
    lines = bench["table"].table("title", rows).splitlines()
    assert lines[2].split() == ["*a", "50.0", "-", "(compared", "with)", "1.000", "1.000", "1.000"]
    assert lines[3].split() == ["b", "60.0", "-", "+10.0", "-", "-", "1.000", "1.000", "1.000"]
    assert bench["table"].as_json(bench["table"].compare(rows))[1]["p_value"] is None


def test_averages_are_of_methods_with_all_sets(bench):
    rows = [
        row(bench, "a", [0.5, 0.7], data_set="x"),
        row(bench, "b", [0.5, 0.7], data_set="x"),
        row(bench, "a", [0.7, 0.8], data_set="y"),
        row(bench, "b", [], data_set="y", status="failed"),
    ]
    (mean,) = bench["table"].averaged(rows, ["x", "y"], "g")
    assert mean.method == "a"
    assert mean.data_set == "g, mean of 2 sets"
    assert mean.accuracies == pytest.approx([0.6, 0.75])


# -- a run


def run(bench, method, data, how="halves"):
    partitions, _ = split(bench, data, how)
    return bench["run"].run_method(
        method, bench["data"].BenchSet("a", "a", data), partitions, 0, lambda _: None
    )


def method_named(bench, name):
    return next(method for method in bench["methods"].METHODS if method.name == name)


@pytest.mark.parametrize("name", ["raw", "raw+hfmh", "hfmh", "1nn", "raw+svm", "dft+svm"])
def test_methods_without_further_packages_run(bench, name):
    made = run(bench, method_named(bench, name), recordings(6))
    assert (made.status, made.why) == ("ok", "")
    assert len(made.accuracies) == 2
    assert made.n_train == made.n_test == [9, 9]
    assert all(len(values) == 2 and min(values) > 0 for values in made.seconds.values())
    if name in ("raw", "raw+svm", "1nn"):
        assert made.mean == 1.0


def test_our_candidates_run_or_are_said_to_be_missing(bench):
    """Candidates may be named before the package has them."""
    for method in bench["methods"].METHODS:
        if method.ours:
            made = run(bench, method, recordings(8, n_samples=64))
            assert made.status in ("ok", "not available"), made.why


class Statistics(RawSignal):
    """A space of two blocks, with a classifier of its own."""

    @property
    def block_sizes_(self):
        n_axes = self.n_axes_in_
        return {"mean": n_axes, "spread": n_axes}

    def transform(self, X):
        return np.concatenate([np.mean(X, axis=1), np.std(X, axis=1)], axis=1)


def test_a_space_with_blocks_and_a_classifier_of_its_own(bench, monkeypatch):
    """Steps and classifier learn the blocks; the classifier learns the sessions of its training rows too."""
    told = []

    class Telling(BestClassifier):
        def fit(self, X, y, sessions=None, order=None):
            told.append((self.blocks, list(sessions), list(order)))
            return super().fit(X, y, sessions=sessions, order=order)

    space = FeatureSpace("best", Statistics(), None, classifier=Telling())
    monkeypatch.setattr(bench["methods"].spaces, "feature_spaces", lambda **_: {"best": space})
    blocks = {"mean": 6, "spread": 6}
    data = recordings(8, sessions=4)
    method = bench["methods"].Method("x", "", bench["methods"]._our_space(("best",)), ours=True)
    made = run(bench, method, data, "sessions")
    assert (made.status, made.why, made.n_features) == ("ok", "", 12)
    assert made.mean == 1.0
    assert [blocks for blocks, *_ in told] == [blocks] * 4
    assert set(told[0][1]) == {"s1", "s2", "s3"}
    assert sorted(told[0][2]) == list(range(18))
    scaled, behind = bench["methods"]._our_space(("best", "BlockScaler"))(bench["stages"].Setting(50.0, 20))
    scaled.fit(data.X, data.y)
    assert list(scaled.steps[0].block_slices_) == ["mean", "spread"]
    assert isinstance(behind, gid.ECOCClassifier)  # its own would scale once more


def test_what_is_missing_is_said(bench):
    methods = bench["methods"]
    setting = methods.Setting(50.0, 8)
    with pytest.raises(
        methods.NotAvailableError, match="no_such_module not installed: see requirements-bench"
    ):
        methods.Method("x", "", lambda _: None, needs=("no_such_module",)).stages(setting)
    with pytest.raises(methods.NotAvailableError, match="needs at least 9 samples, recordings have 8"):
        methods.Method("x", "", lambda _: None, least=9).stages(setting)
    with pytest.raises(methods.NotAvailableError, match="has no 'no such space'"):
        methods._our_space(("no such space",))(setting)
    with pytest.raises(methods.NotAvailableError, match="needs more than 46 Hz, recordings have 40"):
        methods._our_space(("raw+hfmh",))(methods.Setting(40.0, 80))
    with pytest.raises(methods.NotAvailableError, match=r"granular_id\.spaces has no NoSuchStep"):
        methods._our_space(("raw", "NoSuchStep"))(setting)


def test_a_fault_of_one_method_is_a_row_that_says_so(bench):
    def make(_setting):
        raise RuntimeError("of a peer")

    made = run(bench, bench["methods"].Method("x", "", make), recordings())
    assert (made.status, made.why) == ("failed", "RuntimeError: of a peer")
    assert made.accuracies == []


def test_names_of_methods(bench):
    chosen_methods, methods = bench["methods"].chosen_methods, bench["methods"].METHODS
    assert chosen_methods(None) == [m for m in methods if m.kind != "ablation"]
    assert [m.name for m in chosen_methods("1nn, raw")] == ["raw", "1nn"]
    assert {m.ours for m in chosen_methods("ours")} == {True}
    assert len(chosen_methods("ours,peers,ablation")) == len(methods)
    names = [m.name for m in chosen_methods("ablation")]
    assert len(names) == 10
    assert {"only-level", "without-coupling"} < set(names)
    with pytest.raises(
        ValueError, match="--only got 'rocket', wanted names among ours, peers, ablation, best"
    ):
        chosen_methods("rocket")
    with pytest.raises(ValueError, match="--reference got 'hydra', wanted a method of this run: raw, 1nn"):
        chosen_methods("raw,1nn", "hydra")


def test_a_whole_run_prints_a_table_and_writes_json(bench, tmp_path, capsys):
    folder, out = saved(tmp_path, recordings(6, sessions=2)), tmp_path / "out.json"
    assert bench["accuracy"].main([str(folder), "--only", "raw,1nn", "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert "set: 18 recordings of 20 x 6 at 50 Hz; 3 classes; sessions: 2 held out whole" in shown.out
    assert "[2/2] set, 1nn: 100.0 %" in shown.err
    written = json.loads(out.read_text())
    assert written["finished"] is True
    assert written["threads"] == 1
    assert [r["method"] for r in written["rows"]] == ["raw", "1nn"]
    assert [line["method"] for line in written["comparisons"]["set"]] == ["raw", "1nn"]


def test_an_interrupt_keeps_what_is_finished(bench, tmp_path, capsys, monkeypatch):
    def interrupted(_setting):
        raise KeyboardInterrupt

    stops = bench["methods"].Method("stops", "", interrupted)
    monkeypatch.setattr(bench["methods"], "METHODS", (method_named(bench, "raw"), stops))
    folder, out = saved(tmp_path, recordings()), tmp_path / "out.json"
    assert bench["accuracy"].main([str(folder), "--out", str(out)]) == 130
    shown = capsys.readouterr()
    assert f"interrupted: 1 finished rows are printed and kept in {out}" in shown.err
    assert "*raw" in shown.out
    written = json.loads(out.read_text())
    assert (written["finished"], len(written["rows"])) == (False, 1)


def test_bad_input_is_told_before_anything_runs(bench, tmp_path, capsys):
    main, folder = bench["accuracy"].main, saved(tmp_path, recordings())
    for arguments, message in (
        ([str(tmp_path / "none")], f"{tmp_path / 'none'}: no such folder"),
        ([str(folder), str(tmp_path)], "accuracy.py: "),
        ([str(folder), str(folder)], "a second data set called set"),
        ([str(folder), "--partitions", "sessions"], f"{folder}: no recording says which session"),
        ([str(folder), "--only", "rocket"], "--only got 'rocket'"),
        ([str(folder), "--out", str(tmp_path / "no" / "out.json")], "does not exist"),
        ([str(folder), "--window-s", "100"], "longer than every recording"),
    ):
        assert main(arguments) == 2
        shown = capsys.readouterr()
        assert message in shown.err
        assert "[1/" not in shown.err


# -- peers


@pytest.fixture
def aeon():
    pytest.importorskip("aeon", reason="aeon is not installed: requirements-bench.txt")


@pytest.mark.usefixtures("aeon")
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", ["minirocket", "multirocket", "hydra", "catch22+rf"])
def test_peers_run_and_short_recordings_are_told(bench, name):
    method = method_named(bench, name)
    if "torch" in method.needs:
        pytest.importorskip("torch", reason="torch is not installed: requirements-bench.txt")
    made = run(bench, method, recordings(6))
    assert (made.status, made.why) == ("ok", "")
    assert made.mean > 0.8
    again = run(bench, method, recordings(6))
    assert again.accuracies == made.accuracies
    short = run(bench, method, recordings(6, n_samples=8))
    assert short.status == ("ok" if name == "catch22+rf" else "not available")


@pytest.mark.usefixtures("aeon")
@pytest.mark.filterwarnings("default")
def test_counts_of_hydra_are_scaled_as_aeon_does(bench):
    torch = pytest.importorskip("torch", reason="torch is not installed: requirements-bench.txt")
    hydra = importlib.import_module("aeon.classification.convolution_based._hydra")
    counts = np.random.default_rng(0).poisson(0.7, size=(30, 12)).astype(np.float32)
    wanted = hydra._SparseScaler().fit_transform(torch.from_numpy(counts)).numpy()
    np.testing.assert_allclose(
        bench["peers"].SparseScaler().fit_transform(counts), wanted, rtol=1e-4, atol=1e-5
    )
