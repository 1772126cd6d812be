"""What a live session says of six changes of the set-up, and how often it is right before and after the remedy.

Run: python benches/setup_changes.py. A model of ten materials (SYNTHETIC, `best`, 16 pushes each) meets 100 pushes,
played again as a live source: first where both sides state the change (refused ones with ``accept``), then after the
remedy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

import granular_id as gid
from granular_id.live import LiveIdentifier, ReplaySource, opened
from granular_id.recording import Dataset, Payload
from granular_id.synthetic import PAPER_MATERIALS

LEAD_S, N = 0.1, 900
TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
TOOL = Payload(0.306, (0.002, -0.003, 0.05), bias=(0,) * 6, frame="flange")
ZERO = np.random.default_rng(3).normal(0, [1, 1, 1, 0.05, 0.05, 0.05])
GAINS = 1 + np.random.default_rng(3).uniform(-0.1, 0.1, 6)
TRAINED = {"sensor": "Mini45", "trigger": "motion", "tool": "cylinder", "tare": "none"}


def pushes(n: int, seed: int, late: int = 0, **meta: str) -> Dataset:
    """Pushes of all materials; `late` samples after the motion they are triggered."""
    names = [material.name for material in PAPER_MATERIALS][:10]
    data = gid.synthesize(names, n_per_class=n, duration_s=2.2, seed=seed)
    data = Dataset([replace(one, trigger_index=(one.trigger_index or 0) + late) for one in data])
    data = data.align(N, trigger="recorded", lead_s=LEAD_S).transform(frame="flange")
    return changed(data, lambda wrench: wrench, **meta)


def changed(data: Dataset, change: Callable[[Any], Any], **meta: str) -> Dataset:
    """Pushes as another set-up would measure them, which their metadata state."""
    return Dataset([replace(one, wrench=change(one.wrench), meta={**one.meta, **meta}) for one in data])


def duller(wrench: np.ndarray) -> np.ndarray:
    """What another sensor makes of them: gains within 10 %, a duller filter."""
    return lfilter([0.6], [1, -0.4], wrench * GAINS, axis=0)


def met(data: Dataset, model: gid.Identifier) -> tuple[str, str]:
    """What a live session says first, and the share of right answers."""
    said, accept = "", ()
    with opened(ReplaySource(data, speed=60, pause_s=0.05)) as stream:
        try:
            live = LiveIdentifier(stream, model)
        except ValueError as refusal:
            said, accept = f"refused: {refusal}", ("frame", "sign")
            live = LiveIdentifier(stream, model, accept=accept)
        answers = list(live.pushes())
    right = sum(bool(push.is_right) for push in answers)
    return said or "warning: " * bool(live.differences) + "; ".join(
        live.differences
    ), f"{right} of {len(answers)}"


def main() -> None:
    train, new = pushes(16, 1, **TRAINED), pushes(10, 2, **TRAINED)
    model, tared = (
        gid.Identifier.fit(one, "best", estimate=False) for one in (train, train.tare(lead_s=LEAD_S))
    )
    turned = new.transform(TURN, frame="wrist")
    flipped = new.transform(frame="flange", reverse=True, sign="force of the robot on the tool")
    gripper = changed(new, lambda wrench: wrench + TOOL.wrench([0, 0, 1]), tool="gripper")
    zeroed = changed(new, lambda wrench: wrench + ZERO, tare="bias")
    late = TRAINED | {"trigger": "force"}
    late_ones, later = (pushes(10, seed, 15, **late) for seed in (2, 5))
    other, others = (changed(one, duller, sensor="Rokubi") for one in (new, pushes(10, 5, **TRAINED)))
    sign = str(new[0].meta.get("sign"))
    for name, data, by in (
        ("unchanged", new, model),
        ("unchanged, tared model", new, tared),
        ("sensor turned by 90 degrees", turned, model),
        ("... transform", turned.transform(TURN.T, frame="flange"), model),
        ("sign flipped", flipped, model),
        ("... --reverse", flipped.transform(frame="flange", reverse=True, sign=sign), model),
        ("other sensor", other, model),
        ("... adapt by labels", other, model.adapt(others, others.y)),
        ("... adapt, all materials", other, model.adapt(others, all_materials=True)),
        ("3 N of tool", gripper, model),
        ("... compensate", gripper.compensate(TOOL, gravity=[0, 0, 1]), model),
        ("... tared model", gripper, tared),
        ("trigger 30 ms later", late_ones, model),
        ("... adapt by labels", late_ones, model.adapt(later, later.y)),
        ("... adapt, all materials", late_ones, model.adapt(later, all_materials=True)),
        ("other tare", zeroed, model),
        ("... tared model", zeroed, tared),
    ):  # fmt: skip
        said, right = met(data, by)
        print(f"{name:28}{right:>12}  {said}", flush=True)


if __name__ == "__main__":
    main()
