"""A trained model that names materials: from whole recordings, and while samples arrive."""

from granular_id.identifier.answers import (
    Batch as Batch,
    Timeline,
    answers_about as answers_about,
    flags_in_words as flags_in_words,
    identify_all as identify_all,
    notes_of_all as notes_of_all,
    notes_of_answers as notes_of_answers,
    write_csv as write_csv,
)
from granular_id.identifier.decision import Decision, StreamingIdentifier
from granular_id.identifier.early import N_CHECKPOINTS as N_CHECKPOINTS, OverTime
from granular_id.identifier.identifier import Identifier
from granular_id.identifier.model import (
    SPACES as SPACES,
    known_marks as known_marks,
    mark_of as mark_of,
    synthetic_words as synthetic_words,
)
from granular_id.identifier.model_card import (
    describe_model as describe_model,
    describe_performance as describe_performance,
    model_facts as model_facts,
)

__all__ = ["Decision", "Identifier", "OverTime", "StreamingIdentifier", "Timeline"]
