"""``figures``: the figures of a report as files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import made_folder
from granular_id.evaluation.partition import PROTOCOLS
from granular_id.evaluation.protocol_names import protocol_name
from granular_id.evaluation.tables import shows_paper
from granular_id.plotting import (
    plot_accuracy,
    plot_confusion,
    plot_gap,
    plot_hfmh,
    plot_mean_forces,
    plot_recall,
    plot_residual,
    plot_weights,
)

if TYPE_CHECKING:
    from granular_id.evaluation.result import EvaluationResult

__all__ = ["FIGURES", "figures"]

FIGURES = (
    *("accuracy", "gap", "recall", *(f"confusion_{protocol}" for protocol in PROTOCOLS)),
    *("mean_forces", "residual", "hfmh", "weights"),
)
"""Names of all figures that there may be, without their endings."""


def figures(
    result: EvaluationResult,
    folder: str | os.PathLike[str],
    formats: str | Sequence[str] = ("png", "svg"),
    *,
    space: str | None = None,
) -> list[Path]:
    """Write the figures of a report as files.

    Parameters
    ----------
    result : EvaluationResult
    folder : path-like
        Made where it is missing. Files of the same names are replaced.
    formats : str or sequence of str
        Endings that matplotlib knows: png, svg, pdf, ...
    space : str, optional
        Whose gap, confusion and recall are shown; default: the best under random draws.

    Returns
    -------
    list of Path
        What was written: accuracy, gap, recall, ``confusion_PROTOCOL`` and, as far as the result knows the
        recordings (`EvaluationResult.portrait`), mean_forces, residual, hfmh and weights.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For an unknown format or space.
    OSError
        A file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", "paper", n_partitions=3, train_per_class=4, test_per_class=2)
    >>> written = figures(result, tempfile.mkdtemp(), "svg")
    >>> [path.name for path in written[:3]]
    ['accuracy.svg', 'gap.svg', 'recall.svg']
    """
    endings = [formats] if isinstance(formats, str) else list(formats)
    if not endings:
        raise ValueError("formats must name at least one ending, such as png, got none")
    chosen = result.space(space).name if space is not None else result.best_space(result.random)
    written = []
    with made_folder(folder) as place:
        for name, plot in _plots(result, chosen).items():
            for ending in endings:
                path = place / f"{name}.{ending.removeprefix('.')}"
                plot(path)
                written.append(path)
    return written


def _plots(result: EvaluationResult, space: str) -> dict[str, Callable[[Path], Any]]:
    mark = ", SYNTHETIC recordings" if result.synthetic else ""
    plots: dict[str, Callable[[Path], Any]] = {
        "accuracy": lambda path: plot_accuracy(result, paper=shows_paper(result), path=path),
        "gap": lambda path: plot_gap(result, space, path=path),
        "recall": lambda path: plot_recall(result, space, path=path),
    }
    for protocol, partitions in result.partitions.items():
        title = f"{space}, {protocol_name(protocol, partitions)}{mark}"
        plots[f"confusion_{protocol}"] = partial(
            _plot_confusion, result.confusion(space, protocol), result.labels, title
        )
    portrait = result.portrait
    if portrait is not None:
        plots["mean_forces"] = lambda path: plot_mean_forces(portrait, path=path)
        if portrait.high_pass is not None:
            plots["residual"] = lambda path: plot_residual(portrait, path=path)
            plots["hfmh"] = lambda path: plot_hfmh(portrait, path=path)
        if portrait.weights:
            plots["weights"] = lambda path: plot_weights(portrait, path=path)
    return plots


def _plot_confusion(counts: NDArray[np.int64], labels: Sequence[str], title: str, path: Path) -> None:
    plot_confusion(counts, labels, title=title, path=path)
