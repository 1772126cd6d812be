"""However large or small a number is that somebody gives, no text about it is a row of digits."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

import granular_id as gid
from granular_id._text import fixed
from granular_id.live import ForceTrigger, MonitorServer, WrenchBuffer, opened
from granular_id.live.capture import Capture
from granular_id.live.terminal import screen
from granular_id.recording import Dataset
from granular_id.signal import butter
from granular_id.synthetic import Rig
from live_view_cases import answer, listening

PUSH = Dataset(gid.synthesize(["rice"], 1, duration_s=1))
IRREGULAR = gid.Recording(np.zeros((3, 6)), time_s=[0.0, 1e300, 1.5e300])


def capture(**options):
    return Capture(**{"rate_hz": 500.0, "trigger": ForceTrigger(), **options})


REFUSALS = {
    "rate_hz": lambda x: gid.FeatureSpec(rate_hz=-x),
    "rate_hz, tiny": lambda x: gid.FeatureSpec(rate_hz=1 / x),
    "cutoff_hz": lambda x: gid.FeatureSpec(cutoff_hz=x),
    "bin_range": lambda x: gid.FeatureSpec(bin_range=(x, -x)),
    "N": lambda x: butter(x, 23.0, "highpass", fs=500.0),
    "fs": lambda x: butter(8, 23.0, "highpass", fs=-x),
    "low": lambda x: butter(8, [x, 23.0], "bandpass", fs=4 * x),
    "seconds": lambda x: WrenchBuffer(seconds=x, rate_hz=500.0),
    "tick_hz": lambda x: WrenchBuffer(seconds=1.0, rate_hz=500.0, tick_hz=1 / x),
    "t": lambda x: WrenchBuffer(seconds=1.0, rate_hz=500.0).push(np.zeros(6), x),
    "timeout_s": lambda x: WrenchBuffer(seconds=1.0, rate_hz=500.0).reader().wait(-x),
    "buffer_s": lambda x: opened("sim:rice", x).__enter__(),
    "pre_s": lambda x: capture(pre_s=x),
    "n_samples": lambda x: capture(n_samples=-int(x)),
    "lead": lambda x: PUSH.align(100, trigger="recorded", lead_s=x),
    "lead, negative": lambda x: PUSH.align(100, trigger="recorded", lead_s=-x),
    "duration_s": lambda x: PUSH.align(duration_s=-x),
    "too short": lambda x: PUSH.align(int(x)),
    "trigger_index": lambda x: gid.Recording(np.zeros((5, 6)), rate_hz=500, trigger_index=int(x)),
    "max_gap_s": lambda x: Dataset([IRREGULAR]).resample(rate_hz=500 / x),
    "wall": lambda x: gid.synthesize(["rice"], 1, rig=Rig(speed_m_s=x)),
    "port": lambda x: MonitorServer(int(x)),
}


@pytest.mark.parametrize("refused", REFUSALS.values(), ids=REFUSALS)
def test_refusals_are_short(refused):
    with pytest.raises(ValueError, match=r"\S") as caught:
        refused(1e300)
    text = str(caught.value)
    assert not re.search(r"\d{18}", text)
    assert len(text) < 400


def test_forces_and_losses_of_any_size_fit_a_screen():
    _, seen = listening(1.0)
    ranking = tuple((name, 1e300 * (k + 1)) for k, (name, _) in enumerate(seen.decision.ranking))
    decision = replace(answer(1.0), ranking=ranking, margin=1e300)
    shown = replace(seen, decision=decision, latest=np.full(6, 1e300), lag_s=1e300, time_s=1e300)
    console = Console(file=io.StringIO(), width=100, height=40, color_system=None)
    console.print(screen(shown, 100))
    text = console.file.getvalue()
    for drawn in (text, shown.words.line, str(gid.Decision("rice", ranking, 1e300, seconds=1e300))):
        assert "1e+300" in drawn
        assert not re.search(r"\d{18}", drawn)
    assert text.count("1e+300 N") == 6


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (0.125, 2, "0.12"),
        (-1763831234.5678, 3, "-1763831234.568"),
        (7, 0, "7"),
        (-1e300, 3, "-1e+300"),
        (10**400, 0, "1.000e+400"),
        (np.float64(3e20), 1, "3e+20"),
        (1e-300, 300, "1e-300"),
        (float("nan"), 1, "nan"),
        (float("-inf"), 1, "-inf"),
    ],
)
def test_ordinary_numbers_keep_their_decimals(value, decimals, text):
    assert fixed(value, decimals) == text
