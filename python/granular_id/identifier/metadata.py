"""The shape of what a model file says of its training: files come from anywhere, and readers rely on it."""

from __future__ import annotations

import json
from typing import Any

from granular_id import _core

_EACH = "each"
"""In a form: every value of the object, whatever its name."""

_ESTIMATE = {
    "held_out": str,
    "note": str,
    "n_partitions": int,
    "n_answers": int,
    "accuracy": float,
    "interval_95": ([float, float], None),
    "recall": {_EACH: float},
}
_EARLY = {"why_not": str, "target_error": float}
_EARLY_OUTCOME = {"answered_early": float, "error": float, "mean_seconds": float}
_MACHINE = {"name": str, "chosen": bool, "accuracies": [float, ...]}
_CHOICE = {
    "note": str,
    "random_state": (int, None),
    "machines": [_MACHINE, ...],
    "chosen": [str, ...],
    "accuracy_on_the_folds_that_chose": (float, None),
    "in_partitions": [{"chosen": [str, ...]}, ...],
}
_FORMS: dict[str, Any] = {
    "settings": {"space": str},
    "synthetic": bool,
    "recordings": {_EACH: int},
    "n_sessions": int,
    "n_triggers": int,
    "setup": {_EACH: [str, ...]},
    "recording_marks": str,
    "history": [{"step": str, "parameters": {}}, ...],
    "estimate": (_ESTIMATE, None),
    "why_no_estimate": str,
    "early": (_EARLY, None),
    "choice": _CHOICE,
    "left_out": str,
    "notes": [str, ...],
}
_NAMES = {str: "text", int: "a whole number", float: "a number", bool: "true or false"}


def check_known(known: Any) -> None:
    """Check the parts that are there; none of them has to be, and others are not looked at.

    Parameters
    ----------
    known : object
        As JSON gave it.

    Raises
    ------
    TypeError, ValueError
        The first part of another shape: its name, what came, and what is wanted.

    Examples
    --------
    >>> check_known({"recordings": {"rice": 20}, "notes": []})
    >>> check_known({"recordings": 3})
    Traceback (most recent call last):
        ...
    TypeError: recordings must be an object, got 3
    """
    _check("what is known", known, {})
    for name, form in _FORMS.items():
        if name in known:
            _check(name, known[name], form)
    if (known.get("early") or {"why_not": "-"})["why_not"] == "":  # there is an outcome
        _check("early", known["early"], _EARLY_OUTCOME)
    if "choice" in known and not known["choice"]["machines"]:
        raise ValueError("choice.machines must hold at least one, got []")


def _check(name: str, value: Any, form: Any) -> None:
    if isinstance(form, tuple):  # of a form, or null
        if value is not None:
            _check(name, value, form[0])
    elif isinstance(form, dict):
        if not isinstance(value, dict):
            raise TypeError(f"{name} must be an object, got {value!r:.80}")
        for key, own in form.items():
            for part in value if key == _EACH else [key]:
                if part not in value:
                    raise ValueError(f"{name} must hold {part!r}, got {sorted(value)!r:.80}")
                _check(f"{name}.{part}", value[part], own)
    elif isinstance(form, list):
        same = form[-1] is ...
        if not isinstance(value, list) or not (same or len(value) == len(form)):
            raise TypeError(f"{name} must be a list{'' if same else f' of {len(form)}'}, got {value!r:.80}")
        for k, part in enumerate(value):
            _check(f"{name}[{k}]", part, form[0])
    elif not isinstance(value, (int, float) if form is float else form) or (
        isinstance(value, bool) and form is not bool
    ):
        raise TypeError(f"{name} must be {_NAMES[form]}, got {value!r:.80}")


# What a model says about itself: what it was trained on, and how well it may be expected to do.


# A model in words: what it was trained on, what it takes, how well it did on recordings held out.


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
