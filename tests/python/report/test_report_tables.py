"""Tables of a result under every protocol: what stands in which column, and what is said below."""

from __future__ import annotations

import pytest

from evaluation_cases import changed, make_data
from granular_id._text import percent
from granular_id.evaluation.gap import gap_lines
from granular_id.evaluation.tables import (
    accuracy_table,
    comparison_tables,
    controls_table,
    plain_text,
    recall_table,
)
from report_cases import small_result


@pytest.fixture(scope="module")
def every():
    """All protocols on recordings with two sessions of each class."""
    return small_result(protocol=("paper", "session", "chronological", "kfold"), n_folds=3)


def column(table, name):
    at = table.header.index(name)
    return [row[at] for row in table.rows]


def test_every_protocol_has_its_columns(every):
    table = accuracy_table(every)
    header = "space, 3 random, macro-F1, 2 session folds, 1st->2nd half, 2nd->1st half, 3 folds, gap"
    assert ", ".join(table.header) == header
    assert column(table, "space") == ["raw", "hfmh"]
    assert column(table, "macro-F1") == [f"{every.macro_f1(space, 'paper'):.3f}" for space in ("raw", "hfmh")]
    for row, space in zip(table.rows, ("raw", "hfmh"), strict=True):
        mean, sd = every.mean_accuracy(space, "kfold"), every.sd_accuracy(space, "kfold")
        assert row[6] == f"{100 * mean:.2f} ± {100 * sd:.2f} %"
        gap = every.mean_accuracy(space, "paper") - every.mean_accuracy(space, "session")
        assert row[7] == f"{100 * gap:.1f}"


def test_gaps_are_held_against_the_strictest(every):
    lines = gap_lines(every)
    for space in ("raw", "hfmh"):
        line = next(line for line in lines if line.startswith(f"{space} names"))
        assert (
            f"{100 * every.mean_accuracy(space, 'session'):.1f} % when they come from different sessions"
            in line
        )


def test_of_many_spaces_only_the_best_are_put_into_words():
    result = small_result(spaces=("raw", "hfmh", "raw+hfmh", "raw-histogram"), controls=False)
    said = {line.split(" names")[0] for line in gap_lines(result) if not line.startswith("(")}
    assert said == {result.best_space("paper"), result.best_space("chronological")}


def test_without_random_draws_there_is_no_gap_and_without_a_second_space_no_comparison():
    result = small_result(spaces=["raw"], protocol=["chronological"], controls=False)
    assert "gap" not in accuracy_table(result).header
    assert gap_lines(result) == ()
    assert comparison_tables(small_result(spaces=["raw"], protocol=["paper"], controls=False)) == ()


def test_controls_stand_below_the_method(every):
    table = controls_table(every, "hfmh")
    assert [row[0] for row in table.rows] == ["hfmh", *(control.name for control in every.controls)]
    assert table.rows[0][1] == f"{100 * every.mean_accuracy('hfmh', 'paper'):.1f} %"
    for row, control in zip(table.rows[1:], every.controls, strict=True):
        assert row[2] == percent(control.accuracies.get("session"))
    assert all(control.verdict in " ".join(table.notes) for control in every.controls)


def test_a_control_that_was_left_out_has_no_figures():
    result = small_result(changed(make_data(), start_time=lambda r: None), ["raw"], ["paper"])
    row = next(row for row in controls_table(result).rows if row[0] == "clock")
    assert row[1:] == ("-",)


def test_comparisons_are_those_of_random_draws_and_of_the_strictest(every):
    random, strict = comparison_tables(every, "hfmh")
    assert "random partitions" in random.title
    assert "held-out sessions" in strict.title
    assert [row[:2] for row in random.rows] == [("hfmh", "raw")]


def test_recall_lists_the_worst_first(every):
    recall = every.recall("raw", "session")
    table = recall_table(every, "raw")
    assert [row[0] for row in table.rows] == [every.labels[k] for k in recall.argsort(kind="stable")]
    assert table.rows[0][2] == f"{100 * recall.min():.1f} %"


def test_plain_text_holds_them_all(every):
    text = plain_text(every)
    titles = (
        "Accuracy on these",
        "Controls beside the method",
        "Differences in accuracy",
        "Seconds, added up",
    )
    places = [text.index(title) for title in titles]
    assert places == sorted(places)


def test_sessions_that_are_called_blocks_are_sessions_and_blocks_in_time_are_not():
    def evaluated(session):
        data = changed(make_data(), session=session)
        return small_result(data, ["raw"], ["paper", "session"], n_folds=3, controls=False)

    result = evaluated(lambda r: r.session.replace(f"{r.label} day", "block"))
    assert result.strictest == "session"
    assert accuracy_table(result).header[3] == "2 session folds"
    assert recall_table(result, "raw").header[2] == "held-out sessions"
    result = evaluated(lambda r: f"{r.label} day")
    assert "3 blocks" in accuracy_table(result).header
    assert "different stretches of time" in gap_lines(result)[0]
    assert recall_table(result, "raw").header == ("class", "random partitions", "blocks in time order")
