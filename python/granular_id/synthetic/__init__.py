"""Synthetic recordings from a physical model of the push: for demonstrations, tests and a simulated sensor.

Always labelled synthetic, and no evidence about accuracy on real recordings.

The force on the tool is a mean drag (`mean_drag_n`) times a course along the push (`drag_profile`), with slow
heterogeneity and shear-band waves (`heterogeneity`, `shear_band_wave`), stick-slip (`stick_slip`) and the
noise of breaking contacts (`contact_breaks`); it reaches all six axes through the lever arm of the tool
(`simulate_push`), rings through the arm (`tool_resonance`) and is read by a noisy sensor (`Sensor`).
`synthesize` draws whole sets of recordings with everything that varies between them (`Nuisance`).
`rest_noise` and `simulate_rests` are a real sensor at rest, for tares and payloads.
"""

from granular_id.synthetic.drag import (
    Rig,
    contact_break_rate_hz,
    contact_breaks,
    contact_count,
    drag_profile,
    froude_number,
    heterogeneity,
    mean_drag_n,
    relative_fluctuation,
    shear_band_wave,
    slip_length_m,
    stick_slip,
)
from granular_id.synthetic.generate import (
    FRAME as FRAME,
    SIGN as SIGN,
    Nuisance,
    draw_push as draw_push,
    push_meta as push_meta,
    synthesize,
)
from granular_id.synthetic.materials import PAPER_MATERIALS, Material, resolve_materials as resolve_materials
from granular_id.synthetic.push import (
    PARTS,
    Conditions,
    Sensor,
    random_stream as random_stream,
    simulate_push,
    tool_resonance,
)
from granular_id.synthetic.rest import rest_noise, simulate_rests

__all__ = [
    "PAPER_MATERIALS",
    "PARTS",
    "Conditions",
    "Material",
    "Nuisance",
    "Rig",
    "Sensor",
    "contact_break_rate_hz",
    "contact_breaks",
    "contact_count",
    "drag_profile",
    "froude_number",
    "heterogeneity",
    "mean_drag_n",
    "relative_fluctuation",
    "rest_noise",
    "shear_band_wave",
    "simulate_push",
    "simulate_rests",
    "slip_length_m",
    "stick_slip",
    "synthesize",
    "tool_resonance",
]
