"""Seeds for estimators: same seed, same numbers, whatever runs first."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import clone

__all__ = ["seeded_clone"]


def seeded_clone(estimator: Any, seed: np.random.SeedSequence) -> Any:
    """Clone an estimator and give every open ``random_state`` in it a number of its own.

    Parameters
    ----------
    estimator : scikit-learn estimator
        Not changed. Parameters named ``random_state``, its own and those of the estimators inside, are open when
        they are None; a number that is set stays.
    seed : numpy.random.SeedSequence
        Same entropy and spawn key, same numbers.

    Returns
    -------
    estimator
        Unfitted.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import SGDClassifier
    >>> from granular_id._seeds import seeded_clone
    >>> seeded_clone(SGDClassifier(), np.random.SeedSequence(0)).random_state
    2968811710
    >>> seeded_clone(SGDClassifier(random_state=7), np.random.SeedSequence(0)).random_state
    7
    """
    fresh = clone(estimator)
    names = sorted(
        name
        for name, value in fresh.get_params(deep=True).items()
        if value is None and (name == "random_state" or name.endswith("__random_state"))
    )
    if names:
        words = seed.generate_state(len(names))
        fresh.set_params(**{name: int(word) for name, word in zip(names, words, strict=True)})
    return fresh
