"""Feature spaces: recordings to features, one scikit-learn transformer each, and the paper's table of them."""

from granular_id._estimators import learns
from granular_id.spaces.base import (
    FeatureBlock,
    RecordingFilter,
    RecordingTransformer,
    axis_names,
    axis_units,
    block_sizes,
    feature_blocks,
    tell_blocks,
)
from granular_id.spaces.best import DECODING, BestClassifier, Choice, Chosen
from granular_id.spaces.components import PrincipalComponents
from granular_id.spaces.gram_plan import GramPlan, block_key, gram_plan
from granular_id.spaces.hfmh import DEFAULT_RANGE, HFMH, BinRange, RawHFMH, RawHistogram
from granular_id.spaces.multiband import (
    ALL_BLOCKS,
    BAND_LOSS,
    USUAL_BLOCKS,
    Band,
    BandColumn,
    BandColumns,
    FrequencyBand,
    MultiBand,
    band_columns,
)
from granular_id.spaces.presets import FeatureSpace, feature_spaces
from granular_id.spaces.raw import RangeNormalizer, RawSignal, Tare, TimePermutation
from granular_id.spaces.scaling import (
    LINEAR_STEPS,
    BlockScaler,
    WithinClassWhitening,
    folded_back,
    is_linear_step,
)
from granular_id.spaces.spectral import DFT
from granular_id.spaces.union import BlockUnion, BlockWeights, row_norms, unit_weight

__all__ = [
    "ALL_BLOCKS",
    "BAND_LOSS",
    "DECODING",
    "DEFAULT_RANGE",
    "DFT",
    "HFMH",
    "LINEAR_STEPS",
    "USUAL_BLOCKS",
    "Band",
    "BandColumn",
    "BandColumns",
    "BestClassifier",
    "BinRange",
    "BlockScaler",
    "BlockUnion",
    "BlockWeights",
    "Choice",
    "Chosen",
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
    "axis_names",
    "axis_units",
    "band_columns",
    "block_key",
    "block_sizes",
    "feature_blocks",
    "feature_spaces",
    "folded_back",
    "gram_plan",
    "is_linear_step",
    "learns",
    "row_norms",
    "tell_blocks",
    "unit_weight",
]
