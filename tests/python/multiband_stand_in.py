"""A multi-band space in plain numpy: the twin's features behind the interface of `MultiBand`."""

import itertools

import numpy as np

import multiband_twin as twin
from granular_id.spaces.base import RecordingTransformer
from granular_id.spaces.blocks import axis_names


class StandIn(RecordingTransformer):
    learns = True
    is_multiband = True

    def __init__(
        self, *, rate_hz=500.0, blocks=("coupling", "quantiles", "envelope", "spectrum"), threads=None
    ):
        self.rate_hz = rate_hz
        self.blocks = blocks
        self.threads = threads

    def _learn(self, recordings):
        self.scales_, self.level_scales_ = twin.learned_scales(recordings)
        top = twin.TOP * self.rate_hz / 2
        octaves = [
            (top / 2 ** (k + 1), top / 2**k, self.rate_hz / 2 ** max(k - 1, 0))
            for k in range(twin.n_octaves(recordings.shape[1]))
        ]
        self.bands_ = [(0.0, self.rate_hz / 2, self.rate_hz), *octaves]
        at = np.array(twin.spectrum_edges(recordings.shape[1]))
        self.frequencies_hz_ = (at[:-1] + at[1:] - 1) / 2 * self.rate_hz / recordings.shape[1]

    def _features(self, recordings):
        return np.array([twin.features(x, self.scales_, self.level_scales_, self.blocks) for x in recordings])

    def _names(self):
        axes = axis_names(self.n_axes_in_)
        bands = range(len(self.bands_))
        both = [*axes, *(f"{axis}_lag2" for axis in axes)]
        needed = twin.MIN_ROWS * 2 * len(axes) + twin.LAG
        long = [b for b, n in enumerate(twin.band_lengths(self.n_features_in_)) if n >= needed]
        pairs = list(itertools.combinations_with_replacement(both, 2))
        stats = [f"q{round(100 * p):02d}" for p in twin.PROBABILITIES] + ["logrms"]
        n_levels = min(twin.LEVEL_STRETCHES, self.n_features_in_)
        of_block = {
            "coupling": [f"b{b}_coupling_{i}_{j}" for b in long for i, j in pairs],
            "quantiles": [f"b{b}_{stat}_{axis}" for b in bands for axis in axes for stat in stats],
            "envelope": [
                f"b{b}_envelope_{axis}_{k}" for b in bands for axis in axes for k in range(twin.STRETCHES)
            ],
            "spectrum": [
                f"spectrum_{axis}_{k:02d}" for axis in axes for k in range(len(self.frequencies_hz_))
            ],
            "level": [f"level_{axis}_{k:02d}" for axis in axes for k in range(n_levels)],
        }
        return [name for block in self.blocks for name in of_block[block]]
