"""Error-correcting output codes over linear support vector machines: from codes to one decision."""

from granular_id.ecoc.classifier import ECOCClassifier

__all__ = ["ECOCClassifier"]
