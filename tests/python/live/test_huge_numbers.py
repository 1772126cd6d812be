"""Numbers of any size fit a screen: no text about one is a row of digits."""

import io
import re
from dataclasses import replace

import numpy as np
from rich.console import Console

from granular_id.live.terminal import screen
from live_view_cases import answer, listening


def test_forces_and_losses_of_any_size_fit_a_screen():
    _, seen = listening(1.0)
    ranking = tuple((name, 1e300 * (k + 1)) for k, (name, _) in enumerate(seen.decision.ranking))
    decision = replace(answer(1.0), ranking=ranking, margin=1e300)
    shown = replace(seen, decision=decision, latest=np.full(6, 1e300), lag_s=1e300, time_s=1e300)
    console = Console(file=io.StringIO(), width=100, height=40, color_system=None)
    console.print(screen(shown, 100))
    for drawn in (console.file.getvalue(), shown.words.line, str(decision)):
        assert "1e+300" in drawn
        assert not re.search(r"\d{18}", drawn)
