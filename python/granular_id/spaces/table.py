"""The table of feature spaces: names, transformers, accuracies of the paper.

Source: Hynninen, Nguyen Le, Kyrki, "Interactive Identification of Granular Materials using Force
Measurements" (arXiv 2403.17606), table of accuracies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from granular_id.spaces.transformers import (
    DEFAULT_RANGE,
    HFMH,
    BinRange,
    RawHFMH,
    RawSignal,
    RecordingTransformer,
)

__all__ = ["FeatureSpace", "feature_spaces"]


@dataclass(frozen=True)
class FeatureSpace:
    """One row of the paper's table.

    Attributes
    ----------
    name : str
        Key in `feature_spaces`.
    transformer : estimator
        Not fitted; turns recordings (n, T, C) into features (n, D).
    paper_accuracy : float
        Mean accuracy that the paper reports, 11 materials and 20 random partitions.
    """

    name: str
    transformer: RecordingTransformer
    paper_accuracy: float

    @property
    def learns(self) -> bool:
        """Whether the transformer must be fitted on the training rows of each partition."""
        return self.transformer.learns


def feature_spaces(
    *,
    rate_hz: float = 500.0,
    cutoff_hz: float = 23.0,
    order: int = 8,
    n_bins: int = 100,
    bin_range: BinRange = DEFAULT_RANGE,
    threads: int | None = None,
) -> dict[str, FeatureSpace]:
    """Feature spaces by name, with the accuracy that the paper reports for each.

    Parameters
    ----------
    rate_hz, cutoff_hz, order, n_bins, bin_range, threads
        As in `HFMH`; the defaults are the paper's.

    Returns
    -------
    dict of str to FeatureSpace
        "raw", "hfmh", "raw+hfmh".

    Examples
    --------
    >>> from granular_id.spaces import feature_spaces
    >>> {name: space.paper_accuracy for name, space in feature_spaces().items()}
    {'raw': 0.7614, 'hfmh': 0.8705, 'raw+hfmh': 0.9705}
    """
    options: dict[str, Any] = {
        "rate_hz": rate_hz,
        "cutoff_hz": cutoff_hz,
        "order": order,
        "n_bins": n_bins,
        "bin_range": bin_range,
        "threads": threads,
    }
    table = (
        FeatureSpace("raw", RawSignal(threads=threads), 0.7614),
        FeatureSpace("hfmh", HFMH(**options), 0.8705),
        FeatureSpace("raw+hfmh", RawHFMH(**options), 0.9705),
    )
    return {space.name: space for space in table}
