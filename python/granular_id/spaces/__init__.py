"""Feature spaces: recordings to features, one scikit-learn transformer each, and the paper's table of them."""

from granular_id._estimators import learns
from granular_id.spaces.adaptation import (
    LEAST_ROWS as LEAST_ROWS,
    Learners as Learners,
    SourceStatistics as SourceStatistics,
    adapted_by_labels as adapted_by_labels,
    adapted_to_all as adapted_to_all,
)
from granular_id.spaces.base import (
    FeatureBlock,
    RecordingFilter,
    RecordingTransformer,
    block_sizes,
    feature_blocks,
    joined_units as joined_units,
    renamed as renamed,
    steps_of as steps_of,
)
from granular_id.spaces.best import (
    BestClassifier,
    Choice as Choice,
    adapted_classifier as adapted_classifier,
    choice_of as choice_of,
)
from granular_id.spaces.hfmh import (
    HFMH,
    BinRange,
    RawHFMH,
    RawHistogram,
)
from granular_id.spaces.multiband import (
    BandColumns as BandColumns,
    FrequencyBand,
    MultiBand,
    band_columns as band_columns,
)
from granular_id.spaces.presets import (
    FeatureSpace,
    all_spaces as all_spaces,
    feature_spaces,
    fit_on_features as fit_on_features,
    fit_pipeline as fit_pipeline,
    limit_components as limit_components,
    paper_spaces as paper_spaces,
)
from granular_id.spaces.raw import RangeNormalizer, RawSignal, Tare, TimePermutation
from granular_id.spaces.scaling import (
    LINEAR_STEPS as LINEAR_STEPS,
    BlockScaler,
    WithinClassWhitening,
    folded_back as folded_back,
)
from granular_id.spaces.spectral import DFT

__all__ = [
    "DFT",
    "HFMH",
    "BestClassifier",
    "BinRange",
    "BlockScaler",
    "FeatureBlock",
    "FeatureSpace",
    "FrequencyBand",
    "MultiBand",
    "RangeNormalizer",
    "RawHFMH",
    "RawHistogram",
    "RawSignal",
    "RecordingFilter",
    "RecordingTransformer",
    "Tare",
    "TimePermutation",
    "WithinClassWhitening",
    "block_sizes",
    "feature_blocks",
    "feature_spaces",
    "learns",
]
