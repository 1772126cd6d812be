"""Names the granular material under a robot's tool from a 6-axis force-torque signal."""

from granular_id._core import __version__
from granular_id.features import FeatureSpec, extract_features, feature_names

__all__ = ["FeatureSpec", "__version__", "extract_features", "feature_names"]
