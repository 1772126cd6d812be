"""What `accuracy.py` prints and writes: accuracies, differences with their tests, seconds."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accuracy_run import Row
from granular_id.statistics import corrected_resampled_t, holm

COLUMNS = "ms per recording: features, fit, predict"


@dataclass(frozen=True)
class Compared:
    """One method beside the reference of its data set; differences are the method's less the reference's.

    Attributes
    ----------
    method : str
    mean, sd : float
        Of the accuracies over partitions, as shares of 1; SD is NaN for a single partition.
    difference : float
        Of the means; 0 for the reference itself.
    p_value, adjusted : float
        Corrected resampled t-test, and after Holm over all methods compared; NaN where it cannot be made.
    features_s : float
        Processor seconds of the features of a tested recording, median over partitions.
    """

    method: str
    mean: float
    sd: float
    difference: float
    p_value: float
    adjusted: float
    features_s: float


def compare(rows: Sequence[Row], reference: str | None = None) -> list[Compared]:
    """Compare finished rows of one data set with one of them, the first unless another is named.

    The corrected test (Nadeau & Bengio 2003) allows for partitions that share recordings; two halves give it one
    degree of freedom, so it then finds next to nothing.
    """
    rows = [row for row in rows if row.status == "ok"]
    if not rows:
        return []
    base = next((row for row in rows if row.method == reference), rows[0])
    sizes = statistics.fmean(base.n_train), statistics.fmean(base.n_test)
    p_values = []
    for row in rows:
        d = np.subtract(row.accuracies, base.accuracies)
        p_values.append(math.nan if row is base else corrected_resampled_t(d, *sizes).p_value)
    adjusted = holm(p_values)
    return [
        Compared(
            row.method,
            row.mean,
            _sd(row.accuracies),
            row.mean - base.mean,
            p,
            float(a),
            row.median_s("features"),
        )
        for row, p, a in zip(rows, p_values, adjusted, strict=True)
    ]


def averaged(rows: Sequence[Row], sets: Sequence[str], group: str) -> list[Row]:
    """Average each method over the data sets of one folder, partition by partition.

    Sets share no recording, so the average keeps the overlap of a single set's partitions, and the same test holds.
    A method that lacks a set is left out, and so are all where the sets differ in their number of partitions.
    """
    means = []
    for method in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == method and row.data_set in sets and row.status == "ok"]
        if len(own) < len(sets) or len({len(row.accuracies) for row in own}) > 1:
            continue
        mean = Row(f"{group}, mean of {len(own)} sets", group, method, own[0].what, own[0].ours)
        for name in ("accuracies", "n_train", "n_test"):
            setattr(mean, name, np.mean([getattr(row, name) for row in own], axis=0).tolist())
        for stage in mean.seconds:
            mean.seconds[stage] = np.mean([row.seconds[stage] for row in own], axis=0).tolist()
        means.append(mean)
    return means


def table(title: str, rows: Sequence[Row], reference: str | None = None) -> str:
    """Lines of one data set for a terminal."""
    compared = {line.method: line for line in compare(rows, reference)}
    base = next((line.method for line in compared.values() if line.method == reference), None)
    base = base or next(iter(compared), None)
    lines = [title, f"{'':<21}{'accuracy':>8} {'SD':>5} {'diff.':>6} {'p':>7} {'Holm':>7}   {COLUMNS}"]
    for row in rows:
        mark = "*" if row.ours else " "
        if row.status != "ok":
            lines.append(f"{mark}{row.method:<20}{row.status}: {row.why}")
            continue
        line = compared[row.method]
        times = " ".join(_ms(row.median_s(stage)) for stage in row.seconds)
        if line.method == base:
            test = f"{'(compared with)':>22}"
        else:
            test = f"{100 * line.difference:>+6.1f} {_p(line.p_value)} {_p(line.adjusted)}"
        lines.append(
            f"{mark}{row.method:<20}{100 * line.mean:>8.1f} {_number(100 * line.sd)} {test}   {times}"
        )
    return "\n".join(lines)


def as_json(compared: Sequence[Compared]) -> list[dict[str, Any]]:
    """Comparisons with None for what is not known."""
    return [
        {name: None if isinstance(v, float) and math.isnan(v) else v for name, v in vars(line).items()}
        for line in compared
    ]


def _sd(values: Sequence[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else math.nan


def _number(value: float) -> str:
    return f"{'-':>5}" if math.isnan(value) else f"{value:>5.1f}"


def _p(value: float) -> str:
    return f"{'-':>7}" if math.isnan(value) else f"{value:>7.3f}"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:>9.3f}"
