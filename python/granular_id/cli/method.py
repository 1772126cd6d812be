"""The options of the method: filter, histogram, start of the filter, classifier."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any

from granular_id.cli.errors import in_options
from granular_id.cli.groups import option
from granular_id.cli.settings import at_least, bin_range_of, known_spaces, method_fits, positive

if TYPE_CHECKING:
    from granular_id.spaces import FeatureSpace

__all__ = ["ONE_VS_ONE", "BlockWeights", "Method", "Space", "Weights"]

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
        from granular_id.spaces import feature_spaces  # noqa: PLC0415 (slow to import: --help must not wait)

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
