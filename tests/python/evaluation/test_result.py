"""The result: every figure follows from the predictions, and one screen shows those that count."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import balanced_accuracy_score, confusion_matrix, recall_score

from evaluation_cases import LABELS, QUIET
from granular_id.evaluation import accuracy_table, confusion_table, evaluate, mistakes_table, recall_table
from granular_id.evaluation.result import CSV_COLUMNS, comparison_tables, fold_table, seconds_table
from granular_id.synthetic import PAPER_MATERIALS


@pytest.fixture(scope="module")
def paper(data):
    return evaluate(data, ["raw+hfmh", "raw"], paper=(4, 6, 3), **QUIET)


def test_csv_alone_recomputes_every_figure_of_the_json(evaluated, tmp_path):
    evaluated.to_json(tmp_path / "r.json")
    evaluated.to_csv(tmp_path / "r.csv")
    with (tmp_path / "r.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    saved = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert tuple(rows[0]) == CSV_COLUMNS
    assert saved["labels"] == list(LABELS)
    assert saved["headline"]["accuracy"] == saved["spaces"]["raw+hfmh"]["accuracy"]
    for name, figures in saved["spaces"].items():
        own = [row for row in rows if row["space"] == name]
        truth, predicted = ([row[column] for row in own] for column in ("label", "predicted"))
        assert [int(row["row"]) for row in own] == [row for fold in saved["folds"] for row in fold["test"]]
        assert [row["recording"] for row in own] == [saved["recordings"][int(row["row"])] for row in own]
        assert figures["accuracy"] == pytest.approx(balanced_accuracy_score(truth, predicted))
        assert figures["plain_accuracy"] == np.mean([int(row["correct"]) for row in own])
        assert figures["recall"] == pytest.approx(recall_score(truth, predicted, average=None, labels=LABELS))
        assert figures["confusion"] == confusion_matrix(truth, predicted, labels=LABELS).tolist()
    assert len(rows) == 3 * 40


def test_json_is_strict_and_marks_the_paper(evaluated, paper):
    saved = json.loads(json.dumps(evaluated.to_dict(), allow_nan=False))
    assert saved["spaces"]["raw"]["accuracy_in_the_paper_on_its_own_data"] == 0.7614
    assert (saved["gap"]["p"], paper.to_dict()["gap"]) == (evaluated.gap.p, None)
    assert [one["name"] for one in saved["baselines"]] == ["rest", "clock"]


def test_unknown_spaces_are_refused(evaluated):
    with pytest.raises(ValueError, match=r"space must be one of 'raw\+hfmh', 'hfmh', 'raw', got 'dft'"):
        evaluated.accuracy("dft")


def test_table_shows_strict_and_random_accuracies_and_the_gap(evaluated):
    table = accuracy_table(evaluated)
    assert table.header == ("space", "held-out sessions", "at random", "gap")
    for row, (name, held) in zip(table.rows, evaluated.held.items(), strict=False):
        drawn = np.mean(evaluated.at_random[name])
        shares = f"{100 * held.accuracy:.1f} %", f"{100 * drawn:.1f} %"
        assert row == (name, *shares, f"{100 * (drawn - held.accuracy):.1f}")
    drawn = np.mean(evaluated.at_random["raw+hfmh"])
    assert evaluated.gap.points == pytest.approx(drawn - evaluated.accuracy())
    assert table.rows[3][0] == "(clock)"
    assert table.notes[0].startswith("(rest) left out: ")


def test_paper_table_has_mean_sd_and_its_test(paper):
    table = accuracy_table(paper)
    shares = paper.held["raw+hfmh"].fold_accuracies()
    assert table.title == "4 random partitions, 6 recordings of each class train, 3 are tested, seed 0"
    assert table.rows[0][2] == f"{100 * shares.mean():.2f} ± {100 * shares.std(ddof=1):.2f} %"
    assert table.rows[0][1] == "-"  # other materials than the paper's
    assert table.rows[1][3] == f"{paper.comparison()[0].mann_whitney_p:.3f}"
    assert "far too small, as partitions share recordings" in table.notes[1]


def test_the_paper_stands_beside_its_own_materials_only(paper):
    classes = tuple(sorted(material.name for material in PAPER_MATERIALS))
    named = {name: replace(held, classes=classes) for name, held in paper.held.items()}
    assert accuracy_table(replace(paper, held=named)).rows[0][1] == "97.05 %"


def test_details_hold_folds_mistakes_comparisons_and_seconds(evaluated, paper):
    text = evaluated.details()
    for table in (fold_table(evaluated), mistakes_table(evaluated), seconds_table(evaluated)):
        assert str(table) in text
    (comparison,) = comparison_tables(evaluated)
    assert comparison.notes == ("2 folds: too few for p-values",)
    (comparison,) = comparison_tables(paper)
    assert comparison.header == ("first", "second", "points", "p", "Holm")
    assert comparison_tables(replace(paper, held={"raw": paper.held["raw"]})) == ()


def test_confusion_rows_sum_to_hundred_percent(evaluated):
    table = confusion_table(evaluated, "raw")
    assert table.header == ("true \\ named", "1", "2", "3", "4")
    assert [row[0] for row in table.rows] == [f"{k + 1} {label}" for k, label in enumerate(LABELS)]
    for row, counts in zip(table.rows, evaluated.confusion("raw"), strict=True):
        assert [float(cell or 0) for cell in row[1:]] == pytest.approx(100 * counts / counts.sum(), abs=0.5)


def test_rare_mistakes_are_not_rounded_away(evaluated):
    held = evaluated.headline
    often = held.take(np.repeat(np.arange(40), 300))
    predicted = often.truth.copy()
    predicted[0] = (predicted[0] + 1) % 4
    rare = replace(evaluated, held={"raw": replace(often, predicted=predicted)})
    assert {"<1", ">99"} <= set(confusion_table(rare).rows[int(often.truth[0])])
    (mistake,) = mistakes_table(rare).rows
    assert mistake[2] == "1 of 3000"
    first = next(line for line in str(rare).splitlines() if line.startswith("worst: "))
    assert re.fullmatch(r"worst: \w+ >99 %, taken for \w+ <1 %", first)
    perfect = replace(evaluated, held={"raw": replace(often, predicted=often.truth)})
    assert mistakes_table(perfect).notes == ("none: every tested recording was named right",)


def test_recall_lists_the_worst_first_and_who_is_not_tested(evaluated):
    folds = replace(evaluated.folds, untested={"peas": "one session"})
    table = recall_table(replace(evaluated, folds=folds))
    recall = evaluated.recall()
    assert [row[0] for row in table.rows] == [LABELS[k] for k in recall.argsort(kind="stable")]
    assert table.notes == ("peas: one session; it trains and is not tested",)
