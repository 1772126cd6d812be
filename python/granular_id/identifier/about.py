"""What a model says about itself: what it was trained on, and how well it may be expected to do."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from granular_id import _core
from granular_id.best import Choice
from granular_id.evaluation.comparison import MIN_PARTITIONS
from granular_id.evaluation.describe import describe_data, versions
from granular_id.evaluation.metrics import confusion_counts, recall_per_class
from granular_id.evaluation.statistics import corrected_interval
from granular_id.identifier.held_out import HeldOut
from granular_id.identifier.recipe import Recipe
from granular_id.recording import Dataset
from granular_id.recording.setup import setups_in, values_in

__all__ = ["axes_of", "begins_at_first", "choice_of", "described", "estimate_of", "lead_of"]


def axes_of(core: _core.Model) -> tuple[str, ...]:
    """Return the names of the axes of a model."""
    return tuple(json.loads(core.metadata["axes"]))


def lead_of(core: _core.Model) -> float | None:
    """Return the seconds of rest ahead of the trigger, where the recordings of the training agree on them."""
    text = core.metadata["lead_s"]
    return float(text) if text else None


def begins_at_first(core: _core.Model) -> bool:
    """Whether the recordings of the training were cropped to begin at their first sample, with no lead in common."""
    if lead_of(core) is not None:
        return False
    history = json.loads(core.metadata["trained"]).get("history", [])
    crops = [step["parameters"] for step in history if step["step"] == "align"]
    return bool(crops) and all(crop.get("trigger", "unknown") is None for crop in crops)


def described(data: Dataset, recipe: Recipe) -> dict[str, Any]:
    """Return settings, recordings and the steps that prepared them, in types that JSON knows."""
    about = describe_data(data)
    labels, counts = np.unique(data.y, return_counts=True)
    sessions = {session for session in data.sessions.tolist() if session is not None}
    return {
        "settings": recipe.to_dict(data.rate_hz),
        "synthetic": data.is_synthetic,
        "recordings": dict(zip(labels.tolist(), counts.tolist(), strict=True)),
        "n_sessions": len(sessions),
        "n_triggers": sum(recording.trigger_index is not None for recording in data),
        "setup": values_in(setups_in(data)),
        # Rows name files: a model is handed on, and says what was done, not to which file.
        "history": [
            {key: step[key] for key in ("step", "parameters", "totals")} for step in about["history"]
        ],
        "versions": versions(),
    }


def estimate_of(held: HeldOut, classes: Sequence[str]) -> dict[str, Any]:
    """Return the accuracy on held-out recordings and how it was found, in types that JSON knows.

    The accuracy is the mean over partitions; its interval is corrected for the recordings that they share, and None
    with fewer than three partitions or where all agree.
    """
    shares = held.fold_accuracies()
    low, high = math.nan, math.nan
    if len(shares) >= MIN_PARTITIONS:
        n_train, n_test = (
            float(np.mean([getattr(partition, part).size for partition in held.partitions]))
            for part in ("train", "test")
        )
        low, high = corrected_interval(shares, n_train, n_test)
    confusion = confusion_counts(held.truth, held.winners[:, -1], len(classes))
    recall = recall_per_class(confusion).tolist()
    return {
        "protocol": held.protocol,
        "held_out": held.held_out,
        "note": held.note,
        "n_partitions": len(held.partitions),
        "n_answers": len(held.rows),
        "accuracy": float(shares.mean()),
        "interval_95": None if math.isnan(low) else [low, high],
        "recall": dict(zip(classes, recall, strict=True)),
    }


def choice_of(choice: Choice, held: HeldOut | None) -> dict[str, Any]:
    """Return what the model chose, and what those of the estimate chose, in types that JSON knows."""
    elsewhere = [] if held is None else zip(held.partitions, held.chosen, strict=True)
    return {
        **choice.to_dict(),
        "in_partitions": [
            {
                "partition": partition.description,
                "chosen": list(chosen.names),
                "note": chosen.note,
                "accuracy_on_the_folds_that_chose": chosen.together,
            }
            for partition, chosen in elsewhere
            if chosen is not None
        ],
    }
