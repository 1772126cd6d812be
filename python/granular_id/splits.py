"""Which recordings train and which are tested: nowhere else is this decided.

Recordings made minutes apart share tool, fill, zero offset and temperature, so random folds flatter a method that has
learned the session instead of the material. `hold_out` holds out what new recordings will not share: whole sessions
where they are known, else halves in the order of time, or of the files where no time is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from granular_id._checks import argument_error, whole_number
from granular_id._core import GranularIdError
from granular_id._estimators import routed
from granular_id._text import counted, listed, verb
from granular_id.conditions import condition_of
from granular_id.recording import Dataset, overlapping_windows, recordings_cut

Rows = NDArray[np.intp]
Values = Sequence[str | None] | NDArray[Any]
"""Session, or another condition, of each recording; None or "" where it is not known."""

AUTO, SESSION, TIME, RANDOM, PAPER = "auto", "session", "time", "random", "paper"

NAMES = {
    SESSION: "held-out sessions",
    TIME: "halves in time order",  # of files where no time is known: see `Folds.name`
    RANDOM: "random folds",
    PAPER: "random partitions",
}
"""Each way to hold out, in words; a condition is called after itself."""

_BY_START = "by start time"

N_FOLDS = 5
MANY_RECORDINGS, FOLDS_OF_MANY = 2000, 3  # fewer folds: time grows faster than the number of recordings

_TOO_FEW = (
    "fewer than two materials have more than one recording: where the labels are no materials, say which folder, file "
    "name, column or entry of meta is (data convert --label); where one recording holds several pushes, cut it into "
    "windows (data convert --window-s)"
)

# Random folds that choose are drawn again until so many rows were held out in all: with 50 rows one in a hundred is
# less than a row, and which rows share a fold decides. Not more often than 10 times: draws of the same rows are alike.
_ENOUGH_ROWS, _MOST_REPEATS = 500, 10


class Fold(NamedTuple):
    """Rows that train and rows that are tested, ascending, none in both, and what is held out, for a table."""

    train: Rows
    test: Rows
    held_out: str


@dataclass(frozen=True, eq=False)
class Folds:
    """Folds, as `hold_out` draws them.

    Attributes
    ----------
    by : str
        ``"session"``, ``"time"``, ``"random"``, ``"paper"``, or the name of the condition that is held out.
    folds : tuple of Fold
        Rows that train, rows that are tested, and what is held out.
    notes : tuple of str
        How they were drawn, one line each.
    untested : mapping of str to str
        Material to why it is never tested.
    seed : int
        Of what is drawn at random.
    overlapping : bool
        Whether the recordings are windows of which some share samples.
    in_file_order : bool
        Whether halves go by the order of the data set, as start times say none.
    """

    by: str
    folds: tuple[Fold, ...]
    notes: tuple[str, ...] = ()
    untested: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0
    overlapping: bool = False
    in_file_order: bool = False

    @property
    def name(self) -> str:
        """What they hold out in words, such as ``"held-out sessions"`` or ``"another tool"``."""
        if self.in_file_order:
            return "halves in file order"
        return NAMES.get(self.by, f"another {self.by}")

    @property
    def strict(self) -> bool:
        """Whether something is held out that new recordings do not share: a session, a time, a condition."""
        return self.by not in (RANDOM, PAPER)

    @property
    def sessions_apart(self) -> bool:
        """Whether each fold holds out whole sessions, or values of a condition."""
        return self.strict and self.by != TIME

    def __len__(self) -> int:
        return len(self.folds)

    def __iter__(self) -> Iterator[Fold]:
        return iter(self.folds)


@dataclass(frozen=True, eq=False)
class Groups:
    """Sessions of recordings, their order in time, and shared samples: what must not lie on both sides of a split."""

    sessions: NDArray[np.object_]  # (n,), None where a session is not known
    rank: Rows | None  # place of each recording in time, None where no order is known
    basis: str = ""  # what the order goes by, or why there is none
    conditions: NDArray[np.object_] | None = None  # (n,) what new recordings do not share, where it is known
    overlaps: Rows | None = None  # (P, 2) pairs of recordings that share samples, where there are any
    cut_from: Rows | None = None  # (n,) number of the recording that each is a window of, where there are any

    @property
    def order(self) -> Rows | None:
        """Row numbers from the earliest to the latest; None where no order is known."""
        return None if self.rank is None else np.argsort(self.rank, kind="stable")

    def take(self, rows: Rows) -> Groups:
        """Return the groups of some rows."""
        rank = None if self.rank is None else self.rank[rows]
        conditions = None if self.conditions is None else self.conditions[rows]
        overlaps = self.overlaps
        if overlaps is not None:
            place = np.full(len(self.sessions), -1)
            place[rows] = np.arange(len(rows))
            overlaps = place[overlaps[np.isin(overlaps, rows).all(axis=1)]]
        cut_from = None if self.cut_from is None else self.cut_from[rows]
        return Groups(self.sessions[rows], rank, self.basis, conditions, overlaps, cut_from)

    def fit_arguments(self, estimator: Any) -> dict[str, Any]:
        """Return those of sessions, order, groups and overlaps that `fit` takes, in a pipeline that of its last step.

        ``groups`` are conditions; of sessions and order None where none is known.
        """
        known = any(session is not None for session in self.sessions)
        always = {"sessions": self.sessions if known else None, "order": self.order}
        more = {"groups": self.conditions, "overlaps": self.overlaps}
        more = {name: value for name, value in more.items() if value is not None}
        return routed(estimator, {**always, **more})


def groups_of(data: Dataset, by: str = AUTO) -> Groups:
    """Gather sessions and the order in time of a data set, and the condition that is to be held out."""
    conditions = None if by in (AUTO, *NAMES) else condition_of(data, by)[1]
    return Groups(
        data.sessions, *_order_in_time(data), conditions, _overlaps(data), recordings_cut(data.recordings)
    )


def _order_in_time(data: Dataset) -> tuple[Rows | None, str]:
    """Place of each recording in time, and what that goes by; None and the reason where no order is known.

    Start times decide when every recording has one, and no two of a material share theirs. When none has, or all share
    one, as clocks that start at zero do, the order of the data set stands in: for a folder the natural order of its
    files.
    """
    times, names = data.start_times, data.names
    rank: Rows = np.argsort(
        np.argsort(times, kind="stable"), kind="stable"
    )  # the order of the data where all is NaN
    known = np.isfinite(times)
    if not known.any():
        return rank, "as the recordings carry no start time"
    if not known.all():
        return None, (
            f"recording {names[int(known.argmin())]!r} has no start time but {int(known.sum())} of {times.size} "
            "recordings have one: no order in time"
        )
    if times.size > 1 and (times == times[0]).all():
        return rank, "as all recordings start at the same time, so that their clocks say nothing"
    seen: dict[tuple[str, float], int] = {}
    for row, moment in enumerate(zip(data.y.tolist(), times.tolist(), strict=True)):
        twin = seen.setdefault(moment, row)
        if twin != row:
            return None, (
                f"recordings {names[twin]!r} and {names[row]!r} of class {moment[0]!r} start at the same time: "
                "no order in time"
            )
    return rank, _BY_START


def rows_of_class(y: ArrayLike) -> dict[Any, Rows]:
    """Return the rows (ascending) of each label (sorted), or refuse fewer than two classes."""
    labels, codes = np.unique(np.asarray(y), return_inverse=True)
    if labels.size < 2:
        have = f"only {labels[0].item()!r}" if labels.size else "none"
        raise GranularIdError(f"training needs recordings of at least 2 classes, got {have}")
    return {label: np.flatnonzero(codes == k) for k, label in enumerate(labels.tolist())}


# The rule.


def hold_out(data: Dataset, by: str = AUTO, n_folds: int | None = None, seed: int = 0) -> Folds:
    """Draw the folds by which a data set is judged: `evaluate`, `Identifier.fit` and all else use these.

    Parameters
    ----------
    data : Dataset
        Recordings with a label each.
    by : str
        ``"auto"``: whole sessions where at least half of the materials have two or more; else halves of each material
        in time order, both ways; else random folds. ``"session"``, ``"time"`` and ``"random"`` name one. Else a
        condition of the recordings, such as ``"tool"``, ``"day"`` or an entry of the metadata by its path
        (``"rig.speed_m_s"``): each value in turn.
    n_folds : int, optional
        The most folds of sessions, and the number of random folds. Default: 5, or 3 for more than 2000 recordings,
        whose folds take minutes.
    seed : int
        Of random folds.

    Returns
    -------
    Folds

    Raises
    ------
    ValueError
        Fewer than two materials, or what `by` names cannot be held out: the message says why.

    Notes
    -----
    A session that is held out trains nothing, of any material. The only session of a material always trains, and that
    material is not tested. Every material keeps recordings to train on in every fold. Windows of one recording that
    share samples never lie on both sides: those that share samples with a tested one do not train.

    Examples
    --------
    >>> from granular_id import synthesize
    >>> from granular_id.splits import hold_out
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, sessions=3, duration_s=0.5)
    >>> folds = hold_out(data)
    >>> folds.name, [fold.held_out for fold in folds]
    ('held-out sessions', ['session 1', 'session 2', 'session 3'])
    """
    if not isinstance(by, str):
        raise argument_error(TypeError, "by", f"must be text such as 'session' or 'tool', got {by!r:.60}")
    most = N_FOLDS if len(data) <= MANY_RECORDINGS else FOLDS_OF_MANY
    if n_folds is not None:
        most = whole_number("n_folds", n_folds, least=2)
    rows_of_class(data.y)  # what no folds can do without is an error, not a reason to take others
    groups = groups_of(data)
    drawn: Folds | str
    if by == AUTO:
        drawn = _auto(data.y, groups, most, seed)
    elif by == SESSION:
        drawn = _session_folds(data.y, groups.sessions, most)
    elif by == TIME:
        drawn = _time_folds(data.y, groups)
    elif by == RANDOM:
        drawn = _random_folds(data.y, most, seed, groups.overlaps)
    else:
        drawn = _condition_folds(data, *condition_of(data, by))
    if isinstance(drawn, str):
        raise argument_error(GranularIdError, "by", f"={by!r} cannot be held out: {drawn}")
    return _without_shared_samples(replace(drawn, seed=seed), data.y, groups.overlaps)


def _auto(y: NDArray[np.str_], groups: Groups, n_folds: int, seed: int) -> Folds:
    """Take sessions where half of the materials are tested, else halves in time, else random folds."""
    sessions, why = _most_by_session(y, groups.sessions, n_folds)
    if sessions is not None and not why:
        return sessions
    why = f"not held-out sessions: {why}"
    in_time = _time_folds(y, groups)
    if isinstance(in_time, Folds):
        return replace(in_time, notes=(*in_time.notes, why))
    if sessions is not None:
        return sessions
    drawn = _random_folds(y, n_folds, seed, groups.overlaps)
    if isinstance(drawn, str):
        raise GranularIdError(drawn)
    return replace(drawn, notes=(*drawn.notes, f"{why}; not halves in time: {in_time}"))


def _most_by_session(y: NDArray[Any], sessions: Values, n_folds: int) -> tuple[Folds | None, str]:
    """Hold out whole sessions; say why that is not enough where fewer than half of the materials are tested."""
    drawn = _session_folds(y, sessions, n_folds)
    if isinstance(drawn, str):
        return None, drawn
    n_materials = np.unique(y).size
    n_tested = n_materials - len(drawn.untested)
    few = f"{n_tested} of {counted(n_materials, 'material')} have several"
    return drawn, "" if n_tested >= n_materials / 2 else few


def _session_folds(y: NDArray[Any], sessions: Values, n_folds: int) -> Folds | str:
    """Hold out whole sessions of every material that has several; say why not where fewer than two have.

    There are as many folds as the material with most sessions has, up to `n_folds`; of more, sessions are held out in
    groups. Needs no randomness: the largest sessions are placed first, each where its materials have fewest rows.
    """
    of_class = rows_of_class(y)
    names = np.array([session or "" for session in sessions], dtype=object)
    if not names.astype(bool).any():
        return "no recording says which session it is from"
    untested: dict[str, str] = {}
    always: set[Any] = {""}  # sessions that always train
    for label, own in of_class.items():
        n_unknown = int((names[own] == "").sum())
        if n_unknown:
            untested[label] = f"the session of {counted(n_unknown)} is not known"
        elif len(set(names[own])) == 1:
            untested[label] = "one session, which always trains"
            always.add(names[own[0]])
    for label, own in of_class.items():
        if label not in untested and not set(names[own]) - always:
            untested[label] = "its sessions are the only ones of other materials"
    tested = [label for label in of_class if label not in untested]
    if len(tested) < 2:
        return "fewer than two materials have several sessions"
    rows = np.array([row for row, name in enumerate(names) if name not in always], dtype=np.intp)
    held_names, session_of = np.unique(names[rows].astype(str), return_inverse=True)
    # Rows of each session and material; a material may have others, which always train.
    counts = np.column_stack(
        [np.bincount(session_of[y[rows] == label], minlength=held_names.size) for label in tested]
    )
    stays = counts.sum(axis=0) < [of_class[label].size for label in tested]
    n_used = min(n_folds, int(np.count_nonzero(counts, axis=0).max()))
    placed = _placed(counts, n_used)
    while not all(np.unique(placed[column > 0]).size > 1 for column in counts.T[~stays]):
        n_used += 1  # ends: with a fold for each session none is alone in its material
        placed = _placed(counts, n_used)
    folds = []
    for fold in dict.fromkeys(placed[session_of].tolist()):
        out = rows[placed[session_of] == fold]
        test = out[np.isin(y[out], tested)]
        inside = held_names[placed == fold]
        held_out = str(inside[0]) if inside.size == 1 else f"{inside.size} sessions: {inside[0]}, ..."
        if test.size:
            folds.append(Fold(np.setdiff1d(np.arange(len(y)), out), test, held_out))
    note = f"{counted(held_names.size, 'session')} held out whole, in {counted(len(folds), 'fold')}"
    return Folds(SESSION, tuple(folds), (note,), untested)


def _placed(counts: Rows, n_folds: int) -> Rows:
    """Fold of each session: largest first, each where the rows of its own classes are fewest."""
    load = np.zeros((n_folds, counts.shape[1]), dtype=np.intp)
    placed = np.empty(len(counts), dtype=np.intp)
    for session in np.argsort(-counts.sum(axis=1), kind="stable").tolist():
        costs = zip((load @ counts[session]).tolist(), load.sum(axis=1).tolist(), range(n_folds), strict=True)
        fold = min(costs)[-1]
        placed[session] = fold
        load[fold] += counts[session]
    return placed


def _time_folds(y: NDArray[Any], groups: Groups) -> Folds | str:
    """Test each half of each material in time order on the other; say why not where no order is known.

    The middle one of an odd count is in the second half; the single recording of a class always trains. Windows are in
    the half of the recording that they were cut from, unless all of a class were cut from one.
    """
    if groups.rank is None:
        return groups.basis
    several, untested = _with_several_rows(y)
    if len(several) < 2:
        return _TOO_FEW
    side = np.zeros(len(y), dtype=np.intp)
    units = np.arange(len(y)) if groups.cut_from is None else groups.cut_from
    for own in several:
        in_time = own[np.argsort(groups.rank[own])]
        _, begins, unit = np.unique(units[in_time], return_index=True, return_inverse=True)
        place = np.argsort(np.argsort(begins))[unit] if begins.size > 1 else np.arange(own.size)
        side[in_time] = np.where(place < max(place + 1) // 2, 1, 2)
    folds = tuple(
        Fold(np.flatnonzero(side != test), np.flatnonzero(side == test), name)
        for test, name in ((2, "1st->2nd half"), (1, "2nd->1st half"))
    )
    drawn = Folds(TIME, folds, (), untested, in_file_order=groups.basis != _BY_START)
    return replace(drawn, notes=(f"{drawn.name}, {groups.basis}",))


def _random_folds(y: NDArray[Any], n_folds: int, seed: int, overlaps: Rows | None = None) -> Folds | str:
    """Draw stratified random folds: sizes differ by at most one recording, in all and within each class.

    Windows that share samples are drawn together, as the first of them, unless all of their class do.
    """
    several, untested = _with_several_rows(y)
    if len(several) < 2:
        return _TOO_FEW
    unit_of = np.arange(len(y))
    if overlaps is not None:
        ones = np.ones(len(overlaps), dtype=np.bool_)
        linked = coo_array((ones, overlaps.T), (len(y), len(y)))
        _, first, part_of = np.unique(
            connected_components(linked, directed=False)[1], return_index=True, return_inverse=True
        )
        for own in several:
            if np.unique(part_of[own]).size > 1:
                unit_of[own] = first[part_of[own]]
    units = [np.unique(unit_of[own]) for own in several]
    n_used = min(n_folds, max(own.size for own in units))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, n_used)))
    # Dealt like cards, class after class: no fold gets two of a class before each other has one.
    dealt = np.concatenate([rng.permutation(own) for own in units])
    fold_of_unit = np.full(len(y), -1, dtype=np.intp)
    fold_of_unit[dealt] = np.arange(dealt.size) % n_used
    fold_of = fold_of_unit[unit_of]
    folds = tuple(
        Fold(np.flatnonzero(fold_of != j), np.flatnonzero(fold_of == j), f"fold {j + 1} of {n_used}")
        for j in range(n_used)
    )
    return Folds(RANDOM, folds, (f"{n_used} random folds, seed {seed}",), untested, seed)


def _with_several_rows(y: NDArray[Any]) -> tuple[list[Rows], dict[str, str]]:
    """Return the rows of each material that has several, and why the others, whose one recording trains, have none."""
    of_class = rows_of_class(y)
    several = [own for own in of_class.values() if own.size > 1]
    return several, {label: "one recording" for label, own in of_class.items() if own.size == 1}


def _condition_folds(data: Dataset, name: str, values: NDArray[np.object_]) -> Folds:
    """Hold out one value of a condition after the other; a material without another value is not tested there."""
    y, folds, notes = data.y, [], []
    for value in dict.fromkeys(values.tolist()):
        held = values == value
        tested = held & np.isin(y, y[~held])
        if tested.any():
            folds.append(Fold(np.flatnonzero(~held), np.flatnonzero(tested), str(value)))
        lost = np.unique(y[held & ~tested]).tolist()
        if lost:
            notes.append(
                f"{name} {value!r}: {listed(lost)} {verb(len(lost), 'has', 'have')} no other value to train on, and "
                f"{verb(len(lost), 'is', 'are')} not tested there"
            )
    known = set(data.sessions.tolist()) - {None}
    both = [session for session in known if len(set(values[data.sessions == session])) > 1]
    if both:
        notes.append(
            f"{counted(len(both), 'session')} {verb(len(both), 'has', 'have')} several values of {name}: what "
            "recordings of a session share is on both sides"
        )
    elif name != SESSION and known:
        notes.append(f"each session has one {name}: a loss may be that of other sessions")
    tested_at_all = set(y[np.concatenate([fold.test for fold in folds])].tolist())
    untested = {
        label: f"no other {name} to train on" for label in rows_of_class(y) if label not in tested_at_all
    }
    return Folds(name, tuple(folds), (f"{name}: {len(folds)} values, held out one by one", *notes), untested)


def paper_folds(
    data: Dataset, n_partitions: int = 20, train_per_class: int = 50, test_per_class: int = 12, seed: int = 0
) -> Folds:
    """Draw random partitions with the same number of recordings of each class, by default those of the paper.

    Partition ``j`` depends on `seed` and ``j`` alone: asking for more partitions keeps the earlier ones. Source:
    Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606, section "Evaluation".
    """
    n_partitions = whole_number("n_partitions", n_partitions)
    train_per_class = whole_number("train_per_class", train_per_class)
    wanted = train_per_class + whole_number("test_per_class", test_per_class)
    of_class = rows_of_class(data.y)
    label, fewest = min(of_class.items(), key=lambda item: item[1].size)
    if fewest.size < wanted:
        needs = f"{wanted}: {train_per_class} to train, {test_per_class} to test"
        fits = max(1, round(fewest.size * train_per_class / wanted))
        counts = n_partitions, fits, int(fewest.size - fits)
        hint = f"; pass paper={counts} (--paper {','.join(map(str, counts))})" * (fewest.size > fits)
        raise GranularIdError(f"class {label!r} has {counted(fewest.size)}, wanted {needs}{hint}")
    folds = []
    for j in range(n_partitions):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(j,)))
        drawn = [rng.permutation(rows)[:wanted] for rows in of_class.values()]
        train = np.sort(np.concatenate([rows[:train_per_class] for rows in drawn]))
        test = np.sort(np.concatenate([rows[train_per_class:] for rows in drawn]))
        folds.append(Fold(train, test, f"partition {j + 1}"))
    note = (
        f"random: {train_per_class} recordings of each class train, {test_per_class} are tested, seed {seed}"
    )
    partitions = Folds(PAPER, tuple(folds), (note,), seed=seed)
    return _without_shared_samples(partitions, data.y, _overlaps(data))


# Windows of one recording that share samples.


def _without_shared_samples(drawn: Folds, y: NDArray[np.str_], pairs: Rows | None) -> Folds:
    """Leave windows out of the training that share samples with tested ones."""
    if pairs is None:
        return drawn
    apart, left_out = [], set[int]()
    for fold in drawn:
        train = _clear_of(fold.test, fold.train, pairs)
        lost = np.setdiff1d(y[fold.train], y[train]).tolist()
        if lost:
            raise GranularIdError(
                f"all windows of {listed(lost)} share samples with tested ones, and none is left to train on: cut "
                "windows that do not overlap, or hold out whole recordings (by='session')"
            )
        left_out.update(np.setdiff1d(fold.train, train).tolist())
        apart.append(fold._replace(train=train))
    note = f"{counted(len(left_out), 'window')} that share samples with tested ones do not train"
    notes = (*drawn.notes, note) if left_out else drawn.notes
    return replace(drawn, folds=tuple(apart), notes=notes, overlapping=True)


def _overlaps(data: Dataset) -> Rows | None:
    pairs = list(overlapping_windows(data.recordings))
    return np.array(pairs, dtype=np.intp) if pairs else None


def _clear_of(test: Rows, train: Rows, pairs: Rows) -> Rows:
    """Return the rows of `train` that are in no pair with a tested one."""
    return np.setdiff1d(train, pairs[np.isin(pairs, test)[:, ::-1]])


# Folds of training rows, for estimators that choose by holding rows out.


class ChoiceFolds(NamedTuple):
    """Folds (train, test) that make a choice, what they hold out, and the same with numbers and reasons as a line."""

    folds: tuple[tuple[Rows, Rows], ...]
    held_out: str
    note: str


SESSIONS, BLOCKS, RANDOMLY, CONDITIONS = "sessions", "blocks in order", "random recordings", "conditions"
"""What a fold that chooses holds out."""

NONE = "nothing"


def choice_folds(
    codes: Rows, groups: Groups, *, n_folds: Any, seed: int, copies: Rows | None = None
) -> ChoiceFolds:
    """Split training rows, with the class and the groups of each, into folds that make a choice.

    The rule of `hold_out`: whole conditions, or sessions, where half of the classes have two; else halves in order;
    else random folds, drawn anew until 500 rows were held out, at most 10 times. The single row of a class always
    trains. Rows that share samples with a tested one, or its number in `copies`, do not train. A fold that leaves a
    class nothing to train on is none, and where fewer than two classes have two rows there are no folds.
    """
    drawn, folds = _drawn_to_choose(codes, groups, whole_number("n_folds", n_folds, least=2), seed), []
    for train, test in drawn.folds:
        clear = train if groups.overlaps is None else _clear_of(test, train, groups.overlaps)
        if copies is not None:
            clear = clear[~np.isin(copies[clear], copies[test])]
        if np.unique(codes[clear]).size == np.unique(codes).size:
            folds.append((clear, test))
    if drawn.folds and not folds:
        return ChoiceFolds((), NONE, "no folds: what would train shares samples with what would be held out")
    return drawn._replace(folds=tuple(folds))


def _drawn_to_choose(y: Rows, groups: Groups, wanted: int, seed: int) -> ChoiceFolds:
    counts, why = np.bincount(y), ""
    if np.count_nonzero(counts > 1) < 2:
        return ChoiceFolds((), NONE, "no folds: fewer than two classes have more than one recording")
    for names, what in ((groups.conditions, CONDITIONS), (groups.sessions, SESSIONS)):
        if names is None:
            continue
        drawn, why = _most_by_session(y, names, wanted)
        if drawn is not None and not why:
            return ChoiceFolds(_pairs(drawn), what, f"{len(drawn)} folds of whole {what}")
        why = why if drawn is None else "fewer than half of the classes have several sessions"
    halves = _time_folds(y, groups)
    if isinstance(halves, Folds):
        note = f"the first and the second half of each class in order ({why})"
        return ChoiceFolds(_pairs(halves), BLOCKS, note)
    n_used = min(wanted, int(counts.max()))
    repeats = min(_MOST_REPEATS, -(-_ENOUGH_ROWS // len(y)))
    seeds = np.random.SeedSequence(seed, spawn_key=(7,)).generate_state(repeats).tolist()
    folds = tuple(pair for draw in seeds for pair in _pairs(_random_folds(y, n_used, draw, groups.overlaps)))
    times = f", drawn {repeats} times" if repeats > 1 else ""
    return ChoiceFolds(folds, RANDOMLY, f"{n_used} random folds{times} ({why}, and no order)")


def _pairs(drawn: Folds | str) -> tuple[tuple[Rows, Rows], ...]:
    return () if isinstance(drawn, str) else tuple((fold.train, fold.test) for fold in drawn)


def _checked_names(name: str, given: Any, n_rows: int) -> NDArray[np.object_]:
    """Return the session, or group, of each row as text; None where it is not known."""
    known = np.full(n_rows, None, dtype=object)
    if given is not None:
        what = name.removesuffix("s")
        if isinstance(given, (str, bytes)) or not hasattr(given, "__len__"):
            raise TypeError(f"{name} must be a sequence with one {what} per row, got {given!r:.60}")
        if len(given) != n_rows:
            raise GranularIdError(f"{name} must name one {what} per row of X, {n_rows}, got {len(given)}")
        known[:] = [None if one is None or one != one else str(one) or None for one in list(given)]  # noqa: PLR0124 - NaN
    return known


def checked_groups(
    n_rows: int, sessions: Any = None, order: Any = None, conditions: Any = None, overlaps: Any = None
) -> Groups:
    """Check what comes with rows of features, each None where it is not known."""
    known, apart = _checked_names("sessions", sessions, n_rows), _checked_names("groups", conditions, n_rows)
    rank, pairs = None, None
    if order is not None:
        rows = np.asarray(order)
        each_once = rows.ndim == 1 and np.array_equal(np.sort(rows), np.arange(n_rows))
        if rows.dtype.kind not in "iu" or not each_once:
            wanted = (
                f"must hold the row numbers 0 to {n_rows - 1}, each once, from the earliest to the latest"
            )
            raise argument_error(GranularIdError, "order", wanted)
        rank = np.argsort(rows, kind="stable")
    if overlaps is not None:
        pairs = np.asarray(overlaps)
        in_pairs = pairs.ndim == 2 and pairs.shape[1] == 2 and np.isin(pairs, np.arange(n_rows)).all()
        if pairs.dtype.kind not in "iu" or not in_pairs:
            raise argument_error(
                GranularIdError, "overlaps", f"must hold pairs of row numbers, 0 to {n_rows - 1}"
            )
    return Groups(known, rank, "no order in time is known" if rank is None else "", apart, pairs)
