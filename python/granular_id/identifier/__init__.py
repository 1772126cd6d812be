"""A trained model that names materials: from whole recordings, and while samples arrive.

What trains is loaded when first used: a robot that only identifies does not wait for scikit-learn.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from granular_id.identifier.batch import Batch, identify_all
from granular_id.identifier.decision import Decision
from granular_id.identifier.identifier import Identifier
from granular_id.identifier.metadata import SPACES, comparison, fitted, refuse_others
from granular_id.identifier.model_card import description, promises
from granular_id.identifier.rules import N_CHECKPOINTS
from granular_id.identifier.streaming import StreamingIdentifier

if TYPE_CHECKING:
    from granular_id.identifier.over_time import OverTime, accuracy_over_time
    from granular_id.identifier.recipe import Recipe
    from granular_id.identifier.training import Training, fit_pipeline, train

__all__ = [
    "N_CHECKPOINTS",
    "SPACES",
    "Batch",
    "Decision",
    "Identifier",
    "OverTime",
    "Recipe",
    "StreamingIdentifier",
    "Training",
    "accuracy_over_time",
    "comparison",
    "description",
    "fit_pipeline",
    "fitted",
    "identify_all",
    "promises",
    "refuse_others",
    "train",
]

_LAZY = {
    "OverTime": "over_time",
    "Recipe": "recipe",
    "Training": "training",
    "accuracy_over_time": "over_time",
    "fit_pipeline": "training",
    "train": "training",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'granular_id.identifier' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.identifier.{_LAZY[name]}"), name)
    globals()[name] = value
    return value
