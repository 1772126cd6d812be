"""Multi-band features in a model: which blocks there are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id.spaces.multiband import ALL_BLOCKS, USUAL_BLOCKS

__all__ = ["blocks_of", "without_silent_blocks"]

FloatArray = npt.NDArray[np.float64]


def blocks_of(space: str) -> tuple[str, ...] | None:
    """Return the blocks that a feature space of `Recipe` computes; None where it has no bands."""
    return {"multiband": USUAL_BLOCKS, "best": ALL_BLOCKS}.get(space)


def without_silent_blocks(
    spec: _core.MultiBandExtractor, coef: FloatArray
) -> tuple[_core.MultiBandExtractor, FloatArray]:
    """Leave blocks out of which all weights are 0: no score changes, and nobody computes them.

    Parameters
    ----------
    spec : granular_id._core.MultiBandExtractor
    coef : ndarray, shape (L, D)
    """
    ends = np.cumsum(list(spec.block_sizes.values()))
    parts = dict(zip(spec.block_sizes, np.split(coef, ends[:-1], axis=1), strict=True))
    heard = [name for name, part in parts.items() if part.any()]
    if not heard or len(heard) == len(parts):
        return spec, coef
    kept = _core.MultiBandExtractor(
        spec.n_samples,
        spec.n_axes,
        rate_hz=spec.rate_hz,
        blocks=heard,
        scales=spec.scales,
        level_scales=spec.level_scales,
    )
    return kept, np.concatenate([parts[name] for name in heard], axis=1)
