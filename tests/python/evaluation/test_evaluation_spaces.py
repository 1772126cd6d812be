"""Feature spaces through evaluate: seeded, alike for any number of threads, chosen, adapted; what did not converge."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import make_pipeline

from cli_cases import written
from evaluation_cases import LABELS, QUIET, TOOLS, with_tools
from granular_id._estimators import convergence_warnings
from granular_id.evaluation import choice_tables, evaluate
from granular_id.recording import Dataset, Recording
from granular_id.rica import RICA
from granular_id.spaces import BestClassifier, FeatureSpace, RawSignal, all_spaces, feature_spaces
from multiband_cases import louder

SPACES = {name: feature_spaces()[name] for name in (*all_spaces(feature_spaces()), "time-permuted")}
PCA_RICA = make_pipeline(RawSignal(), PCA(8), RICA(4, max_iter=30))
PAPER = {"paper": (2, 6, 3), **QUIET}


def test_every_space_is_the_same_for_any_number_of_threads(data):
    result = evaluate(data, SPACES, **PAPER)
    assert {name: held.accuracy for name, held in result.held.items() if not 0.25 < held.accuracy < 1} == {}
    two = evaluate(data, SPACES, n_jobs=2, **PAPER)
    assert list(two.predictions()) == list(result.predictions())


def test_open_seeds_after_components_are_set_by_partition(data, monkeypatch):
    seeds = []
    original = RICA.fit

    def recorded(self, X, y=None):
        seeds.append(self.random_state)
        return original(self, X, y)

    monkeypatch.setattr(RICA, "fit", recorded)
    for seed in (0, 1):
        evaluate(data, {"pca+rica": PCA_RICA}, random_state=seed, **PAPER)
    assert len(set(seeds)) == 4
    assert None not in seeds


def test_components_are_lowered_in_a_copy(data):
    own = make_pipeline(RawSignal(rate_hz=500.0), PCA(100))
    result = evaluate(data, {"mine": own}, **PAPER)
    assert "mine: 23 components, as 24 recordings train" in result.notes
    assert own[-1].n_components == 100


def test_solvers_that_stop_early_are_a_note(data):
    early = {"few": make_pipeline(RawSignal(), PCA(8), RICA(4, max_iter=2))}
    (note,) = [note for note in evaluate(data, early, **PAPER).notes if note.startswith("few:")]
    assert "RICA" in note
    assert note.endswith("(2 times)")


def test_convergence_warnings_are_counted_and_others_pass():
    def complain():
        with convergence_warnings("raw") as lines:
            for k in range(6):
                warnings.warn(f"learner {k % 5}", ConvergenceWarning, stacklevel=1)
            warnings.warn("other", UserWarning, stacklevel=1)
        return lines

    with pytest.warns(UserWarning, match="other") as passed:
        lines = complain()
    assert len(passed) == 1
    counted = ["raw: learner 0 (2 times)", "raw: learner 1", "raw: learner 2"]
    assert lines == [*counted, "raw: 2 other warnings of this kind"]


def test_choices_on_training_sessions_are_written_and_shown(tmp_path):
    data = Dataset(
        [
            Recording(wrench, 500.0, label=str(label), session=f"day {number % 3}", name=f"{number:02d}")
            for number, (wrench, label) in enumerate(zip(*louder(), strict=True))
        ]
    )
    result = evaluate(data, ["best", "multiband"], **QUIET)
    result.to_json(tmp_path / "result.json")
    saved = written(tmp_path / "result.json")["spaces"]
    assert saved["multiband"]["chosen"] == []  # one model, and no choice
    of_each = result.chosen["best"]
    assert [tuple(one["chosen"]) for one in saved["best"]["chosen"]] == [one.names for one in of_each]
    assert {one.note for one in of_each} == {"2 folds of whole sessions"}  # of three, one of which is tested
    (table,) = choice_tables(result)
    for k, row in enumerate(table.rows):
        assert row[0] == f"{k + 1} {of_each[0].machines[k].name}"
        assert row[1] == f"{sum(k in one.chosen for one in of_each)} of 3"
    assert str(table) in result.details()
    # a fold without sessions to hold out tries fewer candidates
    few = BestClassifier(blocks={"own": 9, "level": 1}, optional_blocks=["level"])
    few.fit(data.X[:, :10, 0], data.y)
    mixed = replace(result, chosen={"best": (few.choice_, *of_each[:2])})
    assert [row[0] for row in choice_tables(mixed)[0].rows] == [row[0] for row in table.rows]


def own_space(**settings):
    return FeatureSpace("own", RawSignal(), None, classifier=BestClassifier(shrinkages=[None], **settings))


@pytest.fixture(scope="module")
def enough():
    """Eight recordings of each material with each tool."""
    data = with_tools()
    return Dataset([*data, *(replace(r, name=f"{r.name} again", wrench=r.wrench + 0.1) for r in data)])


def test_adapted_accuracy_never_tests_a_recording_that_it_saw(enough, monkeypatch):
    """Each model sees one half of what is held out and names the other; the halves take turns."""
    adapted = []

    class Spy:
        def __init__(self, seen):
            self.seen = seen

        def predict(self, X):
            adapted.append((self.seen, X))
            return np.full(len(X), LABELS[0])

    name = "granular_id.evaluation.evaluating.adapted_classifier"
    monkeypatch.setattr(name, lambda fitted, X, y, new: Spy(new))
    spaces = {"raw": RawSignal(), "own": own_space(relative_costs=(1.0,))}
    result = evaluate(enough, spaces, by="tool", accept="duplicates", **QUIET)
    assert len(adapted) == 2 * len(TOOLS)
    for seen, new in adapted:
        assert not {row.tobytes() for row in seen} & {row.tobytes() for row in new}
        assert len(seen) + len(new) == 32
    assert set(result.adapted) == {"own"}
    assert result.to_dict()["spaces"]["own"]["adapted"] == [0.25] * 3


def test_adapted_accuracies_stand_in_the_details(enough):
    result = evaluate(enough, {"own": own_space()}, by="tool", accept="duplicates", **QUIET)
    assert result.adapted["own"].shape == (3,)
    assert {one.note for one in result.chosen["own"]} == {"2 folds of whole conditions"}
    assert "adapted: to half of the held-out recordings" in result.details()


def test_nothing_is_declared_of_few_recordings(enough):
    few = Dataset(list(enough)[:48])
    result = evaluate(few, {"own": own_space(relative_costs=(1.0,))}, by="tool", **QUIET)
    assert result.adapted == {}
    assert "each session has one tool: a loss may be that of other sessions" in str(result)
