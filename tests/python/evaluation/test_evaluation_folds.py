"""Partitions and folds: disjoint, stratified, seeded, whole sessions held out whatever the data; and clear errors."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from evaluation_cases import LABELS, SMALL, changed, make_data
from granular_id.evaluation import evaluate, recall_table
from granular_id.partitions import (
    block_partitions,
    chronological_partitions,
    kfold_partitions,
    matched_partitions,
    paper_partitions,
    protocol_name,
    session_partitions,
)
from granular_id.recording import Dataset, Recording
from granular_id.splits import (
    checked_groups,
    describe_order,
    groups_of,
    plan_partitions,
    plan_protocols,
    sessions_where_possible,
    strict_partitions,
    strictest,
)


@st.composite
def unbalanced(draw):
    counts = draw(st.lists(st.integers(2, 12), min_size=2, max_size=5))
    y = np.repeat([f"m{k}" for k in range(len(counts))], counts)
    return np.random.default_rng(draw(st.integers(0, 99))).permutation(y)


@st.composite
def with_sessions(draw):
    """Sessions nested in classes, crossing all of them, or drawn at random; two at least of each class."""
    y = draw(unbalanced())
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    n_sessions = draw(st.integers(2, 15))
    kind = draw(st.sampled_from(["nested", "crossed", "any"]))
    sessions = np.empty(y.size, dtype=object)
    for k, label in enumerate(np.unique(y)):
        rows = rng.permutation(np.flatnonzero(y == label))
        drawn = np.arange(rows.size) if kind == "crossed" else rng.integers(0, n_sessions, rows.size)
        drawn[:2] = (0, 1)
        prefix = f"{label} " if kind == "nested" else ""
        sessions[rows] = [f"{prefix}s{s % n_sessions}" for s in drawn]
        if kind == "any" and k == 0:
            sessions[rows] = [f"own {s % 2}" for s in range(rows.size)]
    return y, sessions


def check_folds(folds, y, protocol):
    assert [fold.index for fold in folds] == list(range(len(folds)))
    assert len(folds) >= 2
    for fold in folds:
        assert fold.protocol == protocol
        assert fold.test.size > 0
        assert sorted([*fold.train, *fold.test]) == list(range(y.size))
        assert (np.diff(fold.train) > 0).all()
        assert (np.diff(fold.test) > 0).all()
        assert set(y[fold.train]) == set(y), "a class without training rows"
    np.testing.assert_array_equal(np.sort(np.concatenate([f.test for f in folds])), np.arange(y.size))


@given(with_sessions(), st.integers(2, 12))
def test_whole_sessions_are_held_out_and_every_class_keeps_training_rows(case, max_folds):
    y, sessions = case
    folds = session_partitions(y, sessions, max_folds=max_folds)
    check_folds(folds, y, "session")
    for fold in folds:
        assert not set(sessions[fold.train]) & set(sessions[fold.test])
    again = session_partitions(y, sessions, max_folds=max_folds)
    assert [f.test.tolist() for f in again] == [f.test.tolist() for f in folds]


@given(unbalanced(), st.data())
def test_paper_partitions_are_disjoint_stratified_and_exact(y, data):
    fewest = int(np.unique(y, return_counts=True)[1].min())
    train = data.draw(st.integers(1, fewest - 1))
    test = data.draw(st.integers(1, fewest - train))
    partitions = paper_partitions(y, n_partitions=3, train_per_class=train, test_per_class=test, seed=7)
    assert [p.index for p in partitions] == [0, 1, 2]
    for partition in partitions:
        assert not set(partition.train) & set(partition.test)
        assert (np.diff(partition.train) > 0).all()
        assert (np.diff(partition.test) > 0).all()
        for label in np.unique(y):
            assert (y[partition.train] == label).sum() == train
            assert (y[partition.test] == label).sum() == test


def test_seeds_of_random_draws():
    y = np.repeat(["a", "b", "c"], 20)
    few, many, other = (
        paper_partitions(y, n_partitions=n, train_per_class=10, test_per_class=5, seed=seed)
        for n, seed in ((3, 4), (6, 4), (3, 5))
    )
    for one, same, another in zip(few, many, other, strict=False):  # more partitions keep the earlier ones
        np.testing.assert_array_equal(one.train, same.train)
        np.testing.assert_array_equal(one.test, same.test)
        assert (one.train != another.train).any()
    assert len({tuple(p.train) for p in many}) == 6
    folds, others = (kfold_partitions(y, seed=seed)[0].test.tolist() for seed in (0, 1))
    assert folds != others
    assert folds[-1] - folds[0] > len(folds)  # rows of a class are mixed


def test_every_recording_is_drawn_equally_often():
    y = np.repeat(["a", "b"], 10)
    partitions = paper_partitions(y, n_partitions=2000, train_per_class=5, test_per_class=2, seed=0)
    tested = np.bincount(np.concatenate([p.test for p in partitions]), minlength=20)
    # 2000 draws of 2 in 10: mean 400, SD 17.9; five SD either way
    assert (abs(tested - 400) < 90).all()


@given(unbalanced(), st.integers(0, 99))
def test_chronological_halves_each_class_in_order(y, seed):
    order = np.random.default_rng(seed).permutation(y.size)
    when = np.argsort(order)
    forward, backward = chronological_partitions(y, order)
    assert sorted([*forward.train, *forward.test]) == list(range(y.size))
    np.testing.assert_array_equal(forward.train, backward.test)
    np.testing.assert_array_equal(forward.test, backward.train)
    for label in np.unique(y):
        early = when[forward.train[y[forward.train] == label]]
        late = when[forward.test[y[forward.test] == label]]
        assert early.max() < late.min()
        assert late.size - early.size in (0, 1)


@pytest.mark.parametrize(
    ("times", "note"),
    [
        ([3.0, 1.0, 2.0], "by start time"),
        ([5.0, 1.0, 1.0], "by start time"),  # the equal times are in different classes
        ([np.nan] * 3, "by file order: the recordings carry no start time"),
        ([0.0] * 3, "by file order: all recordings start at the same time, so their clocks say nothing"),
    ],
)
def test_where_the_order_comes_from(times, note):
    assert describe_order(times, ["a", "a", "b"], ["x", "y", "z"]) == note


def test_sessions_that_span_all_classes_are_left_out_one_at_a_time_and_nested_ones_together():
    days = np.repeat(["mon", "tue", "wed", "thu"], 4)
    spanning = session_partitions(np.tile(["oat", "rice"], 8), days)
    assert [fold.description for fold in spanning] == ["mon", "tue", "wed", "thu"]
    assert [set(days[fold.test]) for fold in spanning] == [{"mon"}, {"tue"}, {"wed"}, {"thu"}]
    y = np.repeat(["oat", "rice", "peas"], 6)
    nested = np.array([f"{label} day {k % 3}" for k, label in enumerate(y)])
    folds = session_partitions(y, nested)
    assert len(folds) == 3
    for fold in folds:
        held = sorted(set(nested[fold.test]))
        assert [name.split()[0] for name in held] == ["oat", "peas", "rice"]
        assert fold.description == f"3 sessions: {held[0]}, ..."


def test_many_sessions_are_grouped_into_ten_folds_of_like_size():
    y, sessions = np.tile(["oat", "rice"], 50), np.repeat([f"s{k}" for k in range(25)], 4)
    folds = session_partitions(y, sessions)
    assert len(folds) == 10
    assert {fold.test.size for fold in folds} == {8, 12}
    assert len(session_partitions(y, sessions, max_folds=25)) == 25


@given(unbalanced(), st.data())
def test_blocks_are_contiguous_in_time_and_even(y, data):
    order = np.random.default_rng(data.draw(st.integers(0, 99))).permutation(y.size)
    largest = np.unique(y, return_counts=True)[1].max()
    n_folds = data.draw(st.integers(2, int(largest)))
    folds = block_partitions(y, order, n_folds=n_folds)
    assert len(folds) == n_folds
    check_folds(folds, y, "session")
    when = np.argsort(order)
    for label in np.unique(y):
        sizes, latest = [], -1
        for fold in folds:
            block = np.sort(when[fold.test[y[fold.test] == label]])
            sizes.append(block.size)
            if block.size:
                assert block[0] > latest, "an earlier recording in a later block"
                latest = block[-1]
        assert max(sizes) - min(sizes) <= 1


@given(unbalanced(), st.data())
def test_kfold_is_stratified_even_and_seeded(y, data):
    counts = np.unique(y, return_counts=True)[1]
    n_folds = data.draw(st.integers(2, int(counts.max())))
    folds = kfold_partitions(y, n_folds=n_folds, seed=3)
    check_folds(folds, y, "kfold")
    sizes = [fold.test.size for fold in folds]
    assert max(sizes) - min(sizes) <= 1
    for label in np.unique(y):
        of_class = [int((y[fold.test] == label).sum()) for fold in folds]
        assert max(of_class) - min(of_class) <= 1
    same = kfold_partitions(y, n_folds=n_folds, seed=3)
    assert [f.test.tolist() for f in same] == [f.test.tolist() for f in folds]


AAB = ["a", "a", "b"]
AABB = ["a", "a", "b", "b"]
PLENTY = ["a"] * 99 + ["b"] * 99
FEW = np.repeat(["oat", "rice", "peas"], [80, 50, 61])
TOO_FEW = (
    "class 'rice' has 50 recordings, wanted 62 (50 to train, 12 to test), and 1 more class has too few: "
    "pass train_per_class=40, test_per_class=10"
)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kfold_partitions(AAB, n_folds=2), "class 'b' has 1 recording; the kfold protocol"),
        (lambda: block_partitions(AAB, range(3), n_folds=2), "class 'b' has 1 recording; the session"),
        (lambda: session_partitions(AAB, list("stu")), "class 'b' has 1 recording; the session protocol"),
        (lambda: chronological_partitions(AAB, [0, 1, 2]), "class 'b' has 1 recording; "),
        (lambda: paper_partitions(["a"] * 80), "at least 2 classes, got only 'a'"),
        (lambda: chronological_partitions([], []), "at least 2 classes, got none"),
        (lambda: kfold_partitions(AABB, n_folds=1), "n_folds must be at least 2, got 1"),
        (
            lambda: kfold_partitions(AABB, n_folds=3),
            "n_folds must not exceed the 2 recordings of the largest",
        ),
        (lambda: session_partitions(AABB, [None] * 4), "no recording says which session it is from"),
        (lambda: session_partitions(AABB, ["s", None, "s", "t"]), " has no session but 3 of 4 recordings"),
        (lambda: session_partitions(AABB, list("stuu")), "class 'b' has recordings of one session only"),
        (lambda: paper_partitions(PLENTY, n_partitions=0), "n_partitions must be at least 1, got 0"),
        (lambda: paper_partitions(PLENTY, train_per_class="3"), "must be a whole number, got '3'"),
        (lambda: paper_partitions(FEW), TOO_FEW),
        (
            lambda: describe_order([1.0, np.nan, 2.0], AAB, list("xyz")),
            "recording 'y' has no start time but 2 of",
        ),
        (
            lambda: describe_order([1.0, 1.0, 2.0], AAB, list("xyz")),
            "'x' and 'y' of class 'a' start at the same",
        ),
    ],
)
def test_what_cannot_be_split_is_refused(make, message):
    with pytest.raises((ValueError, TypeError), match=re.escape(message)):
        make()


def data_with(**fields):
    return changed(make_data(n=4), **fields)


def test_the_strictest_protocol_and_why_no_stricter_one():
    assert strictest(make_data()) == ("session", "")
    alone = data_with(session=lambda r: r.label)
    assert strictest(alone) == (
        "chronological",
        "session protocol left out: class 'oat' has recordings of one session only; "
        "holding it out would leave the class nothing to train on",
    )
    some = data_with(session=lambda r: None if r.name == "rice_1" else r.session)
    assert strictest(some)[0] == "chronological"
    assert "recording 'rice_1' has no session but 15 of 16" in strictest(some)[1]
    half_timed = data_with(
        session=lambda r: None, start_time=lambda r: None if r.name == "rice_1" else r.start_time
    )
    protocol, why = strictest(half_timed)
    assert protocol is None
    assert why.startswith("session protocol left out: no recording says")
    assert "chronological protocol left out: recording 'rice_1' has no start time" in why
    with pytest.raises(ValueError, match="has no label, the first is 'lost'"):
        strictest(Dataset([*make_data(n=4), Recording(np.zeros((80, 6)), rate_hz=500.0, name="lost")]))


def test_the_strictest_that_ran_is_whole_sessions_then_halves_then_blocks(data):
    both = {**SMALL, "protocol": ["paper", "session", "chronological"]}
    assert evaluate(data, "raw", **both).strictest == "session"
    alone = changed(data, session=lambda r: r.label)
    assert evaluate(alone, "raw", **both).strictest == "chronological"
    result = evaluate(alone, "raw", ["kfold", "session"], **SMALL)
    assert result.strictest == "session"
    difference = result.mean_accuracy("raw", "kfold") - result.mean_accuracy("raw", "session")
    assert result.gap("raw") == difference
    assert evaluate(alone, "raw", "kfold", **SMALL).strictest is None


def test_auto_says_what_it_left_out(data):
    result = evaluate(changed(data, session=lambda r: None), "raw", **SMALL)
    assert result.protocols == ("chronological", "matched")
    assert "held-out sessions left out: no recording says which session it is from" in result.notes
    assert evaluate(data, "raw", **SMALL).protocols == ("session", "matched")


def test_blocks_in_time_stand_in_for_sessions_and_the_note_says_why():
    _, note = plan_partitions(make_data(n=4), "session")
    assert note == "session: 8 sessions held out whole, in 2 folds"
    folds, note = plan_partitions(data_with(session=lambda r: None), "session", n_folds=2)
    assert [fold.description for fold in folds] == ["block 1 of 2", "block 2 of 2"]
    assert note == (
        "session: no recording says which session it is from; "
        "2 contiguous blocks of each class held out instead, by start time"
    )
    _, note = plan_partitions(data_with(session=lambda r: r.label), "session", n_folds=2)
    assert note.startswith("session: class 'oat' has one session only; 2 contiguous blocks")
    some = data_with(session=lambda r: None if r.name == "rice_1" else r.session)
    with pytest.raises(
        ValueError, match="recording 'rice_1' has no session but 15 of 16 recordings have one"
    ):
        plan_partitions(some, "session")


def test_blocks_that_stand_in_for_sessions_are_named_blocks_whatever_sessions_are_called():
    y = ["oat", "rice", "oat", "rice"]
    assert protocol_name("session", block_partitions(y, range(4), n_folds=2)) == "blocks in time order"
    assert (
        protocol_name("session", session_partitions(y, ["block 1"] * 2 + ["block 2"] * 2))
        == "held-out sessions"
    )


def test_sessions_of_nan_are_not_known_and_numbers_are_names():
    y = ["oat", "rice"] * 3
    known = checked_groups(6, [1, 1, 2, 2, 3, 3], None)
    assert [fold.description for fold in strict_partitions(y, known)[0]] == ["1", "2", "3"]
    folds, why = strict_partitions(y, checked_groups(6, [1, 1, float("nan"), "", None, 3], None))
    assert folds == []
    assert "recording 2 has no session but 3 of 6" in why
    assert why.endswith("chronological protocol left out: no order in time is known")
    halves, _ = strict_partitions(y[2:], checked_groups(6, None, [5, 4, 3, 2, 1, 0]).take(np.arange(2, 6)))
    assert halves[0].train.tolist() == [2, 3]


def lone(**sessions):
    """Recordings of which some classes have another session, by label."""
    return changed(make_data(n=6), session=lambda r: sessions.get(r.label, r.session))


def split_of(data, **fields):
    drawn, notes = sessions_where_possible(data.y, groups_of(changed(data, **fields) if fields else data))
    return drawn, notes, data.y, data.sessions


def test_a_class_of_one_session_is_split_in_time_and_the_others_keep_their_sessions():
    drawn, notes, y, sessions = split_of(lone(oat="the only one"))
    assert [part.protocol for part in drawn] == ["session", "session"]
    assert notes[-1] == "oat: one session only; split in time, by start time"
    for part in drawn:
        others = [rows[y[rows] != "oat"] for rows in (part.train, part.test)]
        assert not set(sessions[others[0]]) & set(sessions[others[1]])
        assert (y[part.test] == "oat").sum() == 3
        assert sorted([*part.train, *part.test]) == list(range(y.size))


def test_a_class_of_one_session_without_an_order_stays_in_training():
    data = changed(
        lone(oat="the only one"), start_time=lambda r: None if r.name == "rice_1" else r.start_time
    )
    drawn, notes, y, _ = split_of(data)
    assert notes[-1] == "oat: one session only; stays in training and is never tested"
    assert all((y[part.train] == "oat").sum() == 6 for part in drawn)


def test_a_recording_without_session_costs_its_class_alone_its_sessions():
    drawn, notes, *_ = split_of(lone(), session=lambda r: None if r.name == "rice_1" else r.session)
    assert len(drawn) == 2
    assert notes[-1].startswith("rice: the session of 1 of 6 recordings is not known; split in time")


@pytest.mark.parametrize(
    ("sessions", "why"),
    [
        (dict.fromkeys(LABELS), "no recording says which session it is from"),
        (dict.fromkeys(LABELS, "one"), "fewer than two classes have several sessions"),
        (dict.fromkeys(LABELS[1:], "one"), "fewer than two classes have several sessions"),
    ],
)
def test_sessions_are_left_out_where_fewer_than_two_classes_have_several(sessions, why):
    drawn, notes, *_ = split_of(lone(**sessions))
    assert (drawn, notes) == ([], [f"held-out sessions left out: {why}"])


def test_where_every_class_has_sessions_the_folds_are_those_of_the_session_protocol():
    data = make_data(n=7)
    drawn, *_ = split_of(data)
    same = session_partitions(data.y, data.sessions)
    assert [(p.train.tolist(), p.test.tolist()) for p in drawn] == [
        (p.train.tolist(), p.test.tolist()) for p in same
    ]


def test_the_result_marks_classes_whose_sessions_were_not_held_out():
    result = evaluate(lone(oat="the only one"), "raw", **SMALL)
    assert result.exceptions == {"oat": "split in time"}
    table = recall_table(result, "raw")
    assert "oat†" in [row[0] for row in table.rows]
    assert table.notes == ("† oat: split in time",)
    assert "held-out sessions† (2)" in result.table()


def test_a_class_that_is_never_tested_is_marked():
    data = changed(
        lone(oat="the only one"), start_time=lambda r: None if r.name == "rice_1" else r.start_time
    )
    result = evaluate(data, "raw", **SMALL)
    assert result.exceptions == {"oat": "never tested"}
    assert "oat†" in [row[0] for row in recall_table(result, "raw").rows]


@given(with_sessions(), st.integers(0, 9))
def test_as_many_at_random_have_the_sizes_of_the_strict_folds(case, seed):
    y, sessions = case
    strict = session_partitions(y, sessions)
    matched = matched_partitions(y, strict, seed=seed)
    check_folds(matched, y, "matched")
    for one, other in zip(strict, matched, strict=True):
        for label in np.unique(y):
            assert (y[one.train] == label).sum() == (y[other.train] == label).sum()
            assert (y[one.test] == label).sum() == (y[other.test] == label).sum()


def test_as_many_at_random_depend_on_the_seed():
    y = np.repeat(["a", "b"], 20)
    strict = chronological_partitions(y, np.arange(40))
    one, same, other = (matched_partitions(y, strict, seed=seed)[0].test.tolist() for seed in (1, 1, 2))
    assert one == same != other


@pytest.mark.parametrize(("n_folds", "folds"), [(None, 5), (3, 3), (9, 8)])
def test_folds_of_sessions_are_few_unless_asked_for(n_folds, folds):
    sessions = changed(make_data(n=8), session=lambda r: r.name[-1])
    partitions, _ = plan_protocols(sessions, "auto", n_folds=n_folds)
    assert {name: len(drawn) for name, drawn in partitions.items()} == {"session": folds, "matched": folds}


def test_many_recordings_are_split_into_three_folds_of_sessions():
    few = make_data(n=12, samples=2)
    many = Dataset([replace(r, name=f"{k} {r.name}", session=f"s{k % 6}") for k in range(45) for r in few])
    partitions, _ = plan_protocols(many, "auto")
    assert len(partitions["session"]) == 3


def test_random_folds_stand_alone_where_nothing_stricter_is_known():
    data = data_with(
        session=lambda r: None, start_time=lambda r: None if r.name == "rice_1" else r.start_time
    )
    partitions, notes = plan_protocols(data, "auto")
    assert {name: len(drawn) for name, drawn in partitions.items()} == {"kfold": 4}
    assert notes[1].startswith("halves in time left out: recording 'rice_1' has no start time")


def test_as_many_at_random_cannot_be_asked_for_by_itself():
    with pytest.raises(ValueError, match=r"protocol must be 'auto' or among .*, got 'matched'"):
        plan_protocols(make_data(n=4), "matched")
