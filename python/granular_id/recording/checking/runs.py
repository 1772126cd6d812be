"""Runs of samples in which something holds, and how long a run of equal values may be by chance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


def longest_run(held: NDArray[np.bool_]) -> tuple[int, int]:
    """Return start and length of the longest run of True, (0, 0) when there is none.

    Examples
    --------
    >>> import numpy as np
    >>> longest_run(np.array([True, False, True, True]))
    (2, 2)
    """
    edges: NDArray[Any] = np.flatnonzero(np.diff(held, prepend=False, append=False))
    if not len(edges):
        return 0, 0
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    best = int(lengths.argmax())
    return int(starts[best]), int(lengths[best])


def surprising_run(repeated: float, n_samples: int, alpha: float) -> int:
    """Return how many equal samples in a row come by chance less often than `alpha`.

    Parameters
    ----------
    repeated : float
        Share of samples that equal the one before, elsewhere on the axis: high for coarse converters and for
        data that were repeated to reach a higher rate.
    n_samples : int
        Length of the recording.
    alpha : float
        Probability of one such run in the whole recording, were repetitions independent:
        ``n_samples * repeated ** (length - 1) <= alpha``.

    Returns
    -------
    int
        At least 4; `n_samples` + 1, which no run reaches, where nearly every sample is a repetition.

    Examples
    --------
    >>> surprising_run(0.05, 1600, 1e-6), surprising_run(0.8, 1600, 1e-6)
    (9, 96)
    """
    share = max(repeated, 1 / n_samples)
    if share >= 1:
        return n_samples + 1
    return min(n_samples + 1, max(4, math.ceil(1 + math.log(alpha / n_samples) / math.log(share))))
