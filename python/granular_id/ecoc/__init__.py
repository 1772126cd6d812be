"""Error-correcting output codes over linear support vector machines: from codes to one decision."""

from granular_id.ecoc.classifier import ECOCClassifier
from granular_id.ecoc.codings import CODINGS as CODINGS, design as design, onevsone as onevsone
from granular_id.ecoc.decoding import (
    DECODINGS as DECODINGS,
    LOSSES as LOSSES,
    class_values as class_values,
    decode as decode,
    fitting_loss as fitting_loss,
)
from granular_id.ecoc.learners import line_scores as line_scores
from granular_id.ecoc.posterior import (
    POSTERIORS as POSTERIORS,
    Posterior as Posterior,
    check_posterior as check_posterior,
    fit_posterior as fit_posterior,
)
from granular_id.ecoc.task import Task as Task, class_indices as class_indices

__all__ = ["ECOCClassifier"]
