"""The options of the method: filter, histogram, feature space, classifier."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from granular_id._core import GranularIdError
from granular_id.cli.errors import OPTIONS
from granular_id.cli.options import above_zero, count, names_in, numbers_in, option, with_defaults

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

    from granular_id.spaces import FeatureSpace

PANEL = "Method"


@dataclass(kw_only=True)
class Method:
    """Features, and what is done with them."""

    cutoff_hz: float = option(PANEL, "High-pass cut-off of the histogram.", default=23.0, callback=above_zero)
    order: int = option(PANEL, "High-pass order.", default=8)
    n_bins: int = option(PANEL, "Bins per axis.", default=100)
    bin_range: str = option(PANEL, "LOW,HIGH in N and N m; auto: learned per axis.", default="-1.5,1.5")
    initial: Literal["zero", "steady"] = option(
        PANEL,
        "High-pass starts at rest (the paper), or as if the first sample had lasted.",
        default="zero",
    )
    tare_s: float | None = option(
        PANEL, "Subtract the mean of the first seconds, before the motion.", callback=above_zero
    )
    threads: int | None = option(
        PANEL, "The numbers do not depend on it. Default: all cores.", callback=count(1)
    )
    block_weights: Literal["plain", "unit"] = option(
        PANEL,
        "Blocks side by side as they are (the paper), or each of unit mean norm.",
        default="plain",
    )
    c: float = option(
        PANEL,
        "Box constraint of the support vector machines. Not of best and multiband, which bring their own.",
        "--C",
        default=1.0,
        callback=above_zero,
    )

    def __post_init__(self) -> None:
        self.settings: dict[str, Any] = {
            "cutoff_hz": self.cutoff_hz,
            "order": self.order,
            "n_bins": self.n_bins,
            "bin_range": _bin_range_of(self.bin_range),
            "initial": self.initial,
            "tare_s": self.tare_s,
            "block_weights": None if self.block_weights == "plain" else "unit",
        }

    @property
    def n_jobs(self) -> int:
        """Threads of the work after the features."""
        return -1 if self.threads is None else self.threads

    def refuse_impossible(self, rate_hz: float | None) -> None:
        """Refuse what no recording could have; whether the cut-off fits is known where a rate is asked for."""
        from granular_id.features import FeatureSpec

        names = ("order", "n_bins", *([] if self.settings["bin_range"] == "auto" else ["bin_range"]))
        spec = {name: self.settings[name] for name in names}
        if rate_hz is not None:
            spec |= {"rate_hz": rate_hz, "cutoff_hz": self.cutoff_hz}
        FeatureSpec(**spec)

    def spaces(self, rate_hz: float) -> dict[str, FeatureSpace]:
        """Return every feature space with these settings, for recordings of a rate."""
        from granular_id.spaces import feature_spaces

        return feature_spaces(rate_hz=rate_hz, threads=self.threads, **self.settings)

    def unused_in(self, names: Sequence[str]) -> list[str]:
        """Refuse what would change nothing in any of several feature spaces; say where else it changes nothing.

        Returns one note for each option that only some of the spaces have a use for.
        """
        unused = self._unused(names)
        notes = []
        for name in dict.fromkeys(name for reasons in unused.values() for name in reasons):
            without = [space for space, reasons in unused.items() if name in reasons]
            if len(without) == len(unused):
                reason = unused[without[0]][name] if len(without) == 1 else "have no use for it"
                raise GranularIdError(
                    f"{OPTIONS[name]} must be left out with --spaces {','.join(without)}, which {reason}"
                )
            notes.append(f"{OPTIONS[name]} changes nothing in {', '.join(without)}")
        return notes

    def given(self) -> dict[str, Any]:
        """Return the settings that are not the usual ones."""
        usual = with_defaults(Method).settings
        given = {name: value for name, value in self.settings.items() if value != usual[name]}
        return given if self.c == 1 else given | {"C": self.c}

    def _unused(self, names: Sequence[str]) -> dict[str, dict[str, str]]:
        """Find options that were given and would change nothing: for each feature space names, and why."""
        given = self.given()
        if not given:
            return {name: {} for name in names}
        known = self.spaces(500.0)
        return {name: _without_use(known[name], given) for name in names}


@dataclass(kw_only=True)
class OneSpace(Method):
    """The method in one feature space."""

    space: str = option(
        PANEL,
        "Feature space. best: multi-band, blocks, whitening and C chosen on recordings held out; multiband: the "
        "same without a choice; raw+hfmh: the paper's.",
        default="best",
    )

    def refuse_unused(self) -> None:
        """Refuse what was asked for and would change nothing in the feature space."""
        known_spaces(self.space)
        for name, reason in self._unused((self.space,))[self.space].items():
            raise GranularIdError(
                f"{OPTIONS[name]} must be left out with --space {self.space}, which {reason}"
            )

    def pipeline(self, rate_hz: float) -> Pipeline:
        """Return the feature space with its own classifier, or the paper's, unfitted."""
        from granular_id.ecoc import ECOCClassifier
        from granular_id.score import space_pipeline

        space = self.spaces(rate_hz)[self.space]
        return space_pipeline(space.transformer, space.classifier or ECOCClassifier(C=self.c))


def _without_use(space: FeatureSpace, given: Mapping[str, Any]) -> dict[str, str]:
    """Say which of the options given a feature space has no use for, and why."""
    takes = {key.rpartition("__")[2]: value for key, value in space.transformer.get_params().items()}
    reasons = {
        key: "has no use for it" for key, value in given.items() if key != "C" and takes.get(key) != value
    }
    if "block_weights" in reasons:
        alike = "blocks" in takes  # those of multi-band features, which `BlockScaler` makes alike
        joined = "takes its blocks as they are" if "transformer_list" in takes else "has a single block"
        reasons["block_weights"] = "always weighs its blocks alike" if alike else joined
    if "C" in given and space.classifier is not None:
        reasons["C"] = "brings its own classifier"
    return reasons


def _bin_range_of(text: str) -> Literal["auto"] | tuple[float, float]:
    """Read ``--bin-range``."""
    if text == "auto":
        return "auto"
    low, high = numbers_in("--bin-range", text, "LOW,HIGH such as -1.5,1.5, or auto", 2)
    return low, high


def known_spaces(*names: str) -> None:
    """Refuse a name that no feature space has."""
    from granular_id.spaces import feature_spaces

    known = feature_spaces()
    for name in names:
        if name not in known:
            raise GranularIdError(f"there is no feature space {name!r}; there are {', '.join(known)}")


def chosen_spaces(spaces: str, confusion: str | None = None) -> list[str]:
    """Read ``--spaces`` and ``--confusion``: names in the order given."""
    from granular_id.spaces import all_spaces, feature_spaces, paper_spaces

    if spaces == "all":
        chosen = all_spaces(feature_spaces())
    elif spaces == "paper":
        chosen = paper_spaces(feature_spaces())
    else:
        chosen = names_in(spaces)
    known_spaces(*chosen, *([] if confusion is None else [confusion]))
    if not chosen:
        raise GranularIdError(f"--spaces must name at least one feature space, got {spaces!r}")
    if len(set(chosen)) < len(chosen):
        raise GranularIdError(f"--spaces must name each feature space once, got {spaces!r}")
    if confusion is not None and confusion not in chosen:
        raise GranularIdError(
            f"--confusion {confusion} is not among the spaces evaluated: {', '.join(chosen)}"
        )
    return chosen
