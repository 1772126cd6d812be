"""The options of the method: filter, histogram, start of the filter, classifier."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from granular_id.cli.errors import in_options

if TYPE_CHECKING:
    from granular_id.spaces import FeatureSpace
# Values of options, checked before any file is read.


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
    from granular_id.features import FeatureSpec

    positive("--cutoff-hz", cutoff_hz)
    settings: dict[str, Any] = {"order": order, "n_bins": n_bins}
    if bin_range != "auto":
        settings["bin_range"] = bin_range
    if rate_hz is not None:
        settings.update(rate_hz=rate_hz, cutoff_hz=cutoff_hz)
    FeatureSpec(**settings)


def known_spaces(*names: str) -> None:
    """Refuse a name that no feature space has."""
    from granular_id.spaces import feature_spaces

    known = feature_spaces()
    for name in names:
        if name not in known:
            raise ValueError(f"there is no feature space {name!r}; there are {', '.join(known)}")


def of_paper() -> list[str]:
    """Names of the feature spaces of the paper's table, the best there first."""
    from granular_id.evaluation import in_paper_order
    from granular_id.spaces import feature_spaces

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


# Groups of options that several commands share, each written once.


def option(names: str, panel: str, text: str) -> Any:
    """Return an option, its names separated by blanks, with its help in one of the panels of ``--help``."""
    return typer.Option(*names.split(), help=text, rich_help_panel=panel)


def taking(*groups: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the parameters of some classes; it gets an instance of each as its first arguments.

    typer reads options off the signature of a function. A class whose constructor is such a signature, and
    checks the values, is a group of options. The order on the command line: positional arguments of the
    groups, of the command, then all options.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[len(groups) :]
        of_group = [list(inspect.signature(group, eval_str=True).parameters.values()) for group in groups]
        every = [parameter for parameters in (*of_group, own) for parameter in parameters]
        ordered = sorted(every, key=lambda parameter: parameter.kind)
        signature = inspect.Signature(ordered)

        def run(*args: Any, **kwargs: Any) -> None:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            values = bound.arguments
            made = [
                group(**{parameter.name: values.pop(parameter.name) for parameter in parameters})
                for group, parameters in zip(groups, of_group, strict=True)
            ]
            command(*made, **values)

        run.__name__, run.__doc__, run.__module__ = command.__name__, command.__doc__, command.__module__
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in ordered}
        return run

    return decorate


ONE_VS_ONE = "onevsone"
"""Default of ``--coding``, the paper's."""

PANEL = "Method"


class Initial(str, Enum):
    """Choices of ``--initial``."""

    zero = "zero"
    steady = "steady"


class Weights(str, Enum):
    """Choices of ``--block-weights``."""

    plain = "plain"
    unit = "unit"


Space = Annotated[
    str,
    option(
        "--space",
        PANEL,
        "Feature space. best: multi-band, blocks, whitening and C chosen on recordings held out; multiband: the "
        "same without a choice; raw+hfmh: the paper's.",
    ),
]

BlockWeights = Annotated[
    Weights,
    option(
        "--block-weights", PANEL, "Blocks side by side as they are (the paper), or each of unit mean norm."
    ),
]


class Method:
    """What features are made of, with every option checked as far as that goes without recordings."""

    def __init__(
        self,
        *,
        cutoff_hz: Annotated[
            float, option("--cutoff-hz", PANEL, "High-pass cut-off of the histogram.")
        ] = 23.0,
        order: Annotated[int, option("--order", PANEL, "High-pass order.")] = 8,
        n_bins: Annotated[int, option("--n-bins", PANEL, "Bins per axis.")] = 100,
        bin_range: Annotated[
            str, option("--bin-range", PANEL, "LOW,HIGH in N and N m; auto: learned per axis.")
        ] = "-1.5,1.5",
        initial: Annotated[
            Initial,
            option(
                "--initial",
                PANEL,
                "High-pass starts at rest (the paper), or as if the first sample had lasted.",
            ),
        ] = Initial.zero,
        tare_s: Annotated[
            float | None,
            option("--tare-s", PANEL, "Subtract the mean of the first seconds, before the motion."),
        ] = None,
        threads: Annotated[
            int | None, option("--threads", PANEL, "The numbers do not depend on it. Default: all cores.")
        ] = None,
    ) -> None:
        at_least("--threads", threads, 1)
        positive("--tare-s", tare_s)
        self.threads = threads
        self._options: dict[str, Any] = {
            "cutoff_hz": cutoff_hz,
            "order": order,
            "n_bins": n_bins,
            "bin_range": bin_range_of(bin_range),
            "initial": initial.value,
            "tare_s": tare_s,
        }

    def fits(self, rate_hz: float | None) -> None:
        """Refuse settings that no recording could have; the cut-off is checked when the rate is known."""
        names = ("cutoff_hz", "order", "n_bins", "bin_range")
        method_fits(rate_hz=rate_hz, **{name: self._options[name] for name in names})

    def spaces(self, rate_hz: float, weights: Weights = Weights.plain) -> dict[str, FeatureSpace]:
        """Return every feature space with these settings, for recordings of a rate."""
        from granular_id.spaces import feature_spaces

        return feature_spaces(
            rate_hz=rate_hz,
            block_weights=None if weights is Weights.plain else weights.value,
            threads=self.threads,
            **self._options,
        )

    def refuse_unused(
        self, space: str, weights: Weights, cost: float | None = None, coding: str = ONE_VS_ONE
    ) -> None:
        """Refuse what was asked for and would change nothing: options that a feature space does not have.

        `cost`: ``--C``, where only spaces without a classifier of their own have a use for it.
        """
        known_spaces(space)
        for name, reason in self._unused((space,), weights, cost, coding)[space].items():
            raise ValueError(f"{name} must be left out with space={space!r}, which {reason}")

    def unused_in(
        self, spaces: Sequence[str] | None, weights: Weights, cost: float | None = None
    ) -> list[str]:
        """Refuse what would change nothing in any of several feature spaces; say where else it changes nothing.

        Parameters
        ----------
        spaces : sequence of str or None
            None: all.
        weights : Weights
        cost : float, optional
            As in `refuse_unused`.

        Returns
        -------
        list of str
            One note for each option that only some of the spaces have a use for.
        """
        unused = self._unused(spaces, weights, cost)
        notes = []
        for name in dict.fromkeys(name for reasons in unused.values() for name in reasons):
            without = [space for space, reasons in unused.items() if name in reasons]
            if len(without) == len(unused):
                reason = unused[without[0]][name] if len(without) == 1 else "have no use for it"
                raise ValueError(f"{name} must be left out with spaces={','.join(without)!r}, which {reason}")
            notes.append(in_options(f"{name}= changes nothing in {', '.join(without)}"))
        return notes

    def _unused(
        self, spaces: Sequence[str] | None, weights: Weights, cost: float | None, coding: str = ONE_VS_ONE
    ) -> dict[str, dict[str, str]]:
        """Find options that were given and would change nothing: for each feature space names, and why."""
        usual = {**Method()._options, "block_weights": Weights.plain.value}
        given = {**self._options, "block_weights": weights.value}
        given = {name: value for name, value in given.items() if value != usual[name]}
        if not given and cost in (None, 1) and coding == ONE_VS_ONE:
            return {space: {} for space in spaces or ()}
        known = self.spaces(500.0, weights)
        found = {}
        for space in spaces or known:
            transformer, classifier = known[space].transformer, known[space].classifier
            takes = {name.rpartition("__")[2]: value for name, value in transformer.get_params().items()}
            reasons = {name: "has no use for it" for name, value in given.items() if takes.get(name) != value}
            if "block_weights" in reasons:
                alike = "blocks" in takes  # those of multi-band features, which `BlockScaler` makes alike
                reasons["block_weights"] = "always weighs its blocks alike" if alike else "has a single block"
            if cost not in (None, 1) and classifier is not None:
                reasons["C"] = "brings its own classifier"
            if coding != ONE_VS_ONE and space == "best":
                reasons["coding"] = "is always one-vs-one"
            found[space] = reasons
        return found

    def of_model(self, space: str) -> dict[str, Any]:
        """Return the settings as `granular_id.identifier.Identifier.fit` takes them."""
        if self._options["tare_s"] is not None:
            steady = "; --initial steady keeps an offset of the sensor out of the histogram"
            raise ValueError(
                "--tare-s is not for models, which take samples as they come: leave it out"
                f"{steady if 'hfmh' in space else ''}"
            )
        return {name: value for name, value in self._options.items() if name != "tare_s"}

    @property
    def n_jobs(self) -> int:
        """Threads of the work after the features."""
        return -1 if self.threads is None else self.threads
