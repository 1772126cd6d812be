"""What probabilities, candidates, refusal and early answers promise of new sessions, where their effect is known.

``GRANULAR_ID_CASES=500`` draws as many data sets of each kind; a usual run draws a few, and allows for the fewer.
"""

from itertools import product

import numpy as np
import pytest

import granular_id as gid
from effort import cases, kinds
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import PAPER_MATERIALS

N_MATERIALS, N_SAMPLES, SCALE = 3, 60, 0.03  # N of a unit of level: margins so soft that libsvm ends soon
BARE = {"target_error": None, "share_known": None}
MATERIALS = [material.name for material in PAPER_MATERIALS]


def pushes(rng, correlation, n_sessions, n_rows, *, name="s", own=False, separation=2.5, white=0.05):
    """Pushes of constant level: a mean of each material, an effect of the session, noise of one.

    `correlation` is the share of the variance within a material that is that of sessions. The session is that of all
    materials, or `own` of each.
    """
    session, material = (rows.ravel() for rows in np.indices((n_sessions, N_MATERIALS, n_rows))[:2])
    effect = rng.normal(size=(n_sessions, N_MATERIALS if own else 1, 6))
    effect *= np.sqrt(correlation / (1 - correlation))
    levels = separation * np.eye(6)[material] + effect[session, material if own else 0]
    levels += rng.normal(size=levels.shape)
    waves = (levels[:, None] + white * rng.normal(size=(len(levels), N_SAMPLES, 6))) * SCALE
    return Dataset(
        [
            Recording(wave, 500.0, label=f"m{m}", session=f"{name}{m if own else ''} {s}", name=f"{k}")
            for k, (wave, m, s) in enumerate(zip(waves, material, session, strict=True))
        ]
    )


def close_to(values):
    """Three standard errors of a mean over draws."""
    return 3 * np.std(values) / np.sqrt(len(values))


USUAL, ALL = [(3, 0.0), (4, 0.5)], list(product((3, 4, 6, 10), (0.0, 0.25, 0.5)))


@pytest.mark.parametrize(("n_sessions", "correlation"), kinds(USUAL, long=ALL))
def test_candidates_hold_the_material_in_new_sessions(n_sessions, correlation):
    rng, shares, sizes = np.random.default_rng(2), [], []
    for _ in range(cases(8)):
        model = gid.Identifier.fit(pushes(rng, correlation, n_sessions, 4), "raw", **BARE)
        new = pushes(rng, correlation, 10, 4, name="new")
        named = [answer.candidates for answer in map(model.identify, new.X)]
        shares.append(np.mean([label in names for label, names in zip(new.y, named, strict=True)]))
        sizes.append(np.mean([len(names) for names in named]))
    print(f"{n_sessions} sessions, {correlation}: {100 * np.mean(shares):.1f} % in {np.mean(sizes):.2f}")
    assert np.mean(shares) >= 0.89 - close_to(shares)


@pytest.mark.parametrize("spread", kinds([0.7], long=[0.0, 0.7, 1.2]))
def test_probabilities_are_not_too_sure_in_new_sessions(spread):
    rng, off = np.random.default_rng(10), []
    correlation = spread**2 / (1 + spread**2)
    settings = {"own": True, "white": 0.3}
    for _ in range(cases(8)):
        model = gid.Identifier.fit(pushes(rng, correlation, 4, 8, **settings), "raw", **BARE)
        new = pushes(rng, correlation, 12, 8, name="new", **settings)
        shares = model.predict_proba(new.X)
        off.append(shares.max(axis=1).mean() - np.mean(model.predict(new.X) == new.y))
    print(f"session SD {spread}: {100 * np.mean(off):+.1f} points too sure")
    assert np.mean(off) <= 0.03 + close_to(off)


@pytest.mark.parametrize("correlation", kinds([0.5], long=[0.0, 0.5]))
def test_early_answers_err_as_stated_in_new_sessions(correlation):
    rng, target, wrong = np.random.default_rng(17), 0.05, []
    for _ in range(cases(8)):
        data = pushes(rng, correlation, 4, 8, separation=3.0)
        model = gid.Identifier.fit(data, "raw", target_error=target, coverage=None, share_known=None)
        new = pushes(rng, correlation, 10, 4, name="new", separation=3.0)
        stream, answers = gid.StreamingIdentifier(model), []
        for one in new:
            stream.reset()
            for start in range(0, N_SAMPLES - 3, 3):  # as often as the rule was set
                stream.push(one.wrench[start : start + 3])
                decision = stream.decision()
                if decision.sure:
                    answers.append(decision.label != one.label)
                    break
        if answers:
            wrong.append(np.mean(answers))
    print(f"{correlation}: early answers of {len(wrong)} models, {100 * np.mean(wrong):.1f} % wrong")
    assert np.mean(wrong) <= target + 0.01 + close_to(wrong)


def test_known_materials_are_rarely_refused_in_new_sessions():
    """SYNTHETIC pushes of six sessions, then of six others."""
    refused = []
    for seed in range(min(cases(2), 50)):
        names = np.random.default_rng(seed).permutation(MATERIALS)[:6].tolist()
        about = {"duration_s": 1.6, "rate_hz": 250.0}
        data, new = (gid.synthesize(names, 18, 6, seed=s, **about) for s in (seed, 1000 + seed))
        model = gid.Identifier.fit(data, "multiband", target_error=None, coverage=None)
        refused.append(np.mean([answer.unknown for answer in map(model.identify, new.X)]))
    print(f"{100 * np.mean(refused):.1f} % of known pushes refused")
    assert 0.01 - close_to(refused) <= np.mean(refused) <= 0.05 + close_to(refused)
