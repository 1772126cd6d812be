"""A trained model that names materials: from whole recordings, and while samples arrive.

What trains is loaded when first used: a robot that only identifies does not wait for scikit-learn.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from granular_id.identifier.answers import (
    Timeline,
    flags_in_words as flags_in_words,
    identify_all as identify_all,
    named as named,
    notes_of_all as notes_of_all,
    notes_of_answers as notes_of_answers,
    write_csv as write_csv,
)
from granular_id.identifier.decision import Decision
from granular_id.identifier.identifier import Identifier
from granular_id.identifier.metadata import (
    SPACES as SPACES,
    Begin as Begin,
    Metadata as Metadata,
    check_recordings as check_recordings,
    cropped_to_model as cropped_to_model,
    mark_of as mark_of,
    setup_comparison as setup_comparison,
    starts_in as starts_in,
    synthetic_words as synthetic_words,
)
from granular_id.identifier.model_card import (
    describe_model as describe_model,
    describe_performance as describe_performance,
    model_facts as model_facts,
)
from granular_id.identifier.rules import N_CHECKPOINTS as N_CHECKPOINTS
from granular_id.identifier.streaming import StreamingIdentifier

if TYPE_CHECKING:
    from granular_id.identifier.time_course import OverTime, accuracy_over_time, over_time as over_time
    from granular_id.identifier.training import train as train

__all__ = [
    "Decision",
    "Identifier",
    "OverTime",
    "StreamingIdentifier",
    "Timeline",
    "accuracy_over_time",
]

_LAZY = {
    "OverTime": "time_course",
    "accuracy_over_time": "time_course",
    "over_time": "time_course",
    "train": "training",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'granular_id.identifier' has no attribute {name!r}")
    value = getattr(import_module(f"granular_id.identifier.{_LAZY[name]}"), name)
    globals()[name] = value
    return value
