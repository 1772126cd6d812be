"""Methods that `accuracy.py` compares: ours by the names they have in the package, and their peers.

A method makes two scikit-learn estimators: one from recordings (n, T, C) to features, one from features to labels.
Everything runs on one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec

from sklearn.base import BaseEstimator, TransformerMixin

import granular_id as gid
from accuracy_peers import (
    SHORTEST,
    TREES,
    catch22,
    hydra,
    multirocket_hydra,
    nearest,
    quant,
    rocket,
    samples,
    spectrum,
    svm,
)
from accuracy_stages import NotAvailableError, Setting, Stages
from granular_id import spaces
from granular_id.spaces.best import BestClassifier
from granular_id.spaces.multiband import ALL_BLOCKS

# -- ours -------------------------------------------------------------------------------------------------------------
# Add a candidate by name. One that the package does not have (yet) is reported as not available.

OURS: dict[str, tuple[str, ...]] = {
    "best": ("best",),
    "multiband+whitening": ("multiband", "BlockScaler", "WithinClassWhitening"),
    "multiband": ("multiband",),
    "raw+hfmh": ("raw+hfmh",),
    "hfmh": ("hfmh",),
    "raw": ("raw",),
}
"""Row to a key of `feature_spaces`, and classes of `granular_id.spaces` that follow it. Where none follow comes the
classifier that belongs to the space, which scales columns itself; else `ECOCClassifier`."""


@dataclass(frozen=True)
class Method:
    """One row of the table.

    Attributes
    ----------
    name : str
        For ``--only``.
    what : str
        Features and classifier in words.
    make : callable
        From a `Setting` to features and classifier, not fitted.
    ours : bool
    ablation : bool
        A part of ours, only run when asked for.
    needs : tuple of str
        Modules that must be installed.
    least : int
        Samples that a recording must have.
    """

    name: str
    what: str
    make: Callable[[Setting], Stages]
    ours: bool = False
    ablation: bool = False
    needs: tuple[str, ...] = ()
    least: int = 1

    @property
    def kind(self) -> str:
        """What ``--only`` calls all of its kind."""
        return "ablation" if self.ablation else "ours" if self.ours else "peers"

    def stages(self, setting: Setting) -> Stages:
        """Make features and classifier, or raise `NotAvailableError`."""
        missing = [module for module in self.needs if find_spec(module) is None]
        if missing:
            raise NotAvailableError(f"{' and '.join(missing)} not installed: see requirements-bench.txt")
        if setting.n_samples < self.least:
            raise NotAvailableError(
                f"needs at least {self.least} samples, recordings have {setting.n_samples}"
            )
        return self.make(setting)


class OurFeatures(TransformerMixin, BaseEstimator):
    """A feature space and steps behind it, which are told how many columns each block of the space has."""

    def __init__(self, space, steps=()):
        self.space = space
        self.steps = steps

    def fit_transform(self, X, y=None):
        rows = self.space.fit(X, y).transform(X)
        for step in self.steps:
            self.tell_blocks(step)
            rows = step.fit(rows, y).transform(rows)
        return rows

    def fit(self, X, y=None):
        self.fit_transform(X, y)
        return self

    def transform(self, X):
        rows = self.space.transform(X)
        for step in self.steps:
            rows = step.transform(rows)
        return rows

    def tell_blocks(self, estimator):
        """Name the blocks of columns to an estimator that asks for them."""
        spaces.tell_blocks(estimator, spaces.block_sizes(self.space))


def _our_space(names: tuple[str, ...]) -> Callable[[Setting], Stages]:
    def make(setting: Setting) -> Stages:
        # The paper's bins, +-1.5 N, are those of one sensor and one tool: here they are learned from training rows.
        known = spaces.feature_spaces(rate_hz=setting.rate_hz, bin_range="auto", threads=1)
        if names[0] not in known:
            raise NotAvailableError(f"feature_spaces() has no {names[0]!r}")
        least_hz = 2 * spaces.HFMH().cutoff_hz
        if "hfmh" in names[0] and setting.rate_hz <= least_hz:
            raise NotAvailableError(f"needs more than {least_hz:g} Hz, recordings have {setting.rate_hz:g}")
        space, steps = known[names[0]], []
        for name in names[1:]:
            if not hasattr(spaces, name):
                raise NotAvailableError(f"granular_id.spaces has no {name}")
            steps.append(getattr(spaces, name)())
        # A classifier of a space standardises columns: behind whitening that would undo a part of it.
        own = None if steps else space.classifier
        return OurFeatures(space.transformer, steps), own or gid.ECOCClassifier()

    return make


def _blocks(blocks: tuple[str, ...]) -> Callable[[Setting], Stages]:
    """The preset "best" of some blocks."""

    def make(setting: Setting) -> Stages:
        optional = ("level",) if "level" in blocks and len(blocks) > 1 else ()
        space = spaces.MultiBand(rate_hz=setting.rate_hz, blocks=blocks, threads=1)
        return OurFeatures(space), BestClassifier(optional_blocks=optional)

    return make


def _ours() -> Iterator[Method]:
    for name, steps in OURS.items():
        yield Method(name, ", ".join(steps), _our_space(steps), ours=True)


def _ablation() -> Iterator[Method]:
    for block in ALL_BLOCKS:
        yield Method(f"only-{block}", "best of one block", _blocks((block,)), ours=True, ablation=True)
    for block in ALL_BLOCKS:
        rest = tuple(other for other in ALL_BLOCKS if other != block)
        yield Method(f"without-{block}", "best of the others", _blocks(rest), ours=True, ablation=True)


METHODS: tuple[Method, ...] = (
    *_ours(),
    *_ablation(),
    Method("minirocket", "MiniRocket, ridge", rocket("MiniRocket"), needs=("aeon",), least=SHORTEST),
    Method("multirocket", "MultiRocket, ridge", rocket("MultiRocket"), needs=("aeon",), least=SHORTEST + 1),
    Method("hydra", "Hydra, ridge", hydra, needs=("aeon", "torch"), least=SHORTEST),
    Method(
        "multirocket+hydra",
        "MultiRocket beside Hydra, ridge",
        multirocket_hydra,
        needs=("aeon", "torch"),
        least=SHORTEST + 1,
    ),
    Method("quant", f"QUANT, {TREES} extra trees", quant, needs=("aeon", "torch"), least=3),
    Method("catch22+rf", f"Catch22 with mean and SD, {TREES} trees", catch22, needs=("aeon",)),
    Method("1nn", "nearest neighbour, Euclidean, axes standardised", nearest),
    Method("dft+svm", "abs(DFT), standardised, linear SVM", svm(spectrum)),
    Method("raw+svm", "samples, standardised, linear SVM", svm(samples)),
)
"""All rows, ours first; the first that ran is what the others are compared with."""


KINDS = ("ours", "peers", "ablation")
"""Names for all methods of a kind: the ablation has each block of "best" alone, and each left out."""


def chosen_methods(only: str | None, reference: str | None = None) -> list[Method]:
    """Methods by names separated by commas; a kind, `KINDS`, stands for all of it, None for ours and the peers.

    `reference`, if any, must be among them.

    Raises
    ------
    ValueError
        An unknown name; the message lists those that are known.
    """
    wanted = {"ours", "peers"} if only is None else {word.strip() for word in only.split(",")}
    known = [*KINDS, *(method.name for method in METHODS)]
    if unknown := sorted(wanted.difference(known)):
        raise ValueError(f"--only got {unknown[0]!r}, wanted names among {', '.join(known)}")
    chosen = [method for method in METHODS if method.name in wanted or method.kind in wanted]
    if reference is not None and reference not in {m.name for m in chosen}:
        listed = ", ".join(m.name for m in chosen)
        raise ValueError(f"--reference got {reference!r}, wanted a method of this run: {listed}")
    return chosen
