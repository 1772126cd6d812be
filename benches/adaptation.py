"""What adapting to another set-up is worth: synthetic rigs, halves of sessions, and other people; beside peers.

``python benches/adaptation.py [seconds [set ...]]`` draws train, adapt and judge recordings anew for so long, on one
thread, and prints mean balanced accuracies. Sets:

- *rigs*: eleven synthetic materials, 12 pushes of each of 1 s at 500 Hz; six other rigs, each with 10 pushes of each
  to adapt and 10 to judge;
- *sliding*: `GRANULAR_ID_DATA`/sliding_wrench, one half of the sessions trains, 10 of each material of the other half
  adapt and 15 judge;
- *watch*: seven exercises from the data file of the package seglearn (its readers are not used), 2 s at 50 Hz of 6
  axes; four people train, the recordings of another one adapt and judge.

Sets that are not there are skipped. With ``z`` a peer gets mean and spread of each of its features from the recordings
that adapt, too.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from pathlib import Path

import numpy as np
from aeon.transformations.collection.interval_based import QUANTTransformer
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.pipeline import make_pipeline

import granular_id as gid
from accuracy_data import FolderError, Preparation, read_folder
from accuracy_peers import AxesFirst, rocket
from accuracy_stages import Setting
from granular_id.spaces import feature_spaces, tell_blocks
from granular_id.synthetic import Rig

RIGS = {
    "12 mm": Rig(tool_diameter_m=0.012),
    "25 mm": Rig(tool_diameter_m=0.025),
    "50 mm deep": Rig(depth_m=0.05),
    "65 mm deep": Rig(depth_m=0.065),
    "20 mm/s": Rig(speed_m_s=0.02),
    "45 mm/s": Rig(speed_m_s=0.045),
}
DATA = Path(os.environ.get("GRANULAR_ID_DATA", "."))
CONTENTS = ("all", "half", "three", "unequal")
LEAST = 3
WINDOW = 100
N_TRAIN, N_ADAPT, N_JUDGE = 30, 10, 15


def rigs():
    """Return a function from a generator to recordings that train, and pairs of those that adapt and judge."""

    def pushes(n, rng, rig):
        data = gid.synthesize(n_per_class=n, duration_s=1.0, seed=int(rng.integers(2**31)), rig=rig)
        return data.X, np.asarray(data.y)

    def draw(rng):
        yield pushes(12, rng, Rig())
        for rig in RIGS.values():
            yield pushes(10, rng, rig), pushes(10, rng, rig)

    return 500.0, draw


def sliding():
    (found,) = read_folder(DATA / "sliding_wrench", Preparation())
    X, y, order = found.data.X, np.asarray(found.data.y), found.data.chronological_order()[0]
    first = np.zeros(len(y), dtype=bool)
    for label in np.unique(y):
        own = order[y[order] == label]
        first[own[: len(own) // 2]] = True

    def draw(rng):
        trains = first if rng.integers(2) else ~first
        yield parts(rng, X, y, np.flatnonzero(trains), [N_TRAIN])[0]
        yield parts(rng, X, y, np.flatnonzero(~trains), [N_ADAPT, N_JUDGE])

    return 100.0, draw


def watch():
    spec = importlib.util.find_spec("seglearn")
    path = None if spec is None else Path(spec.submodule_search_locations[0]) / "data" / "watch_dataset.npy"
    if path is None or not path.is_file():
        raise FolderError("the package seglearn is not installed")
    known = np.load(path, allow_pickle=True).item()
    windows, labels, people = [], [], []
    for signal, label, person in zip(known["X"], known["y"], known["subject"], strict=True):
        for start in range(0, len(signal) - WINDOW + 1, WINDOW):
            windows.append(signal[start : start + WINDOW])
            labels.append(known["y_labels"][int(label)])
            people.append(int(person))
    X, y, people = np.array(windows, dtype=np.float64), np.array(labels), np.array(people)

    def draw(rng):
        *four, other = rng.permutation(np.unique(people))[:5]
        yield parts(rng, X, y, np.flatnonzero(np.isin(people, four)), [N_TRAIN])[0]
        yield parts(rng, X, y, np.flatnonzero(people == other), [N_ADAPT, N_JUDGE])

    return 50.0, draw


SETS = {"rigs": rigs, "sliding": sliding, "watch": watch}


def parts(rng, X, y, rows, sizes):
    """Draw so many of each class, one part after the other."""
    drawn = [[] for _ in sizes]
    for label in np.unique(y[rows]):
        own = rng.permutation(rows[y[rows] == label])
        for part, taken in zip(drawn, np.split(own, np.cumsum(sizes))[:-1], strict=True):
            part.extend(taken)
    return [(X[part], y[part]) for part in drawn]


def session(rng, y, content):
    """Rows of a session that holds all, half or three of the classes, or a tenth to all of each."""
    classes = rng.permutation(np.unique(y))
    if content == "unequal":
        shares = rng.uniform(0.1, 1.0, len(classes))
        own = [np.flatnonzero(y == label) for label in classes]
        return np.concatenate([r[: max(1, round(len(r) * s))] for r, s in zip(own, shares, strict=True)])
    n = {"all": len(classes), "half": (len(classes) + 1) // 2, "three": 3}[content]
    return np.flatnonzero(np.isin(y, classes[:n]))


def accuracy(named, y):
    """Balanced accuracy in %."""
    return 100 * np.mean([np.mean(named[y == label] == label) for label in np.unique(y)])


def ours(name, rate_hz, seed, train, shifts, rng):
    """Yield content, what adapted, and the accuracies on each shift."""
    space = feature_spaces(rate_hz=rate_hz, threads=1)[name]
    features = space.transformer.fit(train[0])
    rows, classifier = features.transform(train[0]), space.classifier.set_params(random_state=seed)
    tell_blocks(classifier, features.block_sizes_)
    classifier.fit(rows, train[1])
    for (adapts, truth), (judges, y) in shifts:
        known, judged = features.transform(adapts), features.transform(judges)
        for content in CONTENTS:
            own = session(rng, truth, content)
            yield content, "none", accuracy(classifier.predict(judged), y)
            ways = {"adapt": {}, "declared": {"all_materials": True}}
            if own.size < LEAST * len(np.unique(y)):
                ways.pop("declared")
            for way, asked in ways.items():
                made = classifier.adapt(rows, train[1], known[own], **asked)
                yield content, way, accuracy(made.predict(judged), y)
        for n in (1, 3, 5):
            few = np.concatenate([np.flatnonzero(truth == label)[:n] for label in np.unique(truth)])
            made = classifier.recalibrate(rows, train[1], known[few], truth[few], allow_missing=True)
            yield "all", f"{n} each", accuracy(made.predict(judged), y)


def quant(setting):
    """Features and classifier of aeon's QUANTClassifier."""
    trees = ExtraTreesClassifier(200, max_features=0.1, criterion="entropy", random_state=setting.seed)
    return make_pipeline(AxesFirst(QUANTTransformer())), trees


def peer(make, rate_hz, seed, train, shifts):
    features, classifier = make(Setting(rate_hz, train[0].shape[1], seed))
    rows = features.fit(train[0]).transform(train[0])
    classifier.fit(rows, train[1])
    for (known, _), (judged, y) in shifts:
        own, there = features.transform(judged), features.transform(known)
        scale = np.clip(rows.std(axis=0) / np.maximum(there.std(axis=0), 1e-12), 0.2, 5)
        z = (own - there.mean(axis=0)) * scale + rows.mean(axis=0)
        yield "all", "none", accuracy(classifier.predict(own), y)
        yield "all", "z", accuracy(classifier.predict(z), y)


def described(found):
    """Mean and standard error of each way; beside none, the share that loses a point or more, and how much."""
    before, words = np.array(found["none"]), []
    for way, values in found.items():
        after = np.array(values)
        error = after.std(ddof=1) / np.sqrt(after.size) if after.size > 1 else np.nan
        words.append(f"{way} {after.mean():.1f} ({error:.1f})")
        lost = before - after
        if way in ("adapt", "declared") and (lost >= 1).any():
            words[-1] += f" [{100 * np.mean(lost >= 1):.0f} % lose {lost[lost >= 1].mean():.1f}]"
    return ", ".join(words)


def main(seconds, names):
    for name in names:
        try:
            rate_hz, draw = SETS[name]()
        except FolderError as error:
            print(f"{name}: skipped, {error}")
            continue
        until, number, found = time.monotonic() + seconds / len(names), 0, {}
        while time.monotonic() < until:
            rng = np.random.default_rng([number, len(name)])
            train, *shifts = draw(rng)
            for space in ("multiband", "best"):
                for content, way, value in ours(space, rate_hz, number, train, shifts, rng):
                    found.setdefault((space, content), {}).setdefault(way, []).append(value)
            for method, make in (("MiniRocket", rocket("MiniRocket")), ("QUANT", quant)):
                for content, way, value in peer(make, rate_hz, number, train, shifts):
                    found.setdefault((method, content), {}).setdefault(way, []).append(value)
            number += 1
        print(f"{name}: {number} draws; mean (standard error over shifts)")
        for (method, content), ways in found.items():
            print(f"  {method:10} {content:8} {described(ways)}", flush=True)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 600.0, sys.argv[2:] or list(SETS))
