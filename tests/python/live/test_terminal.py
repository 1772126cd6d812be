"""The terminal view: what matters is on the screen at any width, and in a log where there is no screen."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console

from granular_id.live import TerminalView
from granular_id.live.snapshot import Snapshot
from granular_id.live.terminal import screen
from live_view_cases import AXES, UNITS, answer, listening, session

MIDDLE, END = listening(1.7)[1], listening(3.2)[1]
HELD = session().build("armed", hint="push now")
TROUBLE = replace(MIDDLE, warnings=("gap",), lag_s=0.043, counters={"missing": 14, "stale": 5})


def drawn(snapshot, width):
    console = Console(file=io.StringIO(), width=width, height=60, color_system=None)
    console.print(screen(snapshot, width))
    lines = console.file.getvalue().splitlines()
    assert max(map(cell_len, lines)) <= width
    return "\n".join(lines)


@pytest.mark.parametrize("width", [40, 100])
@pytest.mark.parametrize("snapshot", [MIDDLE, END, TROUBLE, HELD], ids=["middle", "end", "trouble", "held"])
def test_screen_any_width_has_answer_health_and_axes(snapshot, width):
    text, words = drawn(snapshot, width), snapshot.words
    assert "SYNTHETIC" in text.splitlines()[0]
    title, loss = words.answer.title, words.decision.ranking[0][1]
    is_early = words.answer.kind == "provisional"
    shown = [f"{title} so far ..." if is_early else title.upper(), words.score, words.state]
    shown += [f"{loss:.3f}", words.answer.stage, *(f"! {text}" for text in words.warnings)]
    shown += [f"{name} {value}{' !' * alarm}" for name, value, alarm in words.figures]
    assert [one for one in shown if one not in " ".join(text.split())] == []
    for axis, unit, value in zip(AXES, UNITS, words.values, strict=True):
        line = next(line for line in text.splitlines() if line.startswith(axis))
        assert f" {value} {unit} " in line
        assert any(block in line for block in "▁▂▃▄▅▆▇█")


def test_screen_names_cannot_steer_the_terminal():
    names = ("\x1b[2Jrice", "oats\r\n[bold]", "[red]peas[/red]", "W" * 60, "日本" * 20)
    bad = listening(0.1, classes=names)[1]
    bad = replace(bad, source="\x1b]0;owned\x07", hint="\x1b[1A", warnings=("\x1b[31m",))
    output = io.StringIO()
    TerminalView(Console(file=output)).show(bad)
    for text in (drawn(bad, 60), drawn(bad, 100), output.getvalue()):
        assert not {"\x1b", "\x07"} & set(text)
    assert all(f" {loss:.3f} " in drawn(bad, 60) for _, loss in bad.decision.ranking)


def test_screen_forces_and_losses_of_any_size_fit():
    ranking = tuple((name, 1e300 * (k + 1)) for k, (name, _) in enumerate(MIDDLE.decision.ranking))
    decision = replace(answer(1.0), ranking=ranking, margin=1e300)
    huge = replace(MIDDLE, decision=decision, latest=np.full(6, 1e300), lag_s=1e300, time_s=1e300)
    for text in (drawn(huge, 100), huge.words.line, str(decision)):
        assert "1e+300" in text
        assert not re.search(r"\d{18}", text)


def test_view_terminal_is_drawn_on_and_keeps_the_last_screen():
    output = io.StringIO()
    view = TerminalView(Console(file=output, force_terminal=True, width=100, height=24))
    for snapshot in (MIDDLE, END):
        view.show(snapshot)
    view.close()
    assert "FINE SUGAR" in output.getvalue()
    assert output.getvalue().rstrip().endswith("\x1b[?25h")  # the cursor is there again


def test_view_pipe_gets_a_line_per_change_and_one_a_second():
    output = io.StringIO()
    view = TerminalView(Console(file=output, width=40))
    for i in range(100):
        view.show(Snapshot("armed", time_s=i / 50, lag_s=0.001))
    view.show(Snapshot("triggered", time_s=2.0))
    view.show(replace(END, time_s=2.1))
    lines = output.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    begins = [line.partition("  |")[0] for line in lines if not line.startswith("  ")]
    assert begins[:3] == ["0.000 s  Armed", "1.000 s  Armed", "2.000 s  Listening"]
    assert begins[3].startswith("SYNTHETIC  2.100 s  Done: fine sugar (final, after 3.20 s, margin ")
    assert len(begins) == 4
