"""The options of the method: filter, histogram, start of the filter, classifier."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any

from granular_id.cli.groups import option
from granular_id.cli.settings import at_least, bin_range_of, known_spaces, method_fits, positive

if TYPE_CHECKING:
    from granular_id.spaces import FeatureSpace

__all__ = ["BlockWeights", "Method", "Space", "Weights"]

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

    def refuse_unused(self, space: str, weights: Weights, cost: float | None = None) -> None:
        """Refuse what was asked for and would change nothing: options that a feature space does not have.

        `cost`: ``--C``, where only spaces without a classifier of their own have a use for it.
        """
        known_spaces(space)
        made = self.spaces(500.0, weights)[space]
        takes = {name.rpartition("__")[2]: value for name, value in made.transformer.get_params().items()}
        usual = {**Method()._options, "block_weights": Weights.plain.value}
        given = {**self._options, "block_weights": weights.value}
        unused = [name for name, value in given.items() if value not in (usual[name], takes.get(name))]
        if unused:
            raise ValueError(f"{unused[0]} must be left out with space={space!r}, which has no use for it")
        if cost is not None and cost != 1 and made.classifier is not None:
            raise ValueError(f"C must be left out with space={space!r}, which brings its own classifier")

    def of_model(self) -> dict[str, Any]:
        """Return the settings as `granular_id.identifier.Identifier.fit` takes them."""
        if self._options["tare_s"] is not None:
            raise ValueError(
                "--tare-s is not for models, which take samples as they come: leave it out; --initial steady keeps an "
                "offset of the sensor out of the histogram"
            )
        return {name: value for name, value in self._options.items() if name != "tare_s"}

    @property
    def n_jobs(self) -> int:
        """Threads of the work after the features."""
        return -1 if self.threads is None else self.threads
