"""Names the granular material under a robot's tool from a 6-axis force-torque signal.

The names below are loaded when first used: a robot that only extracts features does not wait for scikit-learn.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from granular_id._core import AXES, UNITS, GranularIdError, StreamingExtractor, __version__
from granular_id.features import FeatureSpec, extract_features, feature_names

if TYPE_CHECKING:
    from granular_id import confidence, report, signal
    from granular_id.ecoc import ECOCClassifier
    from granular_id.evaluation import ConfidenceStudy, EvaluationResult, confidence_study, evaluate
    from granular_id.explanation import Explanation, explain
    from granular_id.identifier import Decision, Identifier, StreamingIdentifier
    from granular_id.io import RecordingFileError, load, save
    from granular_id.live import WrenchBuffer, identify
    from granular_id.recording import (
        CheckReport,
        Dataset,
        Finding,
        Recording,
        SampleFlag,
        StepReport,
        Summary,
    )
    from granular_id.rica import RICA
    from granular_id.spaces import (
        DFT,
        HFMH,
        BestClassifier,
        BlockScaler,
        MultiBand,
        RangeNormalizer,
        RawHFMH,
        RawHistogram,
        RawSignal,
        Tare,
        TimePermutation,
        WithinClassWhitening,
        feature_spaces,
    )
    from granular_id.synthetic import synthesize

__all__ = [
    "AXES",
    "DFT",
    "HFMH",
    "RICA",
    "UNITS",
    "BestClassifier",
    "BlockScaler",
    "CheckReport",
    "ConfidenceStudy",
    "Dataset",
    "Decision",
    "ECOCClassifier",
    "EvaluationResult",
    "Explanation",
    "FeatureSpec",
    "Finding",
    "GranularIdError",
    "Identifier",
    "MultiBand",
    "RangeNormalizer",
    "RawHFMH",
    "RawHistogram",
    "RawSignal",
    "Recording",
    "RecordingFileError",
    "SampleFlag",
    "StepReport",
    "StreamingExtractor",
    "StreamingIdentifier",
    "Summary",
    "Tare",
    "TimePermutation",
    "WithinClassWhitening",
    "WrenchBuffer",
    "__version__",
    "confidence",
    "confidence_study",
    "evaluate",
    "explain",
    "extract_features",
    "feature_names",
    "feature_spaces",
    "identify",
    "load",
    "report",
    "save",
    "signal",
    "synthesize",
]

_LAZY = {
    "BestClassifier": "spaces",
    "BlockScaler": "spaces",
    "CheckReport": "recording",
    "ConfidenceStudy": "evaluation",
    "DFT": "spaces",
    "Dataset": "recording",
    "Decision": "identifier",
    "ECOCClassifier": "ecoc",
    "EvaluationResult": "evaluation",
    "Explanation": "explanation",
    "Finding": "recording",
    "HFMH": "spaces",
    "Identifier": "identifier",
    "MultiBand": "spaces",
    "RICA": "rica",
    "RangeNormalizer": "spaces",
    "RawHFMH": "spaces",
    "RawHistogram": "spaces",
    "RawSignal": "spaces",
    "Recording": "recording",
    "RecordingFileError": "io",
    "SampleFlag": "recording",
    "StepReport": "recording",
    "StreamingIdentifier": "identifier",
    "Summary": "recording",
    "Tare": "spaces",
    "TimePermutation": "spaces",
    "WithinClassWhitening": "spaces",
    "WrenchBuffer": "live",
    "confidence_study": "evaluation",
    "evaluate": "evaluation",
    "explain": "explanation",
    "feature_spaces": "spaces",
    "identify": "live",
    "load": "io",
    "save": "io",
    "synthesize": "synthetic",
}


def __getattr__(name: str) -> Any:
    if name in ("confidence", "report", "signal"):
        return import_module(f"granular_id.{name}")
    if name not in _LAZY:
        raise AttributeError(f"module 'granular_id' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.{_LAZY[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
