"""Error-correcting output codes over linear support vector machines: from codes to one decision."""

from granular_id.ecoc.classifier import ECOCClassifier
from granular_id.ecoc.codings import CODINGS, design, onevsone
from granular_id.ecoc.decoding import DECODINGS, LOSSES, class_values, decode, fitting_loss
from granular_id.ecoc.learners import line_scores
from granular_id.ecoc.posterior import POSTERIORS, Posterior, check_posterior, fit_posterior
from granular_id.ecoc.task import Task, class_indices

__all__ = [
    "CODINGS",
    "DECODINGS",
    "LOSSES",
    "POSTERIORS",
    "ECOCClassifier",
    "Posterior",
    "Task",
    "check_posterior",
    "class_indices",
    "class_values",
    "decode",
    "design",
    "fit_posterior",
    "fitting_loss",
    "line_scores",
    "onevsone",
]
