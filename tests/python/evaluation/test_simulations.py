"""What the gap and the interval promise, on recordings of which the effect of a session is known.

`make nightly CHECK=campaign` draws 500 data sets of each kind; a usual run draws a few, and allows for the fewer.
"""

import math
from itertools import product

import numpy as np
import pytest
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer

from effort import cases, kinds
from evaluation_cases import Centroids
from granular_id.evaluation import Gap, matched_draws
from granular_id.recording import Dataset, Recording
from granular_id.score import fit_and_score
from granular_id.splits import hold_out

N_MATERIALS, SEPARATION = 4, 2.5
CENTROIDS = Pipeline([("features", FunctionTransformer()), ("classifier", Centroids())])


class Law:
    """Levels on six axes: a mean of each material, an effect of the session, and noise of one."""

    def __init__(self, n_sessions, n_rows, effect, own=True, sizes=(1.0,)):
        """`effect`: the SD of that of a session, of `own` or of all materials together; `sizes`: shares of `n_rows`."""
        self.n_sessions, self.n_rows, self.effect, self.own = n_sessions, n_rows, effect, own
        self.sizes = np.resize(sizes, n_sessions)

    def levels(self, rng, n_sessions):
        """Return levels (n, 6), materials and sessions of `n_rows` of each material in each session."""
        session, material = (rows.ravel() for rows in np.indices((n_sessions, N_MATERIALS, self.n_rows))[:2])
        offsets = self.effect * rng.normal(size=(n_sessions, N_MATERIALS if self.own else 1, 6))
        levels = SEPARATION * np.eye(6)[material] + rng.normal(size=(material.size, 6))
        return levels + offsets[session, material if self.own else 0], material, session

    def draw(self, rng):
        """Return a data set without samples, and what stands for them."""
        levels, material, session = self.levels(rng, self.n_sessions)
        some = np.arange(material.size) % self.n_rows < (self.sizes * self.n_rows).round()[session]
        levels, material, session = levels[some], material[some], session[some]
        names = [f"{m if self.own else ''}{s}" for m, s in zip(material, session, strict=True)]
        return Dataset(
            [
                Recording(np.zeros((2, 6)), 500.0, label=f"m{m}", session=name, name=f"{k}")
                for k, (m, name) in enumerate(zip(material, names, strict=True))
            ]
        ), levels

    def accuracy_in_new_sessions(self, rng, levels, y):
        """Accuracy in 200 new sessions of the model of all recordings."""
        new, material, _ = self.levels(rng, 200)
        model = Centroids().fit(levels, y)
        return float((model.predict(new) == np.unique(y)[material]).mean())


def gaps(law, n_draws):
    """Measure the gap in draws of a law."""
    rng, found = np.random.default_rng(1), []
    for draw in range(n_draws):
        data, levels = law.draw(rng)
        folds = hold_out(data, seed=draw)
        held = fit_and_score(CENTROIDS, data, folds, X=levels)
        drawn = [fit_and_score(CENTROIDS, data, one, X=levels) for one in matched_draws(data, folds)[0]]
        found.append(Gap.of("levels", held, [one.accuracy for one in drawn]))
    return found


def spread(share, n_draws):
    """Three standard errors of a share."""
    return 3 * math.sqrt(share * (1 - share) / n_draws)


N_GAPS = cases(5)


def test_gap_of_no_points_is_rarely_called_lost():
    lost = np.mean([gap.is_lost for gap in gaps(Law(4, 12, 0.0), N_GAPS)])
    print(f"lost where nothing is: {100 * lost:.1f} %")
    assert lost <= 0.07 if N_GAPS >= 500 else lost <= 0.05 + spread(0.05, N_GAPS)


def test_gap_of_six_points_is_found():
    found = gaps(Law(4, 12, 0.74), N_GAPS)
    points = 100 * np.mean([gap.points for gap in found])
    lost = np.mean([gap.is_lost for gap in found])
    print(f"gap of {points:.1f} points: found in {100 * lost:.1f} %")
    assert points == pytest.approx(6, abs=0.5 if N_GAPS >= 500 else 2)
    assert lost >= 0.8 - (N_GAPS < 500) * spread(0.8, N_GAPS)


N_INTERVALS = cases(20)
UNEQUAL = 0.2, 0.5, 1.0, 0.3, 0.7
"""One session has five times the recordings of another."""


@pytest.mark.parametrize(
    ("n_sessions", "of", "sizes"),
    kinds(
        [(3, "own", "unequal"), (8, "shared", "equal")],
        long=list(product((3, 4, 5, 6, 7, 8), ("own", "shared"), ("equal", "unequal"))),
    ),
)
def test_interval_covers_the_accuracy_in_new_sessions(n_sessions, of, sizes):
    rng, covered, widths = np.random.default_rng(2), [], []
    own, (n_rows, sizes) = of == "own", {"equal": (6, (1.0,)), "unequal": (12, UNEQUAL)}[sizes]
    law = Law(n_sessions, n_rows, 1.0, own, sizes)
    for draw in range(N_INTERVALS):
        data, levels = law.draw(rng)
        low, high = fit_and_score(CENTROIDS, data, hold_out(data, seed=draw), X=levels).interval
        if not math.isnan(low):
            covered.append(low <= law.accuracy_in_new_sessions(rng, levels, data.y) <= high)
            widths.append(high - low)
    share = np.mean(covered)
    print(f"{n_sessions} sessions: covered {100 * share:.1f} %, width {100 * np.mean(widths):.0f} points")
    few = (N_INTERVALS < 500) * spread(0.9, N_INTERVALS)
    assert 0.90 - few <= share <= 0.98 + few
    assert len(covered) >= 0.9 * N_INTERVALS
