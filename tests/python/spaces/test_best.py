"""The classifier that chooses its preparation: against the same done by hand, and where nothing can be chosen."""

import json
import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import parametrize_with_checks

from granular_id.ecoc import ECOCClassifier
from granular_id.spaces import BlockScaler, WithinClassWhitening
from granular_id.spaces.best import BestClassifier, choose, fitted_lines, held_out_scores, plan_candidates
from granular_id.splits import checked_groups, choice_folds, groups_of
from granular_id.synthetic import synthesize

FEW = {"shrinkages": [1e-3], "n_folds": 2}


@parametrize_with_checks([BestClassifier(**FEW)])
def test_sklearn_contract_holds(estimator, check):
    check(estimator)


def drifting(n=60, n_classes=3, seed=0):
    """Two blocks that tell classes apart beside a drift of each session, and one whose level is the session's."""
    rng = np.random.default_rng(seed)
    y = np.arange(n) % n_classes
    sessions = np.arange(n) * 4 // n
    left = rng.normal(size=(n, 10)) + y[:, None] * np.linspace(0, 0.8, 10)
    right = rng.normal(size=(n, 40)) + np.outer(y, rng.normal(size=40)) * 0.4
    right += rng.normal(size=(4, 40))[sessions] * 2
    level = 5.0 * rng.normal(size=(4, n_classes))[sessions, y][:, None] + rng.normal(size=(n, 4)) * 0.1
    names = np.array(["oat", "rice", "salt", "tea"])[y]
    return np.hstack([left, right, level]), names, [f"day {s}" for s in sessions]


BLOCKS = {"left": 10, "right": 40, "level": 4}
SPANS = {"left": (0, 10), "right": (10, 50), "level": (50, 54)}


def by_hand(X, y, blocks, shrinkage, relative_cost):
    own = np.concatenate([np.arange(*bounds) for name, bounds in SPANS.items() if name in blocks])
    scaler = BlockScaler({name: BLOCKS[name] for name in blocks}).fit(X[:, own])
    rows = scaler.transform(X[:, own])
    steps = [] if shrinkage is None else [WithinClassWhitening(shrinkage)]
    seen = steps[0].fit_transform(rows, y) if steps else rows
    spread = ((seen - seen.mean(axis=0)) ** 2).sum(axis=1).mean()
    pipeline = make_pipeline(scaler, *steps, ECOCClassifier(C=relative_cost / spread))
    return pipeline.fit(X[:, own], y), own


@pytest.fixture(scope="module")
def rows():
    X, y, sessions = drifting()
    return X, y, np.unique(y, return_inverse=True)[1], sessions


@pytest.fixture(scope="module")
def chosen(rows):
    """Chosen from 12 machines on 4 sessions."""
    X, y, _, sessions = rows
    return BestClassifier(blocks=BLOCKS, optional_blocks=["level"]).fit(X, y, sessions=sessions)


def test_each_machine_equals_its_pipeline(rows):
    X, y, codes, _ = rows
    train, test = np.arange(0, 40), np.arange(40, 60)
    machines = plan_candidates(list(BLOCKS), ["level"], [None, 1e-2], [1.0, 10.0])
    assert len(machines) == 8
    scores = held_out_scores(X, codes, BLOCKS, machines, train, test)
    lines = fitted_lines(X[train], codes[train], BLOCKS, machines, range(8))
    for machine, own_scores, (coef, intercept) in zip(machines, scores, lines, strict=True):
        what = machine.blocks, machine.shrinkage, machine.relative_cost
        pipeline, own = by_hand(X[train], y[train], *what)
        expected = pipeline[-1].binary_scores(pipeline[:-1].transform(X[test][:, own]))
        np.testing.assert_allclose(own_scores, expected, atol=1e-3, err_msg=machine.name)
        np.testing.assert_allclose(X[test] @ coef.T + intercept, expected, atol=1e-3)


def test_the_model_is_the_mean_of_the_chosen(rows, chosen):
    X, y, codes, _ = rows
    choice = chosen.choice_
    assert choice.chosen == choose(choice.machines, choice.leads)
    assert choice.chosen[0] == 0
    assert choice.machines[0].name == "without level, whitened 0.03, C 1"
    lines = fitted_lines(X, codes, BLOCKS, choice.machines, choice.chosen)
    np.testing.assert_allclose(chosen.coef_, np.mean([coef for coef, _ in lines], axis=0))
    np.testing.assert_allclose(chosen.intercept_, np.mean([intercept for _, intercept in lines], axis=0))
    np.testing.assert_allclose(chosen.binary_scores(X), X @ chosen.coef_.T + chosen.intercept_)
    twin = ECOCClassifier(loss="root").fit(X, y)
    twin.coef_, twin.intercept_ = chosen.coef_, chosen.intercept_
    np.testing.assert_array_equal(chosen.predict(X), twin.predict(X))
    np.testing.assert_allclose(chosen.decision_function(X), twin.decision_function(X))
    np.testing.assert_array_equal(chosen.coding_matrix_, twin.coding_matrix_)


PLAIN = plan_candidates(["a"], [], [0.1, None, 0.01], [1.0])
OPTIONAL = plan_candidates(["a", "level"], ["level"], [None], [1.0])  # without, and with


@pytest.mark.parametrize(
    ("candidates", "leads", "chosen"),
    [
        (PLAIN, [[0.5, 0.6, 0.9], [0.5, 0.7, 0.3]], (0, 1)),
        (PLAIN, [[0.8, 0.6, 0.7]], (0,)),
        (PLAIN, [[1.0, 1.0, 1.0]], (0,)),
        (PLAIN, np.empty((0, 3)), (0,)),
        # an optional block must gain in every fold
        (OPTIONAL, [[0.5, 0.9], [0.5, 0.9], [0.5, 0.5]], (0,)),
        (OPTIONAL, [[0.5, 0.9], [0.5, 0.9], [0.5, 0.6]], (0, 1)),
    ],
)
def test_choose_takes_the_first_and_the_best(candidates, leads, chosen):
    assert choose(candidates, np.array(leads)) == chosen


def test_leads_grade_the_accuracy():
    X, y, sessions = drifting(120)
    choice = BestClassifier(blocks=BLOCKS, optional_blocks=["level"]).fit(X, y, sessions=sessions).choice_
    assert np.corrcoef(choice.accuracies.ravel(), choice.leads.ravel())[0, 1] > 0.9
    apart = np.repeat(np.eye(3), 4, axis=0) + 1e-3 * X[:12, :3]
    easy = BestClassifier(shrinkages=[None, 1e-3]).fit(apart, np.repeat(["a", "b", "c"], 4))
    np.testing.assert_array_equal(easy.choice_.leads, 1.0)


def test_best_with_sessions_leaves_a_block_of_the_session_out():
    X, y, sessions = drifting(600)
    clf = BestClassifier(blocks=BLOCKS, optional_blocks=["level"], shrinkages=[None], relative_costs=[1.0])
    strict = clf.fit(X, y, sessions=sessions)
    assert strict.choice_.held_out == "sessions"
    assert not strict.coef_[:, 50:].any()
    X[:, 50:] = 3.0 * np.unique(y, return_inverse=True)[1][:, None] + np.random.default_rng(0).normal(
        size=(600, 4)
    )
    assert clone(clf).fit(X, y, sessions=sessions).coef_[:, 50:].any()


@pytest.mark.parametrize("known", [{}, {"order": np.arange(60)}, {"sessions": ["day 1"] * 60}])
def test_best_without_sessions_leaves_optional_blocks_out(rows, known):
    """Within a session nothing shows that a zero moves from one to the next, and the level alone tells classes."""
    _, y, codes, _ = rows
    X = np.random.default_rng(0).normal(size=(60, 54))
    X[:, 50:] += 9.0 * codes[:, np.newaxis]
    best = BestClassifier(blocks=BLOCKS, optional_blocks=["level"], **FEW).fit(X, y, **known)
    assert not best.coef_[:, 50:].any()


@pytest.mark.parametrize("order", [None, np.arange(60)])
def test_rows_that_share_samples_are_on_one_side(order):
    couples = np.array([(k, k + 2) for k in range(60) if k % 4 < 2])
    known = checked_groups(60, order=order, overlaps=couples)
    folds = choice_folds(np.arange(60) % 2, known, n_folds=3, seed=0).folds
    assert folds
    for train, test in folds:
        sides = np.isin(couples, train), np.isin(couples, test)
        assert not (sides[0] & sides[1][:, ::-1]).any()


def test_a_pipeline_passes_on_which_windows_overlap():
    data = synthesize(
        ["rice", "oat flakes"], n_per_class=4, sessions=1, duration_s=2.0, rate_hz=100.0
    ).windows(1.0, 0.5)
    groups = groups_of(data)
    assert len(groups.overlaps) == 16
    assert groups.take(np.array([0, 1, 5])).overlaps.tolist() == [[0, 1]]
    assert "overlaps" in groups.fit_arguments(BestClassifier())


def test_copies_of_a_row_are_on_one_side(rows):
    X, y, codes, _ = rows
    twice, copies = np.tile(codes, 2), np.tile(np.arange(60), 2)
    for known in (checked_groups(120, None, None), checked_groups(120, None, np.arange(120))):
        folds = choice_folds(twice, known, n_folds=3, seed=0, copies=copies).folds
        for train, test in folds:
            assert not set(copies[train]) & set(copies[test])
    assert (
        BestClassifier().fit(np.tile(X, (2, 1)), np.tile(y, 2), order=np.arange(120)).choice_.held_out
        == "nothing"
    )


def test_best_fitted_again_or_pickled_gives_the_same_numbers(rows):
    X, y, _, _ = rows
    one, two, other = (
        BestClassifier(blocks=BLOCKS, **FEW, **how).fit(X, y) for how in ({}, {}, {"random_state": 1})
    )
    for name in ("coef_", "intercept_"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert one.choice_.to_dict() == two.choice_.to_dict()
    assert not np.array_equal(other.choice_.leads, one.choice_.leads)
    copy = pickle.loads(pickle.dumps(one))
    np.testing.assert_array_equal(copy.predict(X), one.predict(X))


def test_folds_are_the_strictest_that_there_are():
    def folds_of(codes, sessions, order, n_folds):
        return choice_folds(codes, checked_groups(len(codes), sessions, order), n_folds=n_folds, seed=0)

    codes = np.arange(40) % 2
    sessions = np.arange(40) // 10
    folds = folds_of(codes, sessions, None, 3)
    assert (folds.held_out, len(folds.folds)) == ("sessions", 3)
    for train, test in folds.folds:
        assert not set(sessions[train]) & set(sessions[test])
    in_time = folds_of(codes, None, np.arange(40)[::-1], 4)
    assert in_time.held_out == "blocks in order"
    assert [test.tolist() for _, test in in_time.folds] == [list(range(20)), list(range(20, 40))]
    one_session = folds_of(codes, ["a"] * 40, np.arange(40), 4)
    assert "fewer than two materials have several sessions" in one_session.note
    drawn = folds_of(codes, None, None, 4)
    assert "drawn 10 times" in drawn.note
    assert len(drawn.folds) == 40
    assert len(folds_of(np.arange(600) % 2, None, None, 4).folds) == 4


def test_classes_with_one_recording_always_train(rows):
    X, y = rows[0], rows[1].astype(object)
    y[7] = "lonely"
    clf = BestClassifier(blocks=BLOCKS, **FEW).fit(X, y)
    assert "lonely" in clf.classes_


def test_where_nothing_can_be_held_out_the_first_is_taken(rows):
    X = rows[0][:3]
    clf = BestClassifier(blocks=BLOCKS).fit(X, ["a", "b", "c"])
    assert clf.choice_.held_out == "nothing"
    assert clf.choice_.chosen == (0,)
    assert np.isnan(clf.choice_.accuracy)
    assert "no folds: fewer than two classes" in str(clf.choice_)
    json.dumps(clf.choice_.to_dict(), allow_nan=False)
    assert clf.predict(X).tolist() == ["a", "b", "c"]
    two = BestClassifier().fit([[0.0], [1.0]], [0, 1])
    assert two.predict([[0.1], [0.9]]).tolist() == [0, 1]
    assert two.decision_function([[0.1], [0.9]]).shape == (2,)


def test_one_machine_leaves_nothing_to_choose(rows):
    X, y, codes, sessions = rows
    clf = BestClassifier(blocks=BLOCKS, shrinkages=[1e-3], relative_costs=[10.0]).fit(X, y, sessions=sessions)
    ((coef, intercept),) = fitted_lines(X, codes, BLOCKS, clf.choice_.machines, [0])
    np.testing.assert_array_equal(clf.coef_, coef)
    np.testing.assert_array_equal(clf.intercept_, intercept)
    assert (clf.choice_.held_out, clf.choice_.chosen) == ("nothing", (0,))


BAD = [
    ({"blocks": {"left": 3}}, ValueError, "blocks must add up to the 54 columns"),
    ({"blocks": BLOCKS, "optional_blocks": ["levels"]}, ValueError, "got 'levels'"),
    ({"blocks": BLOCKS, "optional_blocks": list(BLOCKS)}, ValueError, "leave a block that always stays"),
    ({"shrinkages": []}, ValueError, "shrinkages must hold at least one"),
    ({"shrinkages": [0.1, 0.1]}, ValueError, "shrinkages must hold each once"),
    ({"relative_costs": [-1.0]}, ValueError, "relative_costs must be positive"),
    ({"loss": "quadratic"}, ValueError, "loss"),
    ({"n_folds": 1}, ValueError, "n_folds must be at least 2"),
    ({"sessions": ["a"]}, ValueError, "sessions must name one session per row of X, 60, got 1"),
    ({"order": [0] * 60}, ValueError, "order must hold the row numbers 0 to 59"),
    ({"overlaps": [[0, 60]]}, ValueError, "overlaps must hold pairs of row numbers, 0 to 59"),
]


@pytest.mark.parametrize(("arguments", "kind", "message"), BAD)
def test_bad_parameters_sessions_and_orders_are_named(rows, arguments, kind, message):
    X, y, _, _ = rows
    of_rows = {name: value for name, value in arguments.items() if name in ("sessions", "order", "overlaps")}
    parameters = {name: value for name, value in arguments.items() if name not in of_rows}
    with pytest.raises(kind, match=message):
        BestClassifier(**parameters).fit(X, y, **of_rows)
