"""The paper's table on the synthetic recordings: what it says, and how long it takes beside scikit-learn's one-vs-one.

Run: python benches/table.py [partitions] [partitions of the peer]. The recordings are made once and not timed. The
peer is OneVsOneClassifier(SVC(kernel="linear")) behind the same features; it is slow, so it may be given fewer
partitions, and its time is then given per partition.
"""

from __future__ import annotations

import os
import sys
import time

from sklearn.multiclass import OneVsOneClassifier
from sklearn.svm import SVC

import granular_id as gid
from granular_id.spaces import feature_spaces

SLOW = "pca+rica"


def timed(
    data: gid.Dataset, names: list[str], partitions: int, peer: bool
) -> tuple[float, gid.EvaluationResult]:
    """Seconds of one evaluation with the paper's protocol, and its result."""
    start = time.perf_counter()
    result = gid.evaluate(
        data,
        names,
        "paper",
        n_partitions=partitions,
        classifier=OneVsOneClassifier(SVC(kernel="linear")) if peer else None,
        controls=False,
        n_jobs=-1,
        progress=False,
    )
    return time.perf_counter() - start, result


def main() -> None:
    partitions = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    of_peer = int(sys.argv[2]) if len(sys.argv) > 2 else partitions
    data = gid.synthesize(seed=0)
    names = [name for name, space in feature_spaces().items() if space.paper_accuracy is not None]
    quick = [name for name in names if name != SLOW]
    print(f"{len(data)} SYNTHETIC recordings of 1600 x 6, {partitions} partitions, {os.cpu_count()} cores")

    seconds, _ = timed(data, quick, partitions, peer=False)
    print(f"granular_id, {len(quick)} spaces (all but {SLOW}): {seconds:.1f} s")
    everything, ours = timed(data, names, partitions, peer=False)
    print(f"granular_id, all {len(names)} spaces: {everything:.1f} s")
    print(ours.table())

    of_ours = seconds * of_peer / partitions
    spent, theirs = timed(data, quick, of_peer, peer=True)
    print(f"OneVsOne(SVC(linear)), {len(quick)} spaces, {of_peer} partitions: {spent:.1f} s")
    print(f"ratio, {len(quick)} spaces: {spent / of_ours:.1f} x")
    for name in quick:
        pairs = zip(ours.predicted["paper", name], theirs.predicted["paper", name], strict=False)
        same = [(one == other).mean() for one, other in pairs]
        print(f"  {name:14} labels equal to one-vs-one by votes: {100 * sum(same) / len(same):.2f} %")


if __name__ == "__main__":
    main()
