"""What the fake box measures: recordings, or simulated pushes, as counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import finite_number

__all__ = ["counts_of", "played", "pushes"]

_COUNTS = np.iinfo(np.int32)


def counts_of(
    wrench: ArrayLike, counts_per_newton: float, counts_per_newton_metre: float
) -> NDArray[np.int32]:
    """Turn wrenches into counts: rounded, and held at the ends of 32 bits.

    Parameters
    ----------
    wrench : array_like, shape (n, 6)
        N and N m.
    counts_per_newton, counts_per_newton_metre : float

    Returns
    -------
    ndarray of int32, shape (n, 6)

    Examples
    --------
    >>> from granular_id.live.fake_netft_signal import counts_of
    >>> counts_of([[1.5, 0, -9e9, 0.25, 0, 0]], 1e6, 1e6).tolist()
    [[1500000, 0, -2147483648, 250000, 0, 0]]
    """
    scale = np.repeat([counts_per_newton, counts_per_newton_metre], 3)
    exact = np.rint(np.asarray(wrench, dtype=np.float64) * scale)
    counts: NDArray[np.int32] = np.clip(exact, _COUNTS.min, _COUNTS.max).astype(np.int32)
    return counts


def pushes(material: str, rate_hz: float, *, seed: int = 0, n_pushes: int = 4) -> NDArray[np.float64]:
    """Simulate pushes through one material, one after the other.

    Parameters
    ----------
    material : str
        One of `granular_id.synthetic.PAPER_MATERIALS`.
    rate_hz : float
    seed : int, default 0
    n_pushes : int, default 4
        Then the signal begins anew.

    Returns
    -------
    ndarray, shape (n, 6)
        N and N m.
    """
    from granular_id.synthetic import synthesize  # a box that plays a file needs no model

    data = synthesize(material, n_pushes, rate_hz=rate_hz, seed=seed)
    return np.concatenate([recording.wrench for recording in data])


def played(path: str | Path, rate_hz: float | None) -> tuple[NDArray[np.float64], float, bool]:
    """Read recordings to be sent one after the other, their rate, and whether any of them is synthetic.

    Parameters
    ----------
    path : str or Path
        Whatever `granular_id.load` reads.
    rate_hz : float, optional
        Rate to play them at; default: the rate they were recorded at.

    Raises
    ------
    ValueError
        Recordings without a common rate, or without the six axes.
    """
    from granular_id.io import load
    from granular_id.live.replay import common_rate

    data = load(Path(path))
    try:
        own = common_rate(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return (
        np.concatenate([r.wrench for r in data]),
        finite_number("rate_hz", own if rate_hz is None else rate_hz, positive=True),
        data.is_synthetic,
    )
