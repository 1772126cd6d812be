"""Values of options, checked before any file is read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

__all__ = [
    "at_least",
    "between",
    "bin_range_of",
    "chosen_spaces",
    "direction_of",
    "known_spaces",
    "length_of",
    "method_fits",
    "names_in",
    "onsets_in",
    "positive",
]


def at_least(option: str, value: int | None, minimum: int) -> None:
    """Refuse a count below a minimum; None is no value at all."""
    if value is not None and value < minimum:
        wanted = "not be negative" if minimum == 0 else f"be at least {minimum}"
        raise ValueError(f"{option} must {wanted}, got {value}")


def positive(option: str, value: float | None, *, infinite: bool = False) -> None:
    """Refuse what is not positive, or not finite unless it may be infinite; None is no value at all."""
    if value is None or (value > 0 and (infinite or math.isfinite(value))):
        return
    raise ValueError(f"{option} must be positive{'' if infinite else ' and finite'}, got {value:g}")


def between(option: str, share: float) -> None:
    """Refuse what does not lie between 0 and 1."""
    if not 0 < share < 1:
        raise ValueError(f"{option} must lie between 0 and 1, got {share:g}")


def names_in(text: str) -> list[str]:
    """Split names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def length_of(text: str | None) -> int | Literal["shortest"] | None:
    """Read ``--n-samples``."""
    if text is None or text == "shortest":
        return "shortest" if text else None
    try:
        length = int(text)
    except ValueError:
        raise ValueError(f"--n-samples must be a whole number or 'shortest', got {text!r}") from None
    at_least("--n-samples", length, 1)
    return length


def onsets_in(texts: Sequence[str]) -> dict[str, float | None]:
    """Read ``--onset-at``: NAME=SECONDS, or NAME=none for a recording without an onset."""
    onsets: dict[str, float | None] = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        try:
            seconds = None if value == "none" else float(value)
        except ValueError:
            name = ""
        if not name:
            raise ValueError(f"--onset-at must be NAME=SECONDS or NAME=none, got {text!r}")
        if name in onsets:
            raise ValueError(f"--onset-at names {name!r} twice")
        onsets[name] = seconds
    return onsets


def direction_of(text: str) -> tuple[float, float, float]:
    """Read ``--direction``."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--direction must be X,Y,Z such as 0,-1,0, got {text!r}") from None
    return x, y, z


def bin_range_of(text: str) -> Literal["auto"] | tuple[float, float]:
    """Read ``--bin-range``."""
    if text == "auto":
        return "auto"
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--bin-range must be LOW,HIGH such as -1.5,1.5, or auto, got {text!r}") from None
    return low, high


def method_fits(
    *,
    rate_hz: float | None,
    cutoff_hz: float,
    order: int,
    n_bins: int,
    bin_range: Literal["auto"] | tuple[float, float],
) -> None:
    """Refuse settings of the histogram that no recording could have.

    Whether the cut-off lies below half the rate is only known here when the rate is asked for.
    """
    from granular_id.features import FeatureSpec  # noqa: PLC0415 (--help must not wait for numpy)

    positive("--cutoff-hz", cutoff_hz)
    settings: dict[str, Any] = {"order": order, "n_bins": n_bins}
    if bin_range != "auto":
        settings["bin_range"] = bin_range
    if rate_hz is not None:
        settings.update(rate_hz=rate_hz, cutoff_hz=cutoff_hz)
    FeatureSpec(**settings)


def known_spaces(*names: str) -> None:
    """Refuse a name that no feature space has."""
    from granular_id.spaces import feature_spaces  # noqa: PLC0415 (slow to import, and rarely needed this early)

    known = feature_spaces()
    for name in names:
        if name not in known:
            raise ValueError(f"there is no feature space {name!r}; there are {', '.join(known)}")


def of_paper() -> list[str]:
    """Names of the feature spaces of the paper's table, the best there first."""
    from granular_id.evaluation.plan import in_paper_order  # noqa: PLC0415 (slow to import)
    from granular_id.spaces import feature_spaces  # noqa: PLC0415

    known = feature_spaces()
    return [name for name in in_paper_order(known) if known[name].paper_accuracy is not None]


def chosen_spaces(spaces: str, confusion: str | None) -> list[str] | None:
    """Read ``--spaces`` and ``--confusion``.

    Returns
    -------
    list of str or None
        Names in the order given; None: all.
    """
    if spaces == "all" and confusion is None:
        return None
    chosen = None if spaces == "all" else of_paper() if spaces == "paper" else names_in(spaces)
    known_spaces(*(chosen or ()), *([] if confusion is None else [confusion]))
    if chosen is None:
        return None
    if not chosen:
        raise ValueError(f"--spaces must name at least one feature space, got {spaces!r}")
    if len(set(chosen)) < len(chosen):
        raise ValueError(f"--spaces must name each feature space once, got {spaces!r}")
    if confusion is not None and confusion not in chosen:
        raise ValueError(f"--confusion {confusion} is not among the spaces evaluated: {', '.join(chosen)}")
    return chosen
