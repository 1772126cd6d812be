"""The result: every figure follows from the predictions, synthetic data are marked."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import confusion_matrix, f1_score, recall_score

from granular_id.evaluation.result import CSV_COLUMNS, EvaluationResult, SpaceSummary
from granular_id.evaluation.tables import confusion_table, headline, mistakes_table, seconds_table
from granular_id.partitions import chronological_partitions, paper_partitions
from granular_id.recording import Finding
from granular_id.synthetic import PAPER_MATERIALS

LABELS = ("oat flakes", "rice", 'süß, "fine"')


def make_result(*, protocols=("paper", "chronological"), right=(0.9, 0.5), synthetic=False, seed=0, n=12):
    rng = np.random.default_rng(seed)
    truth = np.repeat(np.arange(3), n)
    made = {
        "paper": paper_partitions(truth, n_partitions=4, train_per_class=6, test_per_class=6, seed=seed),
        "chronological": chronological_partitions(truth, np.arange(truth.size)),
    }
    predicted = {}
    for protocol, share in zip(("paper", "chronological"), right, strict=True):
        for space in ("raw+hfmh", "raw"):
            predicted[protocol, space] = tuple(
                np.where(rng.random(p.test.size) < share, truth[p.test], rng.integers(0, 3, p.test.size))
                for p in made[protocol]
            )
    seconds = {"features": 1.0, "gram": 0.5, "training": 0.25, "prediction": 0.125}
    return EvaluationResult(
        spaces=(
            SpaceSummary("raw+hfmh", 0.9705, False, 10200, seconds, {"n_bins": 100}),
            SpaceSummary("raw", None, False, 9600, seconds),
        ),
        partitions={name: tuple(made[name]) for name in protocols},
        predicted=predicted,
        labels=LABELS,
        truth=truth,
        names=tuple(f"r{row}" for row in range(truth.size)),
        sessions=("",) * truth.size,
        settings={"seed": seed},
        data={"history": []},
        versions={"numpy": np.__version__},
        report_data=None,
        notes=("a note",),
        synthetic=synthetic,
        command="granular-id evaluate X",
    )


@pytest.fixture(scope="module")
def result():
    return make_result()


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_csv_alone_recomputes_every_figure_of_the_json(result, tmp_path):
    result.to_json(tmp_path / "r.json")
    result.to_csv(tmp_path / "r.csv")
    with (tmp_path / "r.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    saved = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert tuple(rows[0]) == CSV_COLUMNS
    assert saved["labels"] == list(LABELS)
    for space in saved["spaces"]:
        for protocol, figures in space["protocols"].items():
            mine = [r for r in rows if (r["space"], r["protocol"]) == (space["name"], protocol)]
            per_partition = []
            for partition in saved["partitions"][protocol]:
                said = [r for r in mine if int(r["partition"]) == partition["index"]]
                assert [int(r["row"]) for r in said] == partition["test"]
                assert [r["recording"] for r in said] == [f"r{row}" for row in partition["test"]]
                labels = [saved["recordings"][i]["label"] for i in partition["test"]]
                assert [r["label"] for r in said] == labels
                per_partition.append(np.mean([r["label"] == r["predicted"] for r in said]))
                assert np.mean([int(r["correct"]) for r in said]) == per_partition[-1]
            truth, predicted = ([r[name] for r in mine] for name in ("label", "predicted"))
            recall = recall_score(truth, predicted, average=None, labels=LABELS)
            assert figures["accuracies"] == pytest.approx(per_partition, abs=0)
            assert figures["accuracy_mean"] == pytest.approx(np.mean(per_partition))
            assert figures["accuracy_sd"] == pytest.approx(np.std(per_partition, ddof=1))
            assert figures["confusion"] == confusion_matrix(truth, predicted, labels=LABELS).tolist()
            assert figures["recall"] == pytest.approx(recall)
            assert figures["macro_f1"] == pytest.approx(f1_score(truth, predicted, average="macro"))
        means = {name: figures["accuracy_mean"] for name, figures in space["protocols"].items()}
        assert space["gap"] == pytest.approx(means["paper"] - means["chronological"])
    assert len(rows) == 2 * (4 * 18 + 36)


def test_json_is_strict_and_marks_the_paper_and_synthetic_data(tmp_path):
    one = make_result(protocols=("paper",), synthetic=True)
    partitions = {"paper": one.partitions["paper"][:1]}
    one = replace(one, partitions=partitions, predicted={k: v[:1] for k, v in one.predicted.items()})
    one.to_json(tmp_path / "r.json")
    text = (tmp_path / "r.json").read_text(encoding="utf-8")
    assert "NaN" not in text
    saved = json.loads(text)
    assert saved["synthetic"] is True
    assert saved["spaces"][0]["accuracy_in_the_paper_on_its_own_data"] == 0.9705
    assert saved["spaces"][0]["protocols"]["paper"]["accuracy_sd"] is None
    assert saved["spaces"][0]["gap"] is None
    assert saved["command"] == "granular-id evaluate X"


def test_defaults_are_the_first_protocol_and_the_best_space(result):
    assert result.protocols == ("paper", "chronological")
    best = max(("raw+hfmh", "raw"), key=lambda name: result.accuracies(name, "paper").mean())
    assert result.best_space() == best
    np.testing.assert_array_equal(result.confusion(), result.confusion(best, "paper"))
    assert result.confusion().sum() == 72
    assert make_result(protocols=("paper",)).gap("raw") is None


def test_of_equals_the_strictest_protocol_prefers():
    equal = make_result(right=(1.0, 0.5))  # all right with random draws, the halves differ
    halves = {name: equal.mean_accuracy(name, "chronological") for name in ("raw+hfmh", "raw")}
    assert len(set(halves.values())) == 2
    assert equal.best_space("paper") == max(halves, key=halves.get)
    other = next(seed for seed in range(20) if make_result(right=(1.0, 0.5), seed=seed).best_space() == "raw")
    assert make_result(right=(1.0, 0.5), seed=other, protocols=("paper",)).best_space() == "raw+hfmh"


def test_the_paper_stands_beside_its_own_materials_only(result):
    text = result.table()
    assert str(result) == text
    first, *_ = text.splitlines()
    assert first == "Accuracy on these recordings (36 recordings, 3 classes, chance 33.3 %)"
    assert "paper*" not in text
    assert "97.05" not in text
    assert "*" not in text
    materials = tuple(sorted(material.name for material in PAPER_MATERIALS))
    assert "paper*" in replace(result, labels=materials).table()
    assert "paper*" not in replace(result, labels=(*materials, "salt")).table()


def test_table_shows_the_paper_as_the_papers_and_the_gap(result):
    result = replace(result, labels=tuple(material.name for material in PAPER_MATERIALS))
    text = result.table()
    row = next(line for line in text.splitlines() if line.startswith("raw+hfmh "))
    assert "97.05 %" in row
    mean, sd = (f("raw+hfmh", result.headline) for f in (result.mean_accuracy, result.sd_accuracy))
    assert f"{100 * mean:.2f} ± {100 * sd:.2f} %" in row
    assert row.endswith(f" {100 * result.gap('raw+hfmh'):.1f}")
    assert (
        "* the paper's accuracy on the paper's own recordings (arXiv 2403.17606); not measured here" in text
    )
    assert "a note" in text
    # raw has no value in the paper here: a dash, never a measured figure
    assert re.search(r"^raw +- +\d", text, re.M)
    widths = {len(line) for line in text.split("\n\n")[0].splitlines() if line.startswith("---")}
    assert len(widths) == 1


def test_the_headline_states_the_strictest_figure_first(result):
    best = result.best_space(result.headline)
    shares = {name: f"{100 * result.mean_accuracy(best, name):.1f} %" for name in result.protocols}
    assert headline(result) == (
        f"{best} names {shares['chronological']} of recordings rightly with halves in time order, "
        f"{shares['paper']} with random partitions"
    )
    alone = headline(make_result(protocols=("paper",)))
    assert alone.endswith("of recordings rightly with random partitions")


@pytest.mark.parametrize(("n", "equal"), [(12, True), (13, False), (14, False)])
def test_a_gap_is_given_between_equal_numbers_only(n, equal):
    """6 recordings of a class train and 6 are tested at random, beside halves of n."""
    made = make_result(n=n)
    assert (made.gap("raw") is not None) == equal
    assert ("gap" in made.table().splitlines()[2]) == equal
    assert ("with random partitions" in headline(made)) == equal


def test_numbers_that_differ_by_a_twentieth_count_as_equal():
    made = make_result(n=210, right=(0.9, 0.9))
    truth = made.truth
    for train, equal in ((105, True), (100, True), (99, False)):
        drawn = paper_partitions(truth, n_partitions=4, train_per_class=train, test_per_class=105)
        partitions = {**made.partitions, "paper": tuple(drawn)}
        predicted = {key: tuple(truth[p.test] for p in partitions[key[0]]) for key in made.predicted}
        assert (replace(made, partitions=partitions, predicted=predicted).gap("raw") is not None) == equal


FINDING = Finding("warning", "leak-clock", "the clock alone names 100 % of the labels", values={"p": 0.005})


def test_what_spoils_the_figures_stands_above_them(result):
    spoiled = replace(result, findings=(FINDING,))
    assert spoiled.spoiling == (FINDING,)
    assert spoiled.table().startswith(
        "SPOILED by leak-clock: the clock alone names 100 % of the labels\n\nAcc"
    )


def test_an_accepted_finding_is_still_told(result):
    known = replace(result, findings=(FINDING,), settings={**result.settings, "accept": ["leak-clock"]})
    assert known.spoiling == ()
    assert known.table().startswith("accepted: leak-clock: ")


def test_no_line_of_the_table_is_longer_than_120_characters(result):
    long = replace(result, notes=("warning: " + 40 * "a long note ",), findings=())
    assert max(map(len, long.table().splitlines())) <= 120
    assert long.notes[0] not in long.table()


def test_synthetic_is_in_every_title():
    made = make_result(synthetic=True)
    assert made.table().startswith("Accuracy on SYNTHETIC recordings: says nothing about real materials")
    for table in (confusion_table, mistakes_table):
        assert "SYNTHETIC" in table(made, "raw", "paper").title


def test_confusion_table_rows_sum_to_hundred_percent(result):
    table = confusion_table(result, "raw", "paper")
    assert table.header == ("true \\ named", "1", "2", "3")
    assert [row[0] for row in table.rows] == [f"{k + 1} {label}" for k, label in enumerate(LABELS)]
    for row, counts in zip(table.rows, result.confusion("raw", "paper"), strict=True):
        shares = [float(cell or 0) for cell in row[1:]]
        assert shares == pytest.approx(100 * counts / counts.sum(), abs=0.5)


def test_rare_mistakes_are_not_rounded_away_and_none_are_said(result):
    partition = result.partitions["paper"][0]
    rows = np.repeat(partition.test, 100)
    said = result.truth[rows].copy()
    said[0] = (said[0] + 1) % 3
    predicted = {("paper", name): (said,) for name in ("raw", "raw+hfmh")}
    rare = replace(result, partitions={"paper": (replace(partition, test=rows),)}, predicted=predicted)
    row = confusion_table(rare, "raw", "paper").rows[int(rare.truth[rows[0]])]
    assert {"<1", ">99"} <= set(row)
    assert "100" not in row
    (mistake,) = mistakes_table(rare, "raw", "paper").rows
    assert mistake[2] == "1 of 600"
    perfect = make_result(right=(1.0, 1.0))
    assert mistakes_table(perfect, "raw", "paper").notes == (
        "none: every tested recording was named rightly",
    )


def test_seconds_add_up(result):
    assert seconds_table(result).rows[0] == ("raw+hfmh", "1.00", "0.50", "0.25", "0.12", "1.88", "10200")


def test_unknown_names_are_listed(result):
    with pytest.raises(ValueError, match=r"space must be one of 'raw\+hfmh', 'raw', got 'dft'"):
        result.accuracies("dft")
    with pytest.raises(ValueError, match=r"one of those that ran \('paper'\), got 'session'"):
        make_result(protocols=("paper",)).confusion("raw", "session")
