"""Feature spaces: recordings to features, one scikit-learn transformer each, and the paper's table of them."""

from granular_id.spaces.table import FeatureSpace, feature_spaces
from granular_id.spaces.transformers import HFMH, BinRange, RawHFMH, RawSignal, RecordingTransformer

__all__ = [
    "HFMH",
    "BinRange",
    "FeatureSpace",
    "RawHFMH",
    "RawSignal",
    "RecordingTransformer",
    "feature_spaces",
]
