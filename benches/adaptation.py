"""Models in another set-up beside peers that get mean and SD of each of their features from the new set-up, too.

Eleven synthetic materials, 12 pushes of each of 1 s at 500 Hz; the same rig and six others, each with 10 pushes of each
to adapt and 10 to judge. ``python benches/adaptation.py [seconds]`` begins draws of it for so long, on one thread.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from aeon.transformations.collection.interval_based import QUANTTransformer
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.pipeline import make_pipeline

import granular_id as gid
from accuracy_peers import AxesFirst, rocket
from accuracy_stages import Setting
from granular_id.synthetic import Rig

RIGS = {
    "trained": Rig(),
    "12 mm": Rig(tool_diameter_m=0.012),
    "25 mm": Rig(tool_diameter_m=0.025),
    "50 mm deep": Rig(depth_m=0.05),
    "65 mm deep": Rig(depth_m=0.065),
    "20 mm/s": Rig(speed_m_s=0.02),
    "45 mm/s": Rig(speed_m_s=0.045),
}


def quant(setting):
    """Features and classifier of aeon's QUANTClassifier."""
    trees = ExtraTreesClassifier(200, max_features=0.1, criterion="entropy", random_state=setting.seed)
    return make_pipeline(AxesFirst(QUANTTransformer())), trees


def pushes(n, seed, rig=RIGS["trained"]):
    return gid.synthesize(n_per_class=n, duration_s=1.0, seed=seed, rig=rig)


def accuracy(labels, data):
    return np.mean([np.mean(labels[data.y == label] == label) for label in data.labels])


def draw(number):
    """Yield method, rig and balanced accuracy."""
    train = pushes(12, 1000 * number)
    seeds = iter(range(1000 * number + 1, 1000 * number + 1000))
    shifted = {name: [pushes(10, next(seeds), rig) for _ in range(2)] for name, rig in RIGS.items()}
    for space in ("multiband", "best"):
        model = gid.Identifier.fit(train, space, estimate=False, threads=1, random_state=number)
        for rig, (known, new) in shifted.items():
            declared = model.adapt(known, all_materials=True)
            for how, made in (("", model), (", adapt", model.adapt(known)), (", all_materials", declared)):
                yield space + how, rig, accuracy(made.predict(new), new)
    for name, make in (("MiniRocket", rocket("MiniRocket")), ("QUANT", quant)):
        features, classifier = make(Setting(500.0, train.X.shape[1], number))
        rows = features.fit(train.X).transform(train.X)
        classifier.fit(rows, train.y)
        for rig, (known, new) in shifted.items():
            own, there = features.transform(new.X), features.transform(known.X)
            scale = np.clip(rows.std(axis=0) / np.maximum(there.std(axis=0), 1e-12), 0.2, 5)
            z = (own - there.mean(axis=0)) * scale + rows.mean(axis=0)
            yield name, rig, accuracy(classifier.predict(own), new)
            yield f"{name}, z", rig, accuracy(classifier.predict(z), new)


if __name__ == "__main__":
    until, number, found = time.monotonic() + float(sys.argv[1] if len(sys.argv) > 1 else 600), 0, {}
    while time.monotonic() < until:
        for name, rig, share in draw(number):
            found.setdefault(name, {}).setdefault(rig, []).append(100 * share)
        number += 1
    print(f"{number} draws; mean of the other rigs, then", ", ".join(RIGS))
    for name, rigs in found.items():
        each = [np.mean(shares) for shares in rigs.values()]
        print(f"{name:24} {np.mean(each[1:]):5.1f} ", *(f"{share:5.1f}" for share in each))
