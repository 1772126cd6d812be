"""The classifier behind the preset "best": chooses among few linear machines on held-out rows, and is one of them."""

from granular_id.best.candidates import Machine
from granular_id.best.choice import Choice
from granular_id.best.classifier import BestClassifier

__all__ = ["BestClassifier", "Choice", "Machine"]
