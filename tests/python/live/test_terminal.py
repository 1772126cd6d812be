"""The terminal view: what matters is on the screen at any size, and in a log where there is no screen."""

import io
from dataclasses import replace

import pytest
from rich.cells import cell_len
from rich.console import Console

from granular_id._core import AXES, UNITS
from granular_id.live import FailureReason, Push, Snapshot, TerminalView
from granular_id.live.terminal import screen
from live_view_cases import CLASSES, answer, listening

MIDDLE, END = listening(1.7)[1], listening(3.2)[1]
TROUBLE = replace(
    MIDDLE,
    warnings=("gap",),
    lag_s=0.043,
    counters={"missing": 14, "gaps": 2, "saturated": 3, "duplicates": 5},
)


def drawn(snapshot, width=100, height=40, *, ascii_only=False):
    console = Console(file=io.StringIO(), width=width, height=height, color_system=None)
    console.print(screen(snapshot, width, height, ascii_only=ascii_only))
    lines = console.file.getvalue().splitlines()
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width
    return "\n".join(lines)


@pytest.mark.parametrize(("width", "height"), [(40, 24), (64, 24), (80, 24), (200, 60)])
@pytest.mark.parametrize("snapshot", [MIDDLE, END, TROUBLE], ids=["middle", "end", "trouble"])
def test_what_matters_is_on_the_screen_at_any_size(snapshot, width, height):
    text = drawn(snapshot, width, height)
    lines = text.splitlines()
    assert "SYNTHETIC" in lines[0]
    words, title = snapshot.words, snapshot.words.answer.title
    assert (title.upper() if snapshot.decision.final else f"{title} so far ...") in text
    assert ("final" in text) == snapshot.decision.final
    for said in (words.score, words.state, words.ranking[0][1], *words.figures[0][:2], *words.warnings):
        assert said in text
    for axis, unit, value in zip(AXES, UNITS, words.values, strict=True):
        line = next(line for line in lines if line.startswith(axis))
        assert f" {value} {unit} " in line
        assert any(block in line for block in "▁▂▃▄▅▆▇█")


def test_troubles_are_marked():
    text = drawn(TROUBLE)
    marks = ("lag 43.0 ms !", "lost 14 !", "gaps 2 !", "saturated 3 !", "! gap: missing rows were filled in")
    assert [mark for mark in marks if mark not in text] == []
    assert "duplicates 5 " in text
    assert "duplicates 5 !" not in text
    assert "!" not in drawn(MIDDLE)


def test_a_tall_screen_has_the_whole_ranking_and_a_low_one_says_what_is_cut():
    tall, low = drawn(MIDDLE), drawn(MIDDLE, height=24)
    assert all(name in tall for name in CLASSES)
    assert "more" not in tall
    shown = sum(name in low.rpartition("mean loss")[2] for name in CLASSES)
    assert f"and {len(CLASSES) - shown} more" in low
    assert "rice so far" in drawn(listening(0.1, classes=("rice",))[1]), "one alone has no runner-up"


def test_bars_are_as_long_as_losses():
    rows = [line for line in drawn(END).splitlines() if "━" in line and "┏" not in line and "┗" not in line]
    lengths = [row.count("━") for row in rows]
    losses = [loss for _, loss in END.decision.ranking]
    assert lengths == sorted(lengths)
    assert lengths[0] / lengths[-1] == pytest.approx(losses[0] / losses[-1], abs=0.02)


def test_without_block_characters_it_is_ascii():
    assert drawn(replace(TROUBLE, source="rdt://x"), ascii_only=True).replace("·", "-").isascii()


def test_names_cannot_steer_the_terminal_and_leave_room_for_numbers():
    bad = listening(0.1, classes=("\x1b[2Jrice", "oats\r\n[bold]", "[red]peas[/red]"))[1]
    bad = replace(bad, source="\x1b]0;owned\x07", hint="\x1b[1A", warnings=("\x1b[31m",))
    for text in (drawn(bad), bad.words.line):
        assert not {"\x1b", "\x07"} & set(text)
    assert "[red]peas[/red]" in drawn(bad)
    wide = "日本の玄米とうもろこし粉小麦粉大豆粉黒砂糖白砂糖塩胡椒"
    long = listening(0.1, classes=(wide, "W" * 60, "rice"))[1]
    for width in (60, 100):
        assert all(f" {loss} " in drawn(long, width) for _, loss in long.words.ranking)


def test_a_terminal_is_drawn_on_and_keeps_the_last_screen():
    output = io.StringIO()
    with TerminalView(Console(file=output, force_terminal=True, width=100, height=40)) as view:
        view.publish(MIDDLE)
        view.publish(END)
    text = output.getvalue()
    assert "FINE SUGAR" in text
    assert "final, after 3.20 s" in text
    assert text.rstrip().endswith("\x1b[?25h")  # the cursor is there again


def test_a_pipe_gets_a_line_per_change_and_one_a_second():
    output = io.StringIO()
    with TerminalView(Console(file=output, width=40)) as view:
        for i in range(100):
            view.publish(Snapshot("armed", time_s=i / 50, lag_s=0.001))
        view.publish(Snapshot("triggered", time_s=2.0))
        view.publish(replace(END, time_s=2.1))
    begins = [line.partition("  |")[0] for line in output.getvalue().splitlines()]
    assert begins[:3] == ["0.000 s  Armed", "1.000 s  Armed", "2.000 s  Listening"]
    assert begins[3].startswith("SYNTHETIC  2.100 s  Done: fine sugar (final, after 3.20 s, margin ")
    assert len(begins) == 4


def session(n=12):
    """Return a builder behind `n` pushes: every third one is like none, every fourth one failed."""
    builder, _ = listening(0.1)
    for k in range(n):
        decision = answer(3.2, final=True, warnings=("gap",), unknown=k % 3 == 2)
        failed = Push(None, FailureReason.GAP, "12 rows are missing")
        builder.end_capture(failed if k % 4 == 3 else Push(decision, truth=CLASSES[2]))
    return builder


@pytest.mark.parametrize(
    ("n", "title", "detail"),
    [
        (1, "FINE SUGAR", "margin"),
        (3, "LIKE NO KNOWN MATERIAL", "nearest: fine sugar"),
        (4, "NO ANSWER", "12 rows"),
    ],
)
def test_what_came_of_a_push_stays_and_the_hint_is_seen_too(n, title, detail):
    text = drawn(session(n).build("armed", hint="push now"))
    for said in (title, detail, "Armed: push now"):
        assert said in text
    assert ("! gap: missing rows" in text.partition("last seconds")[0]) == (n != 4)


@pytest.mark.parametrize(("width", "height", "least"), [(80, 24, 2), (110, 44, 8), (40, 24, 1)])
def test_the_history_has_the_last_pushes(width, height, least):
    lines = drawn(session().build("triggered", answer(1.7)), width, height).splitlines()
    begin = next(i for i, line in enumerate(lines) if line.lstrip().startswith("no. at"))
    numbers = [int(line.split()[0]) for line in lines[begin + 1 :]]
    assert numbers == list(range(12, 12 - len(numbers), -1))
    assert len(numbers) >= least
    assert "no answer" in lines[begin + 1]
    if width == 110:
        assert f"like no known material wrong, it was {CLASSES[2]}, nearest: fine sugar" in lines[begin + 4]
        assert f"wrong, it was {CLASSES[2]}, margin" in lines[begin + 3]
