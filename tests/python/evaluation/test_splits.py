"""Which recordings train and which are tested: whatever the data, and errors that say why not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from evaluation_cases import LABELS, TOOLS, make_data, with_tools
from granular_id.conditions import conditions_in
from granular_id.evaluation import matched_draws
from granular_id.recording import Dataset, Recording
from granular_id.splits import checked_groups, choice_folds, groups_of, hold_out, paper_folds


def made(labels, sessions=None, times=None, **fields):
    """Recordings without samples."""
    sessions = [None] * len(labels) if sessions is None else sessions
    times = [None] * len(labels) if times is None else times
    return Dataset(
        [
            Recording(
                np.zeros((2, 6)), 500.0, label=str(label), session=session, start_time=time, name=f"{k}",
                meta={name: values[k] for name, values in fields.items()},
            )
            for k, (label, session, time) in enumerate(zip(labels, sessions, times, strict=True))
        ]
    )  # fmt: skip


@st.composite
def collections(draw):
    """Recordings in any order, with sessions of one material, of several or not known, and a tool."""
    counts = draw(st.lists(st.integers(1, 9), min_size=2, max_size=4))
    labels = np.repeat([f"m{k}" for k in range(len(counts))], counts)
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    labels = rng.permutation(labels)
    own = draw(st.booleans())
    number = rng.integers(0, draw(st.integers(1, 6)), labels.size)
    sessions = [f"{label if own else 's'} {s}" for label, s in zip(labels, number, strict=True)]
    if draw(st.booleans()):
        sessions = [None if rng.random() < 0.1 else session for session in sessions]
    times = rng.permutation(labels.size).astype(float) if draw(st.booleans()) else None
    tools = [f"tool {t}" for t in rng.integers(0, 3, labels.size)]
    return made(labels, sessions, times, tool=tools)


PROTOCOLS = st.sampled_from(["auto", "session", "time", "random", "tool"])


def drawn(data, by, n_folds=None):
    """Return folds of a collection that allows them."""
    try:
        return hold_out(data, by, n_folds)
    except ValueError:
        assume(False)


@given(collections(), PROTOCOLS, st.integers(2, 7))
def test_hold_out_any_collection_gives_folds_that_are_sound(data, by, n_folds):
    folds = drawn(data, by, n_folds)
    tested = np.concatenate([fold.test for fold in folds])
    assert np.unique(tested).size == tested.size, "a row is tested twice"
    materials = set(data.y[tested])
    assert not materials & set(folds.untested)
    assert materials | set(folds.untested) == set(data.y)
    for fold in folds:
        assert not set(fold.train) & set(fold.test)
        assert fold.test.size
        assert (np.diff(fold.train) > 0).all()
        assert (np.diff(fold.test) > 0).all()
        assert set(data.y[fold.test]) <= set(data.y[fold.train])
        if folds.by == "session":
            assert not set(data.sessions[fold.train]) & set(data.sessions[fold.test])
        if folds.by != "tool":
            assert set(data.y[fold.train]) == set(data.y), "a material without training rows"
    again = hold_out(data, by, n_folds)
    assert [fold.test.tolist() for fold in again] == [fold.test.tolist() for fold in folds]


@given(collections(), st.sampled_from(["session", "time", "tool"]))
def test_matched_draws_keep_counts_of_each_class(data, by):
    folds = drawn(data, by)
    draws, _ = matched_draws(data, folds, 3)
    for draw in draws:
        for one, strict in zip(draw, folds, strict=True):
            assert not set(one.train) & set(one.test)
            for rows, others in ((one.train, strict.train), (one.test, strict.test)):
                assert sorted(data.y[rows]) == sorted(data.y[others])
        tested = np.concatenate([one.test for one in draw])
        assert np.unique(tested).size == tested.size
    again, _ = matched_draws(data, folds, 3)
    assert [f.test.tolist() for d in again for f in d] == [f.test.tolist() for d in draws for f in d]


def test_matched_draws_mix_sessions():
    data = make_data(n=8)
    folds = hold_out(data)
    draws, _ = matched_draws(data, folds)
    assert len(draws) == 19
    mixed = [set(data.sessions[f.train]) & set(data.sessions[f.test]) for draw in draws for f in draw]
    assert all(mixed)
    assert len({tuple(draw.folds[0].test) for draw in draws}) == 19


def test_sessions_of_their_own_are_held_out_one_of_each_material():
    y = np.repeat(["oat", "rice", "peas"], 12)
    sessions = [f"{label} {k % 3}" for k, label in enumerate(y)]
    folds = hold_out(made(y, sessions))
    assert [fold.held_out[:12] for fold in folds] == ["3 sessions: "] * 3
    for fold in folds:
        assert sorted({sessions[row].split()[0] for row in fold.test}) == ["oat", "peas", "rice"]
        assert len({sessions[row] for row in fold.test}) == 3


LONE, UNKNOWN = "one session, which always trains", "the session of 1 recording is not known"


@pytest.mark.parametrize(
    ("materials", "sessions", "held", "untested"),
    [
        ("ababab", "ssttuu", ["s", "t", "u"], {}),
        ("aaaabbbbccdd", "stuvstuvssss", ["t", "u", "v"], {"c": LONE, "d": LONE}),
        ("aabbccddee", "ssttstuvuv", ["u", "v"], {"c": "its sessions are the only ones of other materials"}),
        ("aabbcccc", "ststst t", ["s", "t"], {"c": UNKNOWN}),
    ],
)
def test_what_has_no_other_session_trains_and_is_not_tested(materials, sessions, held, untested):
    data = made(materials, [name.strip() or None for name in sessions])
    folds = hold_out(data, "session")
    assert [fold.held_out for fold in folds] == held
    assert untested.items() <= dict(folds.untested).items()
    for fold in folds:
        assert set(data.sessions[fold.test]) == {fold.held_out}
        assert {row for row, name in enumerate(sessions) if name not in held} <= set(fold.train)
        assert not set(data.y[fold.test]) & set(untested)


@pytest.mark.parametrize(("n", "n_folds"), [(2000, 5), (2002, 3)])
def test_many_sessions_are_held_out_in_few_folds_of_like_size(n, n_folds):
    folds = hold_out(made(["oat", "rice"] * (n // 2), [f"s{k // 2 % 25}" for k in range(n)]))
    assert len(folds) == n_folds
    sizes = [fold.test.size for fold in folds]
    assert max(sizes) - min(sizes) <= 0.2 * max(sizes)


def test_sessions_of_a_material_in_one_fold_make_a_further_fold():
    """In two folds both sessions of b would be held out at once, and b would not train."""
    data = made("bbaaab", "ssttuu")
    folds = hold_out(data, "session", 2)
    assert [fold.held_out for fold in folds] == ["s", "t", "u"]
    assert all(set(data.y[fold.train]) == {"a", "b"} for fold in folds)


@pytest.mark.parametrize(
    ("materials", "sessions", "times", "by", "why"),
    [
        ("ab", None, None, "time", "not held-out sessions: no recording says which session it is from"),
        ("ab", "sssstttt", None, "time", "fewer than two materials have several sessions"),
        ("ab", None, [1, *[None] * 7], "random", "not halves in time: recording '1' has no start time"),
        ("ab", "stststst", None, "session", "2 sessions held out whole, in 2 folds"),
        ("abcde", "ststststccccddddeeee", None, "time", "2 of 5 materials have several"),
        ("abcde", "ststststccccddddeeee", [1, *[None] * 19], "session", "2 sessions held out whole"),
    ],
)
def test_auto_takes_sessions_else_halves_else_random_folds(materials, sessions, times, by, why):
    folds = hold_out(made(np.repeat(list(materials), 4), sessions, times))
    assert folds.by == by
    assert why in " ".join(folds.notes)


@given(st.integers(0, 99), st.integers(2, 9))
def test_halves_are_early_and_late_in_each_material(seed, n):
    rng = np.random.default_rng(seed)
    data = made(["a"] * n + ["b"] * 7, times=rng.permutation(n + 7).astype(float))
    forward, backward = hold_out(data, "time")
    assert forward.train.tolist() == backward.test.tolist()
    assert forward.test.tolist() == backward.train.tolist()
    for label, size in (("a", n), ("b", 7)):
        halves = (forward.train, forward.test)
        early, late = (data.start_times[rows[data.y[rows] == label]] for rows in halves)
        assert early.max() < late.min()
        assert late.size - early.size == size % 2


@given(st.integers(2, 9), st.integers(2, 9), st.integers(2, 6))
def test_random_folds_are_stratified_and_even(n, m, n_folds):
    data = made(["a"] * n + ["b"] * m)
    folds, other = (hold_out(data, "random", n_folds, seed=seed) for seed in (0, 1))
    for rows_of in (range(n), range(n, n + m), range(n + m)):
        sizes = [np.isin(fold.test, rows_of).sum() for fold in folds]
        assert max(sizes) - min(sizes) <= 1
    assert not folds.strict
    assert n + m < 12 or [fold.test.tolist() for fold in other] != [fold.test.tolist() for fold in folds]


@pytest.mark.parametrize(
    ("times", "note"),
    [
        ([3.0, 1.0, 2.0], "by start time"),
        ([5.0, 1.0, 1.0], "by start time"),  # the equal times are in different classes
        ([np.nan] * 3, "as the recordings carry no start time"),
        ([0.0] * 3, "as all recordings start at the same time, so that their clocks say nothing"),
    ],
)
def test_order_in_time_says_what_it_goes_by(times, note):
    known = [None if np.isnan(t) else t for t in times]
    assert groups_of(made("aab", times=known)).basis == note
    folds = hold_out(made("aabb", times=[*known, known[-1] and 9.0]), "time")
    assert folds.name == f"halves in {'time' if note.startswith('by') else 'file'} order"
    assert folds.notes == (f"{folds.name}, {note}",)


def test_rows_whose_session_is_not_known_choose_by_others():
    codes, known = np.repeat([0, 1, 2], 4), [*[1, 2] * 4, float("nan"), "", None, 2]
    folds = choice_folds(codes, checked_groups(len(codes), known), n_folds=5, seed=0)
    assert (folds.held_out, len(folds.folds)) == ("sessions", 2)
    assert all(test.max() < 8 for _, test in folds.folds)


def test_each_value_of_a_condition_is_held_out_whole():
    data = with_tools(depth_mm=lambda k, _: 10.0 * (k % 2))
    tools, folds = np.array([TOOLS[k % 12 // 4] for k in range(48)]), hold_out(data, "tool")
    assert [fold.held_out for fold in folds] == list(TOOLS)
    assert (folds.name, folds.strict, folds.sessions_apart) == ("another tool", True, True)
    for fold, tool in zip(folds, TOOLS, strict=True):
        np.testing.assert_array_equal(fold.test, np.flatnonzero(tools == tool))
        np.testing.assert_array_equal(fold.train, np.flatnonzero(tools != tool))


@pytest.mark.parametrize(
    ("session", "notes"),
    [
        (lambda k: f"{k // 4 % 3}", ["each session has one tool: a loss may be that of other sessions"]),
        (lambda k: None, []),
        (lambda k: "one day", ["1 session has several values of tool"]),
    ],
)
def test_a_condition_beside_sessions_is_noted(session, notes):
    data = Dataset([replace(r, session=session(k)) for k, r in enumerate(with_tools())])
    assert [note.partition(": what")[0] for note in hold_out(data, "tool").notes[1:]] == notes


def test_a_material_without_another_value_is_not_tested_there():
    folds = hold_out(made([*"abc" * 4, "d", "d"], tool=["one"] * 6 + ["two"] * 8), "tool")
    assert set(folds.folds[1].test) == set(range(6, 12))
    assert dict(folds.untested) == {"d": "no other tool to train on"}
    assert "tool 'two': d has no other value to train on, and is not tested there" in folds.notes


def test_conditions_are_session_set_up_metadata_and_day():
    meta = {"tool": "rod", "rig": {"speed_m_s": 0.03, "lid": True}}
    known = conditions_in(Dataset([replace(r, meta=meta) for r in with_tools()]))
    assert list(known) == ["session", "tool", "motion", "rig.speed_m_s", "rig.lid", "day"]
    assert [values[0] for name, values in known.items() if name != "session"] == [
        *("rod", "0.03 m/s", "0.03", "True", "2001-09-09")
    ]


@pytest.mark.parametrize("name", ["depth_mm", "rig.depth_mm"])
def test_the_end_of_a_path_is_enough(name):
    data = with_tools(rig=lambda k, _: {"depth_mm": 10.0 + k % 2})
    folds = hold_out(data, name)
    assert (folds.by, folds.name) == ("rig.depth_mm", "another rig.depth_mm")


@given(st.integers(1, 6), st.integers(1, 6))
def test_paper_folds_have_exact_counts_of_each_class(train, test):
    y = np.array(["a"] * 12 + ["b"] * 15)
    folds = paper_folds(made(y), 3, train, test, seed=7)
    assert (folds.name, folds.strict, len(folds)) == ("random partitions", False, 3)
    for fold in folds:
        assert not set(fold.train) & set(fold.test)
        for label in "ab":
            assert ((y[fold.train] == label).sum(), (y[fold.test] == label).sum()) == (train, test)


def test_paper_folds_by_default_are_those_of_the_paper():
    y = np.repeat(["a", "b"], 62)
    folds = paper_folds(made(y))
    sizes = {(np.sum(y[fold.train] == "a"), np.sum(y[fold.test] == "a")) for fold in folds}
    assert (len(folds), sizes) == (20, {(50, 12)})


def test_more_paper_folds_keep_the_earlier_ones():
    data = made(["a", "b", "c"] * 20)
    few, many, other = (paper_folds(data, n, 10, 5, seed=seed) for n, seed in ((3, 4), (6, 4), (3, 5)))
    assert [f.train.tolist() for f in few] == [f.train.tolist() for f in many][:3]
    assert few.folds[0].train.tolist() != other.folds[0].train.tolist()


def drives(sessions, n=1200, each=1):
    """Long recordings of noise, some of each material, `each` of them a session."""
    rng = np.random.default_rng(0)
    return Dataset(
        [
            Recording(rng.normal(size=(n, 6)), 100.0, label=m, name=f"{m}{k}", session=f"{m}{k // each}")
            for m, n_sessions in sessions.items()
            for k in range(n_sessions)
        ]
    )


def n_parted(data, folds):
    """Count pairs of windows that share samples and lie on both sides of a fold."""
    cut = [(r.meta["window"]["recording"], r.meta["window"]["start_s"]) for r in data]
    return sum(
        cut[row][0] == cut[other][0] and abs(cut[row][1] - cut[other][1]) < data[0].duration_s - 1e-9
        for fold in folds
        for row in fold.train
        for other in fold.test
    )


@pytest.mark.parametrize("by", ["auto", "session", "time", "random", "paper"])
def test_windows_that_share_samples_never_lie_on_both_sides(by):
    data = drives({"a": 3, "b": 3, "c": 1}).windows(1.0, 0.5)
    folds = paper_folds(data[data.y != "c"], 3, 20, 5) if by == "paper" else hold_out(data, by)
    assert n_parted(data, folds) == 0
    cleared = [note for note in folds.notes if "share samples with tested ones do not train" in note]
    assert len(cleared) == (by in ("time", "random", "paper"))


@pytest.mark.parametrize("hop_s", [0.5, 1.0])
def test_windows_without_sessions_are_halves_of_whole_recordings(hop_s):
    """That they were cut from one recording makes no session of it."""
    data = drives({"a": 5, "b": 4})
    whole = Dataset([replace(recording, session=None) for recording in data])
    windows, names = whole.windows(1.0, hop_s), np.array(whole.names)
    folds = hold_out(windows)
    assert folds.by == "time"
    cut = np.array([r.meta["window"]["recording"] for r in windows])
    for fold, of_whole in zip(folds, hold_out(whole), strict=True):
        assert sorted(set(cut[fold.test])) == sorted(names[of_whole.test])
        assert sorted(set(cut[fold.train])) == sorted(names[of_whole.train])


def test_random_folds_of_windows_test_whole_recordings():
    """Each window shares samples with all others of its recording: drawn singly, none would be left to train on."""
    data = drives({"a": 6, "b": 6}, n=160).windows(1.0, 0.2)
    folds = hold_out(data, "random")
    cut = np.array([r.meta["window"]["recording"] for r in data])
    assert not any(set(cut[fold.train]) & set(cut[fold.test]) for fold in folds)
    assert sorted(np.concatenate([fold.test for fold in folds]).tolist()) == list(range(len(data)))
    assert all(set(data.y[fold.test]) == {"a", "b"} for fold in folds)


@pytest.mark.parametrize("hop_s", [0.5, 1.0])
def test_matched_draws_never_part_windows_of_a_recording(hop_s):
    data = drives({"a": 8, "b": 8}, n=300, each=2).windows(1.0, hop_s)
    folds = hold_out(data)
    cut = np.array([r.meta["window"]["recording"] for r in data])
    for draw in matched_draws(data, folds, 5)[0]:
        assert not any(set(cut[fold.train]) & set(cut[fold.test]) for fold in draw)
        assert [fold.test.size for fold in draw] == [fold.test.size for fold in folds]


def test_too_few_long_recordings_give_no_draws():
    data = drives({"a": 8, "b": 8}, n=300).windows(1.0, 0.5)
    draws, why = matched_draws(data, hold_out(data, n_folds=2))
    assert draws == []
    assert why.startswith("a: 8 recordings cut into windows that share samples, too few to mix")


def test_windows_that_share_nothing_are_drawn_singly():
    data = drives({"a": 4, "b": 4}).windows(1.0)
    ((draw,), _) = matched_draws(data, hold_out(data), 1)
    assert [fold.train.size + fold.test.size for fold in draw] == [len(data)] * 4


FEW = np.repeat(["oat", "rice", "peas"], [80, 50, 61])
TOOLED = with_tools(
    depth_mm=lambda k, _: 10.0 * (k % 2),
    run=lambda k, _: k,
    robot=lambda k, _: "left" if k == 0 else None,
    lid=lambda k, _: f"lid {k // 6 % 2}" if k < 12 else "lid 1",
    kind=lambda k, _: LABELS[k // 12],
    a=lambda k, _: {"width": 1},
    b=lambda k, _: {"width": 2},
)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hold_out(TOOLED, "speed"), "those that can be: session (6 values), tool (3 values), "),
        (
            lambda: hold_out(TOOLED, "label"),
            "by='label' cannot be held out, as the labels are what is distinguished",
        ),
        (lambda: hold_out(TOOLED, "day"), "all recordings have the same value, '2001-09-09'"),
        (lambda: hold_out(TOOLED, "run"), "it has 48 values in 48 recordings, each a training of its own"),
        (lambda: hold_out(TOOLED, "robot"), "47 of 48 recordings do not state it, the first is 'oat_1'"),
        (lambda: hold_out(TOOLED, "lid"), "oat alone has several values of it"),
        (lambda: hold_out(TOOLED, "kind"), "each material has one value of it only (oat: 'oat'"),
        (lambda: hold_out(TOOLED, "width"), "it is several things: a.width, b.width"),
        (lambda: hold_out(TOOLED, "a"), "it is no single value: take one within it, such as 'a.width'"),
        (lambda: checked_groups(3, order=[0, 0, 1]), "order must hold the row numbers 0 to 2, each once"),
        (lambda: checked_groups(3, order=[[0, 1, 2]]), "order must hold the row numbers 0 to 2, each once"),
        (lambda: checked_groups(3, order=[0.0, 1.0, 2.0]), "order must hold the row numbers 0 to 2"),
        (lambda: hold_out(drives({"a": 1, "b": 1}, 400).windows(2.0, 0.1), "random"), "windows of a and b"),
        (lambda: hold_out(made("aabb"), "tool"), "these recordings state none that can be"),
        (lambda: hold_out(made("aaa")), "at least 2 classes, got only 'a'"),
        (lambda: hold_out(made("aab"), "random"), "by='random' cannot be held out: fewer than two materials"),
        (lambda: hold_out(made("ab")), "fewer than two materials have more than one recording"),
        (lambda: hold_out(made("aabb"), "session"), "no recording says which session it is from"),
        (lambda: hold_out(made("aabb", list("stuu")), "session"), "fewer than two materials have several"),
        (lambda: hold_out(made("aabb"), 3), "by must be text such as 'session' or 'tool', got 3"),
        (lambda: hold_out(made("aabb"), "random", 1), "n_folds must be at least 2, got 1"),
        (lambda: hold_out(made("aab", times=[1, None, 2]), "time"), "recording '1' has no start time but 2"),
        (lambda: hold_out(made("aab", times=[1, 1, 2]), "time"), "'0' and '1' of class 'a' start at"),
        (lambda: paper_folds(made(FEW)), "pass paper=(20, 40, 10)"),
        (lambda: paper_folds(made(FEW), 0), "n_partitions must be at least 1, got 0"),
        (lambda: paper_folds(made(FEW), 3, "3"), "must be a whole number, got '3'"),
    ],
)
def test_what_cannot_be_split_is_refused(make, message):
    with pytest.raises((ValueError, TypeError), match=re.escape(message)) as caught:
        make()
    assert "cannot be held out" not in str(caught.value) or caught.value.argument == "by"
