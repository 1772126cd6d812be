"""Error-correcting output codes over linear support vector machines: from codes to one decision."""

from granular_id.ecoc.classifier import ECOCClassifier
from granular_id.ecoc.codings import (
    CODINGS as CODINGS,
    LOSSES as LOSSES,
    decode as decode,
    design as design,
    onevsone as onevsone,
)
from granular_id.ecoc.learners import Task as Task, class_indices as class_indices, line_scores as line_scores
from granular_id.ecoc.posterior import (
    POSTERIORS as POSTERIORS,
    Posterior as Posterior,
    check_posterior as check_posterior,
    fit_posterior as fit_posterior,
)

__all__ = ["ECOCClassifier"]
