"""Every feature space through evaluate: seeded, the same for any number of threads, and what did not converge."""

import warnings

import pytest
from sklearn.decomposition import PCA
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from evaluation_cases import QUIET
from granular_id._estimators import convergence_warnings
from granular_id.evaluation import evaluate
from granular_id.rica import RICA
from granular_id.spaces import RawHFMH, RawSignal, feature_spaces, in_paper_order

PRESETS = feature_spaces()
SPACES = {
    **{name: PRESETS[name] for name in in_paper_order(PRESETS)},
    "permuted": PRESETS["time-permuted"],
    "auto": RawHFMH(bin_range="auto"),
    "unit": RawHFMH(block_weights="unit"),
    "numbers": RawHFMH(block_weights=(2.0, 0.1)),
    "pca of a union": make_pipeline(RawHFMH(block_weights="unit"), PCA(5)),
    "pca, scaled": make_pipeline(RawSignal(), PCA(5), StandardScaler()),
    "pca+rica": make_pipeline(RawSignal(), PCA(8), RICA(4, max_iter=30)),
}
PAPER = {"paper": (2, 6, 3), **QUIET}


@pytest.fixture(scope="module")
def result(data):
    return evaluate(data, SPACES, **PAPER)


def test_every_space_tells_materials_apart(result):
    assert {name: held.accuracy for name, held in result.held.items() if not 0.25 < held.accuracy < 1} == {}


def test_every_space_is_the_same_for_any_number_of_threads(data, result):
    two = evaluate(data, SPACES, n_jobs=2, **PAPER)
    assert list(two.predictions()) == list(result.predictions())


def test_an_open_seed_of_a_step_after_components_is_set_by_partition(data, monkeypatch):
    seeds = []
    original = RICA.fit

    def recorded(self, X, y=None):
        seeds.append(self.random_state)
        return original(self, X, y)

    monkeypatch.setattr(RICA, "fit", recorded)
    for seed in (0, 1):
        evaluate(data, {"pca+rica": SPACES["pca+rica"]}, random_state=seed, **PAPER)
    assert len(set(seeds)) == 4
    assert None not in seeds


def test_solvers_that_stop_early_are_a_note(data):
    early = {"few": make_pipeline(RawSignal(), PCA(8), RICA(4, max_iter=2))}
    result = evaluate(data, early, **PAPER)
    (note,) = [note for note in result.notes if note.startswith("few:")]
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


def test_a_constant_axis_changes_nothing_that_the_others_tell(data):
    silent = []
    for r in data:
        wrench = r.wrench.copy()
        wrench[:, 2] = 2.5
        silent.append(type(r)(**{**vars(r), "wrench": wrench}))
    spaces = {name: space for name, space in SPACES.items() if name != "permuted"}
    result = evaluate(type(data)(silent), spaces, **PAPER)
    assert any("never changes (fz)" in note for note in result.notes)
    for name in spaces:
        assert result.accuracy(name) > 0.3
