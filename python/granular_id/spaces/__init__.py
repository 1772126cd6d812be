"""Feature spaces: recordings to features, one scikit-learn transformer each, and the paper's table of them."""

from granular_id._estimators import learns
from granular_id.spaces.base import (
    FeatureBlock,
    RecordingFilter,
    RecordingTransformer,
    block_sizes,
    feature_blocks,
    tell_blocks,
)
from granular_id.spaces.components import PrincipalComponents
from granular_id.spaces.gram_plan import GramPlan, block_key, gram_plan
from granular_id.spaces.hfmh import HFMH, BinRange, RawHFMH, RawHistogram
from granular_id.spaces.multiband import FrequencyBand, MultiBand
from granular_id.spaces.presets import FeatureSpace, feature_spaces
from granular_id.spaces.raw import RangeNormalizer, RawSignal, Tare, TimePermutation
from granular_id.spaces.scaling import BlockScaler, WithinClassWhitening
from granular_id.spaces.spectral import DFT
from granular_id.spaces.union import BlockUnion, unit_weight

__all__ = [
    "DFT",
    "HFMH",
    "BinRange",
    "BlockScaler",
    "BlockUnion",
    "FeatureBlock",
    "FeatureSpace",
    "FrequencyBand",
    "GramPlan",
    "MultiBand",
    "PrincipalComponents",
    "RangeNormalizer",
    "RawHFMH",
    "RawHistogram",
    "RawSignal",
    "RecordingFilter",
    "RecordingTransformer",
    "Tare",
    "TimePermutation",
    "WithinClassWhitening",
    "block_key",
    "block_sizes",
    "feature_blocks",
    "feature_spaces",
    "gram_plan",
    "learns",
    "tell_blocks",
    "unit_weight",
]
