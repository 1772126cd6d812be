"""Feature spaces: recordings to features, one scikit-learn transformer each, and the paper's table of them."""

from granular_id.spaces.base import RecordingFilter, RecordingTransformer, learns
from granular_id.spaces.blocks import FeatureBlock
from granular_id.spaces.components import PrincipalComponents
from granular_id.spaces.fourier import DFT
from granular_id.spaces.gram_plan import GramPlan, block_key, gram_plan
from granular_id.spaces.hfmh import HFMH, BinRange, RawHFMH
from granular_id.spaces.histogram import RawHistogram
from granular_id.spaces.links import block_sizes, feature_blocks, tell_blocks
from granular_id.spaces.multiband import FrequencyBand, MultiBand
from granular_id.spaces.permutation import TimePermutation
from granular_id.spaces.raw import RangeNormalizer, RawSignal
from granular_id.spaces.scaling import BlockScaler
from granular_id.spaces.table import FeatureSpace, feature_spaces
from granular_id.spaces.tare import Tare
from granular_id.spaces.union import BlockUnion
from granular_id.spaces.weights import unit_weight
from granular_id.spaces.whitening import WithinClassWhitening

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
