"""A small sound data set, and ways to damage it."""

from dataclasses import replace
from functools import cache

from granular_id.recording import Dataset
from granular_id.synthetic import Nuisance, synthesize

MATERIALS = ("rice", "dry peas", "fine sugar", "macaroni")
PER_CLASS = 12
WHOLE = range(len(MATERIALS) * PER_CLASS)


@cache
def sound_set(seed=0):
    """48 synthetic pushes of four materials, two sessions that vary little, without the metadata of the simulation."""
    steady = Nuisance().scaled(0.4)
    data = synthesize(MATERIALS, n_per_class=PER_CLASS, sessions=2, seed=seed, nuisance=steady)
    return Dataset([replace(r, meta={}) for r in data])


def damaged(data, places, wrench=None, **fields):
    """Return the set with some recordings changed in place, or by a function of (samples, recording)."""
    recordings = list(data)
    for i in places:
        r = recordings[i]
        changed = {name: value(r) if callable(value) else value for name, value in fields.items()}
        if wrench is not None:
            samples = r.wrench.copy()
            result = wrench(samples, r)
            changed["wrench"] = samples if result is None else result
        recordings[i] = replace(r, **changed)
    return Dataset(recordings)


def codes(report, *, infos=False):
    """The set of codes found, mild ones only with `infos`."""
    return {finding.code for finding in report if infos or finding.severity != "info"}


def by_code(report):
    return {finding.code: finding for finding in report}
