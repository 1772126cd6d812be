"""`benches/accuracy.py`: what it reads, how it splits, its table, a run; peers where they are installed."""

import importlib
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import granular_id as gid
from granular_id.recording import Dataset, Recording
from granular_id.statistics import corrected_resampled_t

BENCHES = Path(__file__).resolve().parents[3] / "benches"
NAMES = ("", "_data", "_methods", "_peers", "_run", "_stages", "_table")


@pytest.fixture(scope="module")
def bench():
    """The modules of the bench by name, without the prefix."""
    names = [f"accuracy{name}" for name in NAMES]
    sys.path.insert(0, str(BENCHES))
    yield {name.removeprefix("accuracy_"): importlib.import_module(name) for name in names}
    sys.path.remove(str(BENCHES))
    for name in names:
        del sys.modules[name]


def recordings(n_per_class=4, n_samples=20, sessions=0):
    """Materials that differ in level; sessions are dealt out in turn."""
    rng = np.random.default_rng(0)
    return Dataset(
        [
            Recording(
                level + rng.normal(scale=0.1, size=(n_samples, 6)),
                rate_hz=50.0,
                label=label,
                session=f"s{k % sessions}" if sessions else None,
                name=f"{label}_{k}",
            )
            for level, label in enumerate(("oat", "peas", "rice"))
            for k in range(n_per_class)
        ]
    )


def split(bench, data, how="auto", *, asks="auto", **options):
    return bench["data"].split(bench["data"].BenchSet("a", "a", data, split=asks), how, **options)


def saved(tmp_path, data):
    gid.save(data, tmp_path / "set", format="csv")
    return tmp_path / "set"


# -- partitions


def test_sessions_are_held_out_whole_where_there_are_sessions(bench):
    data = recordings(6, sessions=3)
    partitions, how = split(bench, data)
    assert how == "sessions: 3 held out whole, in 3 folds"
    for partition in partitions:
        assert not set(data.sessions[partition.train]) & set(data.sessions[partition.test])
    assert sorted(np.concatenate([p.test for p in partitions])) == list(range(len(data)))
    with pytest.raises(ValueError, match="no recording says which session it is from"):
        split(bench, recordings(), "sessions")


def test_without_sessions_there_are_halves_folds_or_random_draws_as_asked_for(bench):
    for sessions in (0, 1):
        (forward, backward), how = split(bench, recordings(4, sessions=sessions))
        assert how.startswith("halves of each class, both ways, by file order")
        assert "session protocol left out: " in how
        np.testing.assert_array_equal(forward.train, backward.test)
    data = recordings(10)
    partitions, how = split(bench, data, asks="kfold", n_folds=5, seeds=3, seed=7)
    assert how == "5 stratified folds, 3 seeds from 7"
    assert len({tuple(partition.test) for partition in partitions}) == 15
    assert len(split(bench, data, "halves", asks="kfold")[0]) == 2
    partitions, _ = split(bench, data, "random", draws=4)
    tested = [np.unique(data.y[partition.test], return_counts=True)[1].tolist() for partition in partitions]
    assert tested == [[2, 2, 2]] * 4


# -- data


def test_windows_of_a_file_share_its_session(bench):
    whole = recordings(2, n_samples=97)
    data = bench["data"].windows(whole, 0.5)
    assert len(data) == 6 * 3
    assert {r.n_samples for r in data} == {25}
    assert data[1].name == "oat_0 window 2"
    assert data[1].session == data[0].session == "oat_0"
    np.testing.assert_array_equal(data[2].wrench, whole[0].wrench[50:75])
    assert split(bench, data)[1] == "sessions: 6 held out whole, in 2 folds"
    one = Recording(np.zeros((40, 6)), rate_hz=20, label="a", session="monday", start_time=100.0, name="x")
    first, second = bench["data"].windows(Dataset([one]), 1.0)
    assert (first.session, second.session) == ("monday", "monday")
    assert (first.start_time, second.start_time) == (100.0, 101.0)


def instance(label, rows=15):
    return f"{label}\n" + "\t1 2 3 4 5 6\n" * rows


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{instance('normal')}\n{instance('collision')}\n\n\n", None),
        (instance("normal", rows=14), r"instance 1 has shape \(14, 6\), wanted \(15, 6\)"),
        (instance("normal").replace("3", "x"), "instance 1 is no table of numbers"),
        ("\n\n", "holds no instance"),
    ],
)
def test_failure_sets_are_read_or_refused(bench, tmp_path, text, message):
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "lp1.data").write_text(text)
    if message is not None:
        with pytest.raises(bench["data"].FolderError, match=message):
            bench["data"].read_folder(folder, bench["data"].Preparation())
        return
    (one,) = bench["data"].read_folder(folder, bench["data"].Preparation())
    assert (one.name, one.group, one.split) == ("robot/lp1", "robot", "kfold")
    assert one.data.X.shape == (2, 15, 6)
    assert one.data.y.tolist() == ["normal", "collision"]


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ({"time_s": np.arange(20) ** 1.2 / 50}, "--rate-hz"),
        ({"rate_hz": 80}, "differ in rate: say --rate-hz"),
    ],
)
def test_recordings_without_one_rate_are_refused_and_resampled_when_told(bench, tmp_path, time, message):
    first, *others = recordings()
    other = Recording(first.wrench, label=first.label, name=first.name, **time)
    folder = saved(tmp_path, Dataset([other, *others]))
    with pytest.raises(bench["data"].FolderError, match=message) as refused:
        bench["data"].read_folder(folder, bench["data"].Preparation())
    assert str(folder) in str(refused.value)
    (one,) = bench["data"].read_folder(folder, bench["data"].Preparation(rate_hz=25, max_gap_s=1.0))
    assert one.data.rate_hz == 25
    assert one.notes[0] == "resampled to 25 Hz"


# -- tests and table


def row(bench, method, accuracies, *, data_set="a", ours=False, **others):
    made = bench["run"].Row(data_set, "g", method, "", ours, **others)
    made.accuracies = list(accuracies)
    made.n_train, made.n_test = [80] * len(accuracies), [20] * len(accuracies)
    made.seconds = {stage: [0.001] * len(accuracies) for stage in bench["run"].STAGES}
    return made


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


def test_one_partition_has_no_spread_and_no_test_and_averages_are_of_methods_with_all_sets(bench):
    rows = [row(bench, "a", [0.5], ours=True), row(bench, "b", [0.6])]
    lines = bench["table"].table("title", rows).splitlines()
    assert lines[2].split() == ["*a", "50.0", "-", "(compared", "with)", "1.000", "1.000", "1.000"]
    assert lines[3].split() == ["b", "60.0", "-", "+10.0", "-", "-", "1.000", "1.000", "1.000"]
    assert bench["table"].as_json(bench["table"].compare(rows))[1]["p_value"] is None
    others = [row(bench, "a", [0.7], data_set="y"), row(bench, "b", [], data_set="y", status="failed")]
    (mean,) = bench["table"].averaged([*rows, *others], ["a", "y"], "g")
    assert (mean.method, mean.data_set) == ("a", "g, mean of 2 sets")
    assert mean.accuracies == pytest.approx([0.6])


# -- a run


def run(bench, method, data, how="halves"):
    partitions, _ = split(bench, data, how)
    data_set = bench["data"].BenchSet("a", "a", data)
    return bench["run"].run_method(method, data_set, partitions, 0, lambda _: None)


def method_named(bench, name):
    return next(method for method in bench["methods"].METHODS if method.name == name)


@pytest.mark.parametrize(
    "name",
    [
        "raw",
        "raw+hfmh",
        "1nn",
        "raw+svm",
        "dft+svm",
        "best",
        "multiband+whitening",
        "without-coupling",
    ],
)
def test_methods_without_further_packages_run(bench, name):
    made = run(bench, method_named(bench, name), recordings(6, n_samples=64))
    assert (made.status, made.why) == ("ok", "")
    assert made.n_train == made.n_test == [9, 9]
    assert all(len(values) == 2 and min(values) > 0 for values in made.seconds.values())
    if name in ("raw", "raw+svm", "1nn"):
        assert made.mean == 1.0


def test_what_is_missing_is_said(bench):
    methods = bench["methods"]
    short, slow = methods.Setting(50.0, 8), methods.Setting(40.0, 80)
    missing = methods.Method("x", "", lambda _: None, needs=("no_such_module",))
    for attempt, setting, message in (
        (missing.stages, short, "no_such_module not installed: see requirements-bench"),
        (
            methods.Method("x", "", lambda _: None, least=9).stages,
            short,
            "at least 9 samples, recordings have 8",
        ),
        (methods._our_space(("no such space",)), short, "has no 'no such space'"),
        (methods._our_space(("raw+hfmh",)), slow, "needs more than 46 Hz, recordings have 40"),
        (methods._our_space(("raw", "NoSuchStep")), short, r"granular_id\.spaces has no NoSuchStep"),
    ):
        with pytest.raises(methods.NotAvailableError, match=message):
            attempt(setting)


def test_a_whole_run_prints_a_table_and_writes_json(bench, tmp_path, capsys):
    folder, out = saved(tmp_path, recordings(6, sessions=2)), tmp_path / "out.json"
    assert bench["accuracy"].main([str(folder), "--only", "raw,1nn", "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert "set: 18 recordings of 20 x 6 at 50 Hz; 3 classes; sessions: 2 held out whole" in shown.out
    assert "[2/2] set, 1nn: 100.0 %" in shown.err
    written = json.loads(out.read_text())
    assert (written["finished"], written["threads"]) == (True, 1)
    assert [r["method"] for r in written["rows"]] == ["raw", "1nn"]
    assert [line["method"] for line in written["comparisons"]["set"]] == ["raw", "1nn"]


def test_a_fault_of_one_method_is_a_row_and_an_interrupt_keeps_what_is_finished(
    bench, tmp_path, capsys, monkeypatch
):
    def failing(error):
        def make(_setting):
            raise error

        return bench["methods"].Method("fails", "", make)

    made = run(bench, failing(RuntimeError("of a peer")), recordings())
    assert (made.status, made.why, made.accuracies) == ("failed", "RuntimeError: of a peer", [])
    methods = (method_named(bench, "raw"), failing(KeyboardInterrupt()))
    monkeypatch.setattr(bench["methods"], "METHODS", methods)
    folder, out = saved(tmp_path, recordings()), tmp_path / "out.json"
    assert bench["accuracy"].main([str(folder), "--out", str(out)]) == 130
    shown = capsys.readouterr()
    assert f"interrupted: 1 finished rows are printed and kept in {out}" in shown.err
    assert "*raw" in shown.out
    written = json.loads(out.read_text())
    assert (written["finished"], len(written["rows"])) == (False, 1)


def test_bad_input_is_told_before_anything_runs(bench, tmp_path, capsys):
    folder = str(saved(tmp_path, recordings()))
    for arguments, message in (
        ([f"{tmp_path}/none"], f"{tmp_path}/none: no such folder"),
        ([folder, str(tmp_path)], "accuracy.py: "),
        ([folder, folder], "a second data set called set"),
        ([folder, "--partitions", "sessions"], f"{folder}: no recording says which session"),
        ([folder, "--only", "raw,1nn", "--reference", "hydra"], "wanted a method of this run: raw, 1nn"),
        ([folder, "--only", "rocket"], "--only got 'rocket', wanted names among ours, peers, ablation, best"),
        ([folder, "--out", f"{tmp_path}/no/out.json"], "does not exist"),
        ([folder, "--window-s", "100"], "longer than every recording"),
    ):
        assert bench["accuracy"].main(arguments) == 2
        shown = capsys.readouterr()
        assert message in shown.err
        assert "[1/" not in shown.err


# -- peers


@pytest.fixture
def aeon():
    pytest.importorskip("aeon", reason="aeon is not installed: requirements-bench.txt")


@pytest.mark.usefixtures("aeon")
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "name", ["minirocket", "multirocket", "hydra", "multirocket+hydra", "quant", "catch22+rf"]
)
def test_peers_run_and_short_recordings_are_told(bench, name):
    method = method_named(bench, name)
    if "torch" in method.needs:
        pytest.importorskip("torch", reason="torch is not installed: requirements-bench.txt")
    made = run(bench, method, recordings(6))
    assert (made.status, made.why) == ("ok", "")
    assert made.mean > 0.8
    assert run(bench, method, recordings(6)).accuracies == made.accuracies
    short = run(bench, method, recordings(6, n_samples=8))
    assert short.status == ("ok" if name in ("quant", "catch22+rf") else "not available")


@pytest.mark.usefixtures("aeon")
@pytest.mark.filterwarnings("default")
def test_counts_of_hydra_are_scaled_as_aeon_does(bench):
    torch = pytest.importorskip("torch", reason="torch is not installed: requirements-bench.txt")
    hydra = importlib.import_module("aeon.classification.convolution_based._hydra")
    counts = np.random.default_rng(0).poisson(0.7, size=(30, 12)).astype(np.float32)
    wanted = hydra._SparseScaler().fit_transform(torch.from_numpy(counts)).numpy()
    scaled = bench["peers"].SparseScaler().fit_transform(counts)
    np.testing.assert_allclose(scaled, wanted, rtol=1e-4, atol=1e-5)
