"""What recordings, data sets and their steps refuse: the call, the arguments, and what the message names."""

import re

import numpy as np
import pandas as pd
import pytest

from granular_id.recording import AXES, Dataset, Payload, Recording, transform
from granular_id.recording.resampling import MAX_SAMPLES

RNG = np.random.default_rng(0)
WRENCH = np.arange(24.0).reshape(4, 6)
X = RNG.normal(size=(4, 50, 6))
PLACES = np.arange(1200).reshape(4, 50, 6)
FRAME = pd.DataFrame(X[0], columns=list(AXES))
REST = [
    Recording(
        RNG.normal(size=(n, 6)), rate_hz=100, label=label, session=session, name=f"r{n}", trigger_index=2
    )
    for n, label, session in ((10, "rice", "a"), (12, "peas", "b"), (11, "rice", "b"))
]
DATA = Dataset(REST)
WEIGHT = Payload(1, (0, 0, 0))
UNEVEN = Dataset([Recording(np.zeros((3, 6)), time_s=[0, 0.1, 0.22], name="uneven")])


def stamps(*time_s):
    return {"rate_hz": None, "time_s": time_s}


CALLS = {
    "Recording": lambda **given: Recording(**{"wrench": WRENCH, "rate_hz": 500, **given}),
    "Dataset": Dataset,
    "from_arrays": lambda **given: Dataset.from_arrays(
        **{"X": X, "y": list("abab"), "rate_hz": 500, **given}
    ),
    "select": DATA.select,
    "align": DATA.align,
    "find_onsets": DATA.find_onsets,
    "resample": lambda **given: UNEVEN.resample(**{"rate_hz": 50, **given}),
    "windows": lambda duration_s, hop_s=None: DATA.windows(duration_s, hop_s, on_short="skip"),
    "tare": DATA.tare,
    "transform": lambda **given: transform(**{"wrench": WRENCH, **given}),
    "Payload": lambda **given: Payload(**{"mass_kg": 1, "centre_of_mass_m": (0, 0, 0), **given}),
    "compensate": lambda gravity, payload=WEIGHT: DATA.compensate(payload, gravity),
}

REFUSED = {
    "Recording": [
        ({"wrench": WRENCH.ravel()}, "wrench has shape (24,)"),
        ({"wrench": [[1, 2], [3]]}, "wrench is not a rectangular array"),
        ({"wrench": WRENCH.astype(complex)}, "wrench has dtype complex128", TypeError),
        ({"wrench": np.ma.masked_array(WRENCH)}, "wrench is a masked array", TypeError),
        ({"wrench": np.where(WRENCH == 8, np.nan, WRENCH)}, "wrench[1, 2] (fz) is nan"),
        ({"rate_hz": None}, "exactly one of rate_hz (uniform) and time_s"),
        ({"time_s": [0, 1, 2, 3]}, "time_s (irregular), got both"),
        (stamps(0, 1, 2), "time_s has shape (3,)"),
        (stamps(1, 2, 3, 4), "time_s[0] is 1"),
        (stamps(0, 1, 1, 2), "time_s[2] is 1, behind 1"),
        (stamps(0, np.nan, 1, 3), "time_s[1] is nan"),
        ({"rate_hz": 5e-324}, "last for ever"),
        ({"rate_hz": "500"}, "rate_hz must be a number", TypeError),
        ({"label": ""}, "label is empty"),
        ({"label": " rice"}, "label ' rice' begins or ends with a space"),
        ({"session": b"a"}, "session must be a str", TypeError),
        ({"name": None}, "name must be a str", TypeError),
        ({"axes": np.array(["a", "b"])}, "axes must be a sequence of names", TypeError),
        ({"start_time": np.nan}, "start_time must be finite"),
        ({"trigger_index": -1}, "trigger_index must be at least 0"),
        ({"trigger_index": 4}, "trigger_index=4 is outside the 4 samples"),
        ({"flags": [0, 0]}, "flags has shape (2,); wanted (4,)"),
        ({"flags": [0, 0, 16, 0]}, "flags holds 16"),
        ({"flags": [0.0] * 4}, "flags has dtype float64", TypeError),
        ({"meta": [1]}, "meta must be a mapping", TypeError),
        ({"meta": {1: 2}}, "meta has the key 1", TypeError),
        ({"meta": {"a": [np.nan]}}, "meta['a'][0] is nan"),
        ({"meta": {"a": {"b": WRENCH}}}, "meta['a']['b'] is a ndarray", TypeError),
    ],
    "Dataset": [
        ({"recordings": []}, "recordings is empty"),
        ({"recordings": [1]}, "recordings[0] is a int; wanted Recording", TypeError),
        ({"recordings": DATA[0]}, "recordings must be a sequence of Recording", TypeError),
    ],
    "from_arrays": [
        ({"X": X[0]}, "X has shape"),
        ({"X": [X[0], X[1][:, :5]]}, "X[1] has shape"),
        ({"X": []}, "X is empty"),
        ({"X": "rice"}, "X is a str", TypeError),
        ({"X": X.astype(str)}, "X has dtype", TypeError),
        ({"X": X[:, :, :4]}, "axes names none"),
        ({"X": X.transpose(0, 2, 1)}, "as X.transpose(0, 2, 1) has it"),
        ({"X": [x.T for x in X]}, "as [x.T for x in X] has it"),
        ({"X": np.concatenate([X[..., :1], X], axis=2)}, "clock in the first column [x[:, 1:] for x in X]"),
        ({"X": dict(zip("abcd", X, strict=True))}, "X is a dict of arrays; wanted", TypeError),
        (
            {"X": X * (np.arange(X.shape[1]) < 20)[:, None] ** np.array([0, 1, 1, 0])[:, None, None]},
            "2 of 4 recordings",
        ),
        (
            {"X": [FRAME[[*AXES[::-1]]]]},
            "pass Dataset.from_frames",
            TypeError,
        ),
        ({"X": FRAME}, "X is a DataFrame with named columns", TypeError),
        ({"y": list("abc")}, "y has 3 values for 4 recordings"),
        ({"y": {*"abcd"}}, "y is a set; wanted a sequence", TypeError),  # in no order
        ({"units": {"fx": "N"}}, "units is a dict; wanted a sequence", TypeError),
        ({"sessions": [1, 2, 3, [4]]}, "sessions[3]", TypeError),
        ({"rate_hz": None}, "rate_hz is missing"),
        ({"axes": "fx,fy"}, "axes has 2 names"),
        ({"units": "N,N m,N,N"}, "units has 4 for 6"),
        ({"units": "lb"}, "X[0], column 'fx': its unit is 'lb'"),
        ({"X": np.where(PLACES == 700, np.inf, X)}, "X[2], row 16, column 'ty': is inf"),
        ({"X": np.where(PLACES == 700, np.nan, X)}, "empty or NaN, where others"),
        ({"X": np.full_like(X, np.nan)}, "holds no samples"),
    ],
    "select": [
        ({"axes": "fx"}, "axes='fx'; wanted a sequence of names"),
        ({"axes": ["fz", "fw"]}, "axes: recording 'r10' has no axis 'fw'; it has fx fy fz"),
        ({"labels": "oats"}, "labels: no recording has 'oats'; there are 'peas', 'rice'"),
        ({"labels": "peas", "sessions": "a"}, "leaves no recording"),
        ({"indices": []}, "leaves no recording"),
        ({"indices": [3]}, "indices reach outside the 3 recordings", IndexError),
        ({"indices": [True, False]}, "indices is a mask of 2 for 3 recordings"),
        ({"indices": [0.5]}, "indices has dtype float64", TypeError),
        *[({"labels": value}, "labels", TypeError) for value in (1.5, b"rice", [1, "rice"], [["rice"]])],
    ],
    "align": [
        ({}, "exactly one of n_samples (a number, or 'shortest') and duration_s"),
        ({"n_samples": 0}, "n_samples must be at least 1"),
        ({"n_samples": "longest"}, "n_samples='longest'"),
        ({"duration_s": 0.001}, "duration_s=0.001 at 100 Hz is less than one sample"),
        ({"n_samples": 11}, "'r10' is too short: 10 samples, 11 wanted"),
        ({"n_samples": 13, "on_short": "skip"}, "none of the 3 recordings has 13 samples"),
        ({"n_samples": 3, "on_short": "pad"}, "on_short='pad'"),
        ({"n_samples": 3, "lead_s": 0.1}, "give trigger= too"),
        ({"n_samples": 3, "trigger": "onset"}, "trigger='onset'"),
        ({"n_samples": 3, "trigger": "recorded", "lead_s": 0.03}, "'r10' begins 1 samples too late"),
    ],
    "find_onsets": [
        ({"overrule": {"r1": 0.1}}, "no recordings are called 'r1'"),
        (
            {"overrule": {"r12": 9.0}},
            "['r12'] is 9 s; the recording lasts from 0 to 0.11 s",
        ),
        ({"overrule": {"r12": "0.1"}}, "overrule['r12'] must be a number", TypeError),
        ({"overrule": [("r12", 0.1)]}, "overrule must map names of recordings to seconds", TypeError),
        ({"rest_s": None}, "rest_s must be a number", TypeError),
        ({"rest_s": 0.008, "replace": True}, "rest_s=0.008 holds 1 samples at 100 Hz"),
        ({"false_alarm_rate": 2}, "false_alarm_rate must be between"),
        ({"replace": "yes"}, "replace must be True or False", TypeError),
    ],
    "resample": [
        ({"rate_hz": 0}, "rate_hz must be positive"),
        ({"rate_hz": 1e12}, f"at most {MAX_SAMPLES} are made"),
        ({"on_gap": "fill"}, "on_gap='fill'"),
    ],
    "windows": [
        ({"duration_s": 0.004}, "duration_s=0.004 at 100 Hz is less than one sample"),
        ({"duration_s": -1}, "duration_s must be positive"),
        ({"duration_s": 0.1, "hop_s": 0}, "hop_s must be positive"),
        ({"duration_s": 1e300}, "none of the"),
    ],
    "tare": [({"lead_s": lead_s}, "lead_s") for lead_s in (0, -1, 1e-9, np.nan)],
    "transform": [
        ({"rotation": np.diag([1, 1, -1.0])}, "flip="),
        ({"rotation": np.eye(3) + 1e-3}, "rotation is no rotation"),
        ({"rotation": [0, 0, 0, 2]}, "rotation is a quaternion of length 2; wanted 1"),
        ({"rotation": [1, 2, 3]}, "rotation has shape"),
        ({"rotation": [0, 0, np.nan, 1]}, "NaN"),
        ({"translation": (0, 0)}, "translation has shape (2,)"),
        ({"translation": (0, 0, np.inf)}, "infinity"),
        *[({"flip": axes}, "flip=") for axes in ("fx", ("fx", "fw"), (["fx"],), 3)],
        *[({"wrench": wrench}, "wrench has shape") for wrench in (np.zeros((4, 5)), 3.0)],
    ],
    "Payload": [
        ({"mass_kg": -1}, "mass_kg must not be negative"),
        ({"centre_of_mass_m": (0, 0)}, "centre_of_mass_m"),
        ({"bias": (0, 0, 0, 0, 0, np.nan)}, "bias"),
        ({"residual": (1, 2)}, "residual"),
        ({"frame": ""}, "frame"),
        ({"n_rests": 0}, "n_rests"),
    ],
    "compensate": [
        ({"gravity": [[0, 0, 1]] * 2}, "gravity"),
        ({"gravity": [np.zeros((4, 3)) + 1] * 3}, "gravity"),
        ({"gravity": "down"}, "gravity", (TypeError, ValueError)),
        ({"gravity": 3}, "gravity"),
        ({"gravity": object()}, "gravity", (TypeError, ValueError)),
        ({"gravity": None}, "gravity"),
        ({"gravity": [0, 0, 1], "payload": {"mass_kg": 1}}, "payload must be a Payload", TypeError),
    ],
}


@pytest.mark.parametrize(("call", "row"), [(call, row) for call, rows in REFUSED.items() for row in rows])
def test_refusal_names_the_argument(call, row):
    arguments, problem, *error = row
    with pytest.raises(error[0] if error else ValueError, match=re.escape(problem)):
        CALLS[call](**arguments)
