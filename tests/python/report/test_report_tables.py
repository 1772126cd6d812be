"""Tables of a result under every protocol: what stands in which column, and what is said below."""

from __future__ import annotations

import pytest

from evaluation_cases import changed, make_data
from granular_id._text import percent
from granular_id.evaluation.tables import (
    accuracy_table,
    comparison_tables,
    controls_table,
    headline,
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


def test_every_protocol_has_its_columns_the_strictest_first(every):
    table = accuracy_table(every)
    assert table.header == (
        *("space", "held-out sessions (2)", "macro-F1", "random partitions (3)"),
        *("halves in time order (2)", "random folds (3)", "gap"),
    )
    assert column(table, "space") == ["raw", "hfmh"]
    assert column(table, "macro-F1") == [
        f"{every.macro_f1(space, 'session'):.3f}" for space in ("raw", "hfmh")
    ]
    for row, space in zip(table.rows, ("raw", "hfmh"), strict=True):
        mean, sd = every.mean_accuracy(space, "kfold"), every.sd_accuracy(space, "kfold")
        assert row[5] == f"{100 * mean:.2f} ± {100 * sd:.2f} %"
        gap = every.mean_accuracy(space, "paper") - every.mean_accuracy(space, "session")
        assert row[6] == f"{100 * gap:.1f}"


def test_of_several_spaces_only_the_best_is_put_into_words():
    result = small_result(spaces=("raw", "hfmh", "raw+hfmh", "raw-histogram"), controls=False)
    space = result.best_space("chronological")
    assert headline(result) == (
        f"{space} names {percent(result.mean_accuracy(space, 'chronological'))} of recordings rightly "
        f"with halves in time order, {percent(result.mean_accuracy(space, 'paper'))} with random partitions"
    )


def test_without_random_draws_there_is_no_gap_and_without_a_second_space_no_comparison():
    result = small_result(spaces=["raw"], protocol=["chronological"], controls=False)
    assert "gap" not in accuracy_table(result).header
    assert headline(result).endswith(" % of recordings rightly with halves in time order")
    assert comparison_tables(small_result(spaces=["raw"], protocol=["paper"], controls=False)) == ()


def test_controls_stand_below_the_method(every):
    table = controls_table(every, "hfmh")
    assert [row[0] for row in table.rows] == ["hfmh", *(control.name for control in every.controls)]
    assert table.rows[0][1] == f"{100 * every.mean_accuracy('hfmh', 'session'):.1f} %"
    for row, control in zip(table.rows[1:], every.controls, strict=True):
        assert row[1] == percent(control.accuracy)
    assert all(control.verdict in " ".join(table.notes) for control in every.controls)


def test_a_control_that_was_left_out_has_no_figures():
    result = small_result(changed(make_data(), start_time=lambda r: None), ["raw"], ["paper"])
    row = next(row for row in controls_table(result).rows if row[0] == "clock")
    assert row[1:] == ("-",)


def test_comparisons_are_those_of_the_strictest_and_of_random_draws(every):
    strict, random = comparison_tables(every, "hfmh")
    assert "random partitions" in random.title
    assert "held-out sessions" in strict.title
    assert [row[:2] for row in random.rows] == [("hfmh", "raw")]


def test_recall_lists_the_worst_first(every):
    recall = every.recall("raw", "session")
    table = recall_table(every, "raw")
    assert [row[0] for row in table.rows] == [every.labels[k] for k in recall.argsort(kind="stable")]
    assert table.rows[0][1] == f"{100 * recall.min():.1f} %"


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
    assert accuracy_table(result).header[1] == "held-out sessions (2)"
    assert recall_table(result, "raw").header[1] == "held-out sessions"
    result = evaluated(lambda r: f"{r.label} day")
    assert "blocks in time order (3)" in accuracy_table(result).header
    assert "with blocks in time order" in headline(result)
    assert recall_table(result, "raw").header == ("class", "blocks in time order", "random partitions")
