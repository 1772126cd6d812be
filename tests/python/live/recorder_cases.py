"""The simulated bench with a recorder before it, for tests of recorders."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

from granular_id.live.recorder import Recorder
from granular_id.live.sim import SimRobot, SimSource
from granular_id.live.stream import opened

SHORT = {"n_samples": 300, "pre_s": 0.1}


class Watched(SimRobot):
    """Counts how often it was stopped."""

    def __init__(self, source):
        super().__init__(source)
        self.n_stops = 0

    def stop(self):
        super().stop()
        self.n_stops += 1


@contextmanager
def bench(tmp_path, *, speed=20, seed=1, materials="rice", **options):
    source = SimSource(materials, seed=seed, speed=speed)
    with opened(source) as stream:
        robot = Watched(source)
        yield source, robot, Recorder(stream, robot, tmp_path / "data", **{**SHORT, **options})


def files(folder):
    return sorted(path for path in Path(folder).rglob("*") if path.is_file())
