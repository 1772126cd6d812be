"""What differs by more than chance: the gap to as many recordings at random, one space from another."""

import numpy as np
import pytest
from sklearn.neighbors import KNeighborsClassifier

from evaluation_cases import QUIET, Centroids, held, of_levels
from granular_id.evaluation import Gap, evaluate
from granular_id.recording import Dataset, Recording
from granular_id.statistics import corrected_resampled_t, holm, mann_whitney


@pytest.mark.parametrize(("n_below", "p", "lost"), [(0, 0.05, True), (1, 0.10, False), (19, 1.0, False)])
def test_p_of_the_gap_is_the_rank_among_twenty(n_below, p, lost):
    strict = held([1, 1, 0, 0], [0, 1, 0, 1], list("stst"))
    gap = Gap.of("raw", strict, [0.5] * n_below + [0.6] * (19 - n_below))
    assert (gap.p, gap.is_lost) == (pytest.approx(p), lost)
    assert str(gap).startswith("10.0 points are lost" if lost else "no loss shown with held-out sessions")


def test_gap_bound_is_draws_less_the_lower_end():
    strict = held([1, 1, 1, 0, 1, 1, 0, 1], [0, 1] * 4, np.repeat(list("stuv"), 2))
    gap = Gap.of("raw", strict, [0.8] * 19)
    assert gap.points == pytest.approx(0.05)
    assert gap.most == pytest.approx(0.8 - strict.interval[0])
    assert Gap.of("raw", strict, [0.0] * 19).most == 0
    few = held([1, 1, 0, 0], [0, 1, 0, 1], list("ssst"))
    assert np.isnan(Gap.of("raw", few, [0.4] * 19).most)


def test_copies_within_sessions_make_no_gap():
    """Random vectors with no material in them: who trains on a copy of what is tested names it right."""
    rng = np.random.default_rng(0)
    levels, material = rng.normal(size=(32, 6)), np.repeat([f"m{k}" for k in range(4)], 8)
    session = [f"{k % 4}" for k in range(32)]
    twice = of_levels(*(np.concatenate([part, part]) for part in (levels, material, session)))
    classifier = KNeighborsClassifier(1)
    known = evaluate(twice, "raw", classifier=classifier, accept="duplicates", **QUIET)
    assert not known.gap.is_lost
    assert abs(known.gap.points) < 0.15
    few = evaluate(twice[[k for k in range(64) if k % 32 % 8 < 4]], "raw", accept="duplicates", **QUIET)
    assert few.why_no_gap == "m0: 4 recordings that are no copies, too few to mix what 4 sessions hold"


def test_overlapping_windows_without_sessions_show_no_gap():
    """Half of each window is that of the next: drawn apart they would be recognised by their copies."""
    rng = np.random.default_rng(0)
    waves = [(1 + 0.2 * (k // 10)) * rng.normal(size=(300, 6)) for k in range(30)]
    names = [{"label": f"m{k // 10}", "session": f"{k // 2}", "name": f"{k}"} for k in range(30)]
    long = [Recording(wave, 100.0, **name) for wave, name in zip(waves, names, strict=True)]
    gap = evaluate(Dataset(long).windows(0.6, 0.3), "hfmh", classifier=Centroids(), **QUIET).gap
    assert not gap.is_lost
    assert abs(gap.points) < 0.05
    few = evaluate(Dataset(long[::2]).windows(0.6, 0.3), "hfmh", classifier=Centroids(), **QUIET)
    assert few.gap is None
    why = "gap not measured: m0: 5 recordings cut into windows that share samples"
    assert why in " ".join(str(few).split())


def test_every_pair_is_tested_on_the_shares_of_its_folds(data):
    result = evaluate(data, ["raw", "hfmh", "raw-histogram"], paper=(5, 6, 3), **QUIET)
    shares = {name: held.fold_accuracies() for name, held in result.held.items()}
    pairs = result.comparison()
    names = [(pair.first, pair.second) for pair in pairs]
    assert names == [("raw", "hfmh"), ("raw", "raw-histogram"), ("hfmh", "raw-histogram")]
    for pair in pairs:
        d = shares[pair.first] - shares[pair.second]
        assert pair.difference == pytest.approx(d.mean())
        assert pair.corrected_p == corrected_resampled_t(d, n_train=24, n_test=12)
        assert pair.mann_whitney_p == mann_whitney(shares[pair.first], shares[pair.second])
    assert [pair.holm_p for pair in pairs] == holm([pair.corrected_p for pair in pairs]).tolist()
