"""``select``: nested cross-validation, against scikit-learn pipelines fitted fold by fold."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.feature_selection import SelectKBest
from sklearn.pipeline import make_pipeline

from evaluation_cases import LABELS, changed, make_data
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.candidates import DEFAULT_SPACES, plan_candidates
from granular_id.evaluation.selection import select
from granular_id.identifier.metadata import SPACES as TRAINED
from granular_id.recording import Dataset
from granular_id.rica import RICA
from granular_id.spaces import HFMH, BlockUnion, PrincipalComponents, RawHFMH, RawSignal, Tare, feature_spaces
from granular_id.splits import nested_folds
from granular_id.synthetic import synthesize

COSTS = (0.1, 10.0)
SMALL = {"relative_costs": COSTS, "n_outer": 3, "n_inner": 2, "progress": False}


@pytest.fixture(scope="module")
def data():
    return changed(make_data(10), session=lambda r: f"day {int(r.name.split('_')[1]) // 2}")


SPACES = ["raw", "hfmh", "raw+hfmh", "pca", "raw-histogram"]


@pytest.fixture(scope="module")
def selection(data):
    return select(data, spaces=SPACES, **SMALL)


@pytest.fixture(scope="module")
def folds(data):
    return nested_folds(data, 3, 2, 0).nested


def accuracies_by_pipelines(transformer, data, partition):
    """Accuracy for each C, the transformer fitted on the features of the training rows themselves."""
    fitted = clone(transformer).fit(data.X[partition.train], data.y[partition.train])
    F, new = fitted.transform(data.X[partition.train]), fitted.transform(data.X[partition.test])
    spread = ((F - F.mean(axis=0)) ** 2).sum(axis=1).mean()
    return [
        ECOCClassifier(C=cost / spread).fit(F, data.y[partition.train]).score(new, data.y[partition.test])
        for cost in COSTS
    ]


def test_accuracies_are_those_of_pipelines_fitted_on_training_rows(data, selection, folds):
    names = ["raw", "hfmh", "raw+hfmh", "raw+hfmh (unit)", "pca", "raw-histogram"]
    assert [c.name for c in selection.candidates] == names
    for candidate in selection.candidates:
        want = [accuracies_by_pipelines(candidate.transformer, data, fold.outer) for fold in folds]
        assert candidate.accuracies.tolist() == want, candidate.name


def test_a_space_that_learns_from_labels_is_given_those_of_the_training_rows(data, folds):
    few = make_pipeline(RawSignal(), SelectKBest(k=5))
    (scored,) = select(data, spaces={"few": few}, **SMALL).candidates
    assert scored.accuracies.tolist() == [accuracies_by_pipelines(few, data, fold.outer) for fold in folds]


def test_each_outer_fold_is_judged_by_what_its_inner_folds_chose(data, folds):
    only = select(data, spaces="hfmh", **SMALL)
    decided = 0
    for fold, result in zip(folds, only.outer, strict=True):
        inner = np.mean([accuracies_by_pipelines(HFMH(), data, p) for p in fold.inner], axis=0).round(9)
        outer = accuracies_by_pipelines(HFMH(), data, fold.outer)
        decided += inner[0] != inner[1]
        assert result.choice.cost == int(np.argmax(inner))
        assert result.choice.accuracy == pytest.approx(inner.max())
        assert result.accuracy == outer[int(np.argmax(inner))]
        assert (result.n_train, result.n_test) == (fold.outer.train.size, fold.outer.test.size)
    assert decided
    assert only.accuracy == np.mean([fold.accuracy for fold in only.outer])
    # a single candidate has nobody to beat
    assert (only.comparison, only.runner_up) == (None, None)
    assert "There was no other candidate to compare with" in str(only)


def test_what_is_held_out_has_no_say_in_the_choice_it_judges(data, selection, folds):
    """Other samples in the rows of an outer fold change no inner accuracy of that fold."""
    rng = np.random.default_rng(1)
    tested = set(folds[1].outer.test.tolist())
    spoilt = Dataset(
        [
            replace(r, wrench=rng.normal(3, 2, r.wrench.shape)) if i in tested else r
            for i, r in enumerate(data)
        ]
    )
    again = select(spoilt, spaces=SPACES, **SMALL)
    assert again.outer[1].choice == selection.outer[1].choice
    assert again.outer[1].accuracy < selection.outer[1].accuracy
    assert again.outer[0] != selection.outer[0]


def test_model_is_the_chosen_pipeline_with_an_absolute_cost(data):
    selection = select(data, spaces={"both": RawHFMH()}, block_weights=["unit"], **SMALL)
    model = selection.model()
    features = RawHFMH(block_weights="unit").fit_transform(data.X)
    spread = ((features - features.mean(axis=0)) ** 2).sum(axis=1).mean()
    assert pytest.approx(COSTS[selection.final.cost] / spread) == selection.C
    assert model.get_params()["classifier__C"] == selection.C
    assert model.get_params()["features__block_weights"] == "unit"
    same = make_pipeline(RawHFMH(block_weights="unit"), ECOCClassifier(C=selection.C))
    predicted = model.fit(data.X, data.y).predict(data.X)
    assert predicted.tolist() == same.fit(data.X, data.y).predict(data.X).tolist()
    assert not hasattr(selection.model()[-1], "classes_")


def test_costs_beyond_a_hard_margin_are_not_computed_again_and_change_nothing(data, folds):
    selection = select(data, spaces="raw", **{**SMALL, "relative_costs": (1e3, 1e4, 1e5)})
    (raw,) = selection.candidates
    assert (raw.accuracies == raw.accuracies[:, :1]).all()
    F = RawSignal().fit_transform(data.X)
    for outer in (fold.outer for fold in folds):
        hard = ECOCClassifier(C=1e6).fit(F[outer.train], data.y[outer.train])
        assert hard.score(F[outer.test], data.y[outer.test]) == raw.accuracies[outer.index, 0]


def test_numbers_depend_on_neither_threads_nor_a_second_run(data, selection):
    assert select(data, spaces=SPACES, n_jobs=2, **SMALL).to_dict() == selection.to_dict()


def test_open_random_states_are_seeded_and_kept_in_the_model(data):
    spaces = {"permuted": feature_spaces()["time-permuted"]}
    first, second, other = (select(data, spaces=spaces, random_state=s, **SMALL) for s in (3, 3, 4))
    assert first.to_dict() == second.to_dict()
    assert first.to_dict()["settings"] != other.to_dict()["settings"]
    seeds = {k: v for k, v in first.model().get_params().items() if k.endswith("random_state")}
    assert any(isinstance(seed, int) for seed in seeds.values())


def test_a_weighting_replaces_that_of_a_space_and_leaves_single_blocks_alone(data):
    union = BlockUnion([("a", RawSignal()), ("b", HFMH())], block_weights="unit")
    spaces = {"union": union, "raw": RawSignal()}
    selection = select(data, spaces=spaces, block_weights=[None, (1, 0.5)], **SMALL)
    assert [c.name for c in selection.candidates] == ["union", "union (1, 0.5)", "raw"]
    assert [c.block_weights for c in selection.candidates] == [None, (1, 0.5), None]
    assert [c.n_features for c in selection.candidates] == [1080, 1080, 480]
    assert union.block_weights == "unit"


def test_tells_of_a_clear_case_and_of_a_toss_up():
    """Means tell these materials apart and the noise about them does not; two copies of a space are equal."""
    data = changed(make_data(12), session=lambda r: f"day {int(r.name.split('_')[1]) // 3}")
    rng = np.random.default_rng(5)
    level = {label: 0.3 * k for k, label in enumerate(LABELS)}
    clear = Dataset([replace(r, wrench=level[r.label] + rng.normal(0, 1, (60, 6))) for r in data])
    selection = select(clear, spaces=["hfmh", "raw"], **{**SMALL, "n_outer": 4})
    assert selection.best.space == "raw"
    assert selection.agreement == 1.0
    assert selection.runner_up.better > 0.95
    assert "Against the best other, hfmh: it is better (>99 % better" in str(selection)
    twins = select(clear, spaces={"one": RawSignal(), "two": RawSignal()}, **SMALL)
    assert twins.best.space == "one"
    assert twins.runner_up.equivalent == 1.0
    assert "the two are equal" in str(twins)


def test_str_says_what_to_take_what_to_expect_and_how_it_is_known(selection):
    text, name = str(selection), selection.best.name
    low, high = (f"{100 * end:.1f}" for end in selection.interval)
    for words in (
        f"Take {name} with C = {selection.C:.3g}",
        f"Expect {100 * selection.accuracy:.1f} % (95 % interval {low} to {high} %)",
        "in a session that did not train; chance is 25.0 %",
        f"Agreement: {selection.votes[name]} of 3 outer folds",
        "outer folds (judge the choice): 3 folds of whole sessions",
        "inner folds (make the choice): 2 folds of whole sessions",
    ):
        assert words in text
    rows = selection.table().rows
    assert [row[0] for row in rows if row[0].startswith("> ")] == [f"> {name}"]
    shares = [float(row[2].split()[0]) for row in rows]
    assert shares == sorted(shares, reverse=True)
    assert repr(selection).startswith(f"Selection({name}, C=")


@pytest.fixture(scope="module")
def two(data):
    return select(data, spaces=["raw", "hfmh"], **{**SMALL, "relative_costs": (1.0,), "n_outer": 5})


@pytest.mark.parametrize(
    ("gains", "words"),
    [
        ((0.10, 0.11, 0.09, 0.10, 0.12), "it is better (>99 % better"),
        ((0.001, -0.001, 0.0, 0.001, 0.0), "the two are equal"),
        ((0.010, 0.012, 0.008, 0.011, 0.010), "it is not worse"),
        ((-0.010, -0.012, -0.008, -0.011, -0.010), "it is not better, and taken as the simpler one"),
        ((0.10, -0.10, 0.05, -0.05, 0.02), "these recordings do not tell which is better"),
        ((0.02, 0.02, 0.02, 0.02, 0.02), "the same difference in every partition"),
    ],
)
def test_words_follow_the_probabilities(two, gains, words):
    other, best = np.array([0.7, 0.8, 0.75, 0.72, 0.81]), np.add((0.7, 0.8, 0.75, 0.72, 0.81), gains)
    raw, hfmh = (
        replace(candidate, accuracies=shares[:, np.newaxis])
        for candidate, shares in zip(two.candidates, (best, other), strict=True)
    )
    told = replace(two, candidates=(raw, hfmh), final=replace(two.final, candidate=0))
    assert words in told.verdict()


def test_votes_for_others_are_named(two):
    votes = [replace(fold, choice=replace(fold.choice, candidate=1)) for fold in two.outer]
    told = replace(two, outer=tuple(votes), final=replace(two.final, candidate=0))
    n = len(votes)
    assert f"Agreement: 0 of {n} outer folds chose the same" in told.verdict()
    assert f"; others chose hfmh {n}" in told.verdict()


def test_two_outer_folds_give_no_probability_and_no_interval(data):
    selection = select(data, spaces=["raw", "hfmh"], **{**SMALL, "n_outer": 2})
    assert all(map(math.isnan, selection.interval))
    assert math.isnan(selection.runner_up.better)
    assert "two partitions: too few for p-values" in str(selection)
    assert "(no interval: too few folds) in a session that did not train" in str(selection)
    assert selection.to_dict()["interval"] is None


def test_json_holds_every_figure(selection, tmp_path):
    selection.to_json(tmp_path / "selection.json")
    content = json.loads((tmp_path / "selection.json").read_text(encoding="utf-8"))
    assert content == selection.to_dict()
    chosen = next(c for c in content["candidates"] if c["name"] == selection.best.name)
    assert np.mean(chosen["accuracies"], axis=0).max() == pytest.approx(selection.final.accuracy)
    assert np.mean([fold["accuracy"] for fold in content["outer"]]) == pytest.approx(content["accuracy"])
    assert content["held_out"] == "sessions"
    assert content["settings"]["seed"] == 0


def test_default_candidates_are_those_that_train_takes(data):
    assert set(DEFAULT_SPACES) == set(TRAINED)
    candidates = plan_candidates(None, [None], data.rate_hz, 0)
    assert all(candidate.live for candidate in candidates)


def test_a_space_that_cannot_run_live_is_marked_and_another_is_trained(selection):
    live = {row[0].strip("> "): row[-1] for row in selection.table().rows}
    assert live["pca"] == live["raw-histogram"] == "no"
    assert live["raw+hfmh (unit)"] == "yes"
    pca = next(k for k, candidate in enumerate(selection.candidates) if candidate.name == "pca")
    chosen = replace(selection, final=replace(selection.final, candidate=pca))
    assert "pca cannot run live: its features need the whole recording; of those" in chosen.verdict()
    assert selection.to_train.space in {"raw", "hfmh", "raw+hfmh"}


def test_nothing_is_trained_where_no_candidate_runs_live(data):
    alone = select(data, spaces=["raw-histogram"], **SMALL)
    assert alone.to_train is None
    assert "nor can the other candidates" in alone.verdict()


def test_rotations_are_equal_candidates_and_synthetic_recordings_are_called_so():
    data = synthesize(["rice", "dry peas"], n_per_class=4, rate_hz=100.0, duration_s=0.6, sessions=4)
    small = {**SMALL, "relative_costs": (10.0,), "n_outer": 2}
    rotated = select(data, spaces=["raw", "dft", "raw+dft"], block_weights=[None], **small)
    assert len({tuple(c.accuracies.ravel()) for c in rotated.candidates}) == 1
    assert str(rotated).startswith("SYNTHETIC recordings: this choice says nothing about real materials")
    assert "Candidates (SYNTHETIC recordings)" in str(rotated)


def test_progress_counts_every_candidate_on_every_fold(data):
    seen = []
    select(data, spaces=["raw", "hfmh"], **{**SMALL, "progress": lambda *step: seen.append(step)})
    assert [done for done, _, _ in seen] == list(range(1, 3 * (1 + 2) * 2 + 1))
    assert {total for _, total, _ in seen} == {18}
    assert seen[0][2].startswith("raw: 2 sessions: day 0, ...")


def test_solvers_that_stop_early_are_a_note_and_errors_name_their_space(data):
    early = make_pipeline(RawSignal(), PrincipalComponents(4), RICA(2, max_iter=2))
    selection = select(data, spaces={"early": early}, n_jobs=2, **SMALL)
    (note,) = [note for note in selection.notes if "RICA" in note]
    assert note.startswith("early: ")
    tare = make_pipeline(Tare(tare_s=10.0), RawSignal())
    with pytest.raises(ValueError, match=r"^feature space 'late': tare_s"):
        select(data, spaces={"late": tare}, **SMALL)


def test_an_interrupt_ends_it(data):
    def interrupt(done, total, what):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        select(data, spaces="raw", n_jobs=2, **{**SMALL, "progress": interrupt})
