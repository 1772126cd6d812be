"""Synthetic recordings from a physical model of the push: for demonstrations, tests and a simulated sensor.

Always labelled synthetic, and no evidence about accuracy on real recordings.

The force on the tool is a mean drag times a course along the push, with slow heterogeneity and shear-band waves,
stick-slip and the noise of breaking contacts; it reaches all six axes through the lever arm of the tool
(`simulate_push`), rings through the arm and is read by a noisy sensor (`Sensor`). `synthesize` draws whole sets of
recordings with everything that varies between them (`Nuisance`).
"""

from granular_id.synthetic.drag import FRAME as FRAME, SIGN as SIGN, Rig
from granular_id.synthetic.generate import (
    Nuisance,
    draw_push as draw_push,
    push_meta as push_meta,
    simulate_rests,
    synthesize,
)
from granular_id.synthetic.materials import PAPER_MATERIALS, Material, resolve_materials as resolve_materials
from granular_id.synthetic.push import PARTS, Conditions, simulate_push
from granular_id.synthetic.sensors import Sensor, random_stream as random_stream, rest_noise as rest_noise

__all__ = [
    "PAPER_MATERIALS",
    "PARTS",
    "Conditions",
    "Material",
    "Nuisance",
    "Rig",
    "Sensor",
    "simulate_push",
    "simulate_rests",
    "synthesize",
]
