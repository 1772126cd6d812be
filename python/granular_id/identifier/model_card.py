"""What a model says of itself: what it was trained on, what it takes, and how well it did on held-out recordings."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import shorten
from typing import Any

import numpy as np

from granular_id import _core
from granular_id._text import counted, fixed, percent, whole_percent
from granular_id.features import FeatureSpec
from granular_id.identifier.early import outcome_text
from granular_id.identifier.model import ADAPTED, TrainedModel
from granular_id.recording import SEVERE_PREFIXES, labelled_check_note

_MOST_NOTES = 8
_PARSED = ("axes", "units", "trained", "lead_s")


def describe_model(model: TrainedModel) -> list[str]:
    """Say what a model takes, knows and was trained on, one line each; without the estimates."""
    core, spec, trained = model.core, model.spec, model.trained
    lines = []
    if model.synthetic:
        lines.append(
            "SYNTHETIC: trained on simulated recordings; its answers say nothing about real materials"
        )
    lines.append(f"materials: {len(model.classes)}: {shorten(', '.join(model.classes), 400)}")
    counts = sorted(trained.get("recordings", {}).values())
    if counts:
        span = f"{counts[0]}" if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]}"
        sessions = trained.get("n_sessions", 0)
        within = f", {counted(sessions, 'session')}" if sessions else ""
        lines.append(f"trained on: {sum(counts)} recordings, {span} of each material{within}")
    background = trained.get("background", {})
    if background:
        counts = [f"{name} ({n})" for name, n in background.items()]
        lines.append(f"background, never named: {shorten(', '.join(counts), 400)}")
    seconds = f"{model.n_samples / model.rate_hz:g} s"
    lead = "not known, or not the same in all recordings"
    if model.lead_s is not None:
        lead = f"{model.lead_s:g} s"
    elif model.requirements.at_first:
        lead = "not known, recordings begin at their first sample"
    units = " and ".join(dict.fromkeys(model.units)) if all(model.units) else ""
    lines += [
        f"takes: {model.n_samples} samples at {model.rate_hz:g} Hz ({seconds}) of {' '.join(model.axes)}; rest ahead "
        f"of the motion: {lead}",
        f"features: {model.space}, {core.n_features} numbers{_content(spec, units)}",
        f"classifier: {counted(core.n_learners, 'learner')}, {core.loss} loss",
        f"size: {len(core.to_bytes()) / 2**20:.2f} MiB",
        f"made by: granular-id {core.metadata['library_version']} from {core.metadata['training_sha256'][:16] or '?'}",
    ]
    setup = trained.get("setup")
    if setup:
        lines.append("set-up, compared with that of other recordings:")
        lines += [f"  {name}: {' or '.join(values)}" for name, values in setup.items()]
    else:
        lines.append("set-up: not stated; none is compared")
    return lines


def describe_performance(model: TrainedModel) -> list[str]:
    """Say how a model did on recordings held out, what it chose there, and when it answers early, one line each."""
    trained = model.trained
    lines = [
        *([f"adapted: {trained[ADAPTED]}"] if ADAPTED in trained else []),
        *_estimate(model, trained.get("estimate")),
        *_choice(trained.get("choice")),
        f"early answers: {_early(model, trained.get('early'))}",
        *_confidence(model),
    ]
    if trained.get("left_out"):
        lines.append(f"note: {trained['left_out']}")
    notes = trained.get("notes", [])
    lines += [
        labelled_check_note(note) if note.startswith(SEVERE_PREFIXES) else f"note: {note}"
        for note in notes[:_MOST_NOTES]
    ]
    if len(notes) > _MOST_NOTES:
        lines.append(f"note: {len(notes) - _MOST_NOTES} more, see --json")
    return lines


def model_facts(model: TrainedModel) -> dict[str, Any]:
    """Return everything that a model file holds but the weights, in types that JSON knows."""
    core = model.core
    texts = {name: text for name, text in sorted(core.metadata.items()) if name not in _PARSED}
    settings = core.spec.__getnewargs_ex__()[1]
    spec = {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in settings.items()
    }
    if not isinstance(core.spec, FeatureSpec):
        spec |= {"bands": core.spec.bands, "block_sizes": core.spec.block_sizes}
    return {
        **texts,
        "classes": list(model.classes),
        "space": model.space,
        "spec": spec,
        "n_samples": model.n_samples,
        "rate_hz": model.rate_hz,
        "lead_s": model.lead_s,
        "axes": list(model.axes),
        "units": list(model.units),
        "n_features": core.n_features,
        "n_learners": core.n_learners,
        "loss": core.loss,
        "early": None if core.early is None else core.early.tolist(),
        "trained": model.trained,
    }


def _content(spec: FeatureSpec | _core.MultiBandExtractor, units: str) -> str:
    if not isinstance(spec, FeatureSpec):
        blocks = ", ".join(f"{size} {name}" for name, size in spec.block_sizes.items())
        return f": {blocks}"
    if not spec.hfmh:
        return ""
    ranges = spec.bin_range
    if isinstance(ranges[0], tuple):
        within = "ranges of each axis"
    else:
        within = f"{ranges[0]:g} to {ranges[1]:g} {units}".rstrip()
    return f"; histogram of {spec.n_bins} bins, {within}, above {spec.cutoff_hz:g} Hz"


def _estimate(model: TrainedModel, estimate: Mapping[str, Any] | None) -> list[str]:
    if not estimate:
        return [f"accuracy: not known: {model.trained.get('why_no_estimate') or 'not measured'}"]
    interval = estimate["interval_95"]
    within = "" if interval is None else f" (95 %: {100 * interval[0]:.1f} to {100 * interval[1]:.1f})"
    lines = [
        f"accuracy, {estimate['held_out']}{' (SYNTHETIC recordings)' if model.synthetic else ''}: "
        f"{percent(estimate['accuracy'])}{within}, "
        f"{estimate['n_answers']} answers in {estimate['n_folds']} folds",
        f"  {estimate['note']}",
    ]
    weak = sorted(
        (share, label) for label, share in estimate["recall"].items() if share is not None and share < 1
    )
    if weak:
        least = ", ".join(f"{label} {whole_percent(100 * share)} %" for share, label in weak[:5])
        lines.append(f"  least recognised: {least}")
    lines += [f"  not tested: {label}, {why}" for label, why in estimate["untested"].items()]
    return lines


def _choice(choice: Mapping[str, Any] | None) -> list[str]:
    """Say what was chosen of what, on which recordings, and how often the models of the estimate chose the same."""
    if not choice:
        return []
    chosen, elsewhere = choice["chosen"], choice["in_folds"]
    seed = "" if choice["random_state"] is None else f"; seed {choice['random_state']}"
    lines = [
        f"chosen: {len(chosen)} of {len(choice['machines'])} candidate models, on {choice['note']}{seed}"
    ]
    for machine in choice["machines"]:
        if machine["name"] in chosen:
            shares = machine["accuracies"]
            reached = f"{100 * sum(shares) / len(shares):.1f} % held out" if shares else "nothing held out"
            times = sum(machine["name"] in one["chosen"] for one in elsewhere)
            again = f", chosen {times} of {len(elsewhere)} times in the estimate" if elsewhere else ""
            lines.append(f"  {machine['name']}: {reached}{again}")
    together = choice["accuracy_on_the_folds_that_chose"]
    if together is not None:
        lines.append(
            f"  {percent(together)} together, on the recordings that chose: not what to expect of new ones"
        )
    return lines


def _early(model: TrainedModel, outcome: Mapping[str, Any] | None) -> str:
    table = model.core.early
    if table is None:
        why = "" if outcome is None else outcome.get("why_not", "")
        return f"none{': ' + why if why else _why_none(model.trained)}"
    n_seen, margin = table[0].tolist()
    first = f"from {fixed(n_seen / model.rate_hz, 2)} s on, with a margin of {margin:.3g} or more"
    if not outcome:
        return first
    return f"{first}; {outcome_text(**{name: value for name, value in outcome.items() if name != 'why_not'})}"


def _confidence(model: TrainedModel) -> list[str]:
    """Say what probabilities, candidates and refusals are worth."""
    candidates, unknown = model.confidence_rules()
    none = f"none{_why_none(model.trained)}"
    return [
        f"probabilities: {none if model.temperature is None else 'set on held-out recordings'}",
        f"candidates: {none if candidates is None else candidates.promise}",
        f"unknown materials: {none if unknown is None else unknown.promise}",
    ]


def _why_none(trained: Mapping[str, Any]) -> str:
    """Say that nothing was held out to set rules on, or nothing since, where that is why there are none."""
    if ADAPTED in trained:
        return ": the model was adapted since"
    return "" if trained.get("estimate") else ": no recordings were held out"
