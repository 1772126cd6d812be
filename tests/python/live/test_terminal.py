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

MIDDLE = listening(1.7)[1]
END = listening(3.2)[1]
TROUBLE = replace(
    MIDDLE,
    warnings=("gap",),
    lag_s=0.043,
    counters={"missing": 14, "gaps": 2, "saturated": 3, "duplicates": 5},
)


def drawn(snapshot, width=100, height=40, *, ascii_only=False):
    console = Console(file=io.StringIO(), width=width, height=height, color_system=None)
    console.print(screen(snapshot, width, height, ascii_only=ascii_only))
    return console.file.getvalue()


@pytest.mark.parametrize(("width", "height"), [(40, 24), (64, 24), (80, 24), (200, 60)])
@pytest.mark.parametrize("snapshot", [MIDDLE, END, TROUBLE], ids=["middle", "end", "trouble"])
def test_what_matters_is_on_the_screen_at_any_size(snapshot, width, height):
    lines = drawn(snapshot, width, height).splitlines()
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert "SYNTHETIC" in lines[0]
    label = snapshot.decision.label
    assert (label.upper() if snapshot.decision.final else f"{label} so far ...") in text
    assert ("final" in text) == snapshot.decision.final
    assert f"lag {1e3 * snapshot.lag_s:.1f} ms" in text
    assert f"lost {snapshot.lost}" in text
    assert "12 of 12 right" in text
    for axis, unit, value, digits in zip(AXES, UNITS, snapshot.latest, (3, 3, 3, 4, 4, 4), strict=True):
        line = next(line for line in lines if line.startswith(axis))
        assert f"{value:.{digits}f} {unit} " in line
        assert any(block in line for block in "▁▂▃▄▅▆▇█")
    assert f"{snapshot.decision.ranking[0][1]:.3f}" in text


def test_troubles_are_marked():
    text = drawn(TROUBLE)
    for mark in (
        "lag 43.0 ms !",
        "lost 14 !",
        "gaps 2 !",
        "saturated 3 !",
        "duplicates 5 ",
        "! gap: missing rows were filled in",
    ):
        assert mark in text
    assert "duplicates 5 !" not in text
    assert "!" not in drawn(MIDDLE)


def test_a_tall_screen_has_the_whole_ranking_and_a_low_one_says_what_is_cut():
    assert all(name in drawn(MIDDLE) for name in CLASSES)
    assert "more" not in drawn(MIDDLE)
    low = drawn(MIDDLE, height=24)
    shown = sum(name in low.rpartition("mean loss")[2] for name in CLASSES)
    assert f"and {len(CLASSES) - shown} more" in low


def test_bars_are_as_long_as_losses():
    rows = [line for line in drawn(END).splitlines() if "━" in line and "┏" not in line and "┗" not in line]
    lengths = [row.count("━") for row in rows]
    losses = [loss for _, loss in END.decision.ranking]
    assert lengths == sorted(lengths)
    assert lengths[0] / lengths[-1] == pytest.approx(losses[0] / losses[-1], abs=0.02)


def test_without_block_characters_it_is_ascii():
    assert drawn(replace(TROUBLE, source="rdt://x"), ascii_only=True).replace("·", "-").isascii()


def test_an_idle_session_and_a_failure_say_so():
    idle = drawn(Snapshot("idle", source="rdt://x", hint="press Enter"))
    assert "Waiting" in idle
    assert "press Enter" in idle
    assert "SYNTHETIC" not in idle
    failed = drawn(Snapshot("failed", hint="12 rows are missing"))
    assert "Failed" in failed
    assert "12 rows are missing" in failed


def test_names_cannot_steer_the_terminal():
    classes = ("\x1b[2Jrice", "oats\r\n[bold]", "[red]peas[/red]")
    bad = listening(3.2, classes=classes)[1]
    bad = replace(bad, source="\x1b]0;owned\x07", hint="\x1b[1A", warnings=("\x1b[31m",))
    for text in (drawn(bad), bad.words.line):
        assert "\x1b" not in text
        assert "\x07" not in text
    assert "[red]peas[/red]" in drawn(bad)


def test_a_terminal_is_drawn_on_and_keeps_the_last_screen():
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100, height=40)
    with TerminalView(console) as view:
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
    lines = output.getvalue().splitlines()
    assert [line.split("  ")[:2] for line in lines[:3]] == [
        ["0.000 s", "Armed"],
        ["1.000 s", "Armed"],
        ["2.000 s", "Listening"],
    ]
    assert len(lines) == 4
    assert lines[3] == (
        f"SYNTHETIC  2.100 s  Done: fine sugar (final, after 3.20 s, margin {END.decision.margin:.3f} ahead of "
        "cat litter)  |  lag 1.2 ms, lost 0  |  12 of 12 right"
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"settled": True}, "can no longer change"),
        ({"sure": True}, "sure enough to stop"),
        ({"probability": 0.934}, "probability 93 %"),
        ({"candidates": ("rice", "salt")}, "may be rice or salt"),
    ],
)
def test_how_sure_it_is_is_told(options, words):
    assert words in replace(MIDDLE, decision=answer(1.7, **options)).words.line


@pytest.mark.parametrize("width", [40, 100])
def test_what_is_like_no_known_material_is_not_called_by_the_nearest_name(width):
    decision = replace(END.decision, unknown=True, candidates=("fine sugar", "cat litter"))
    stranger = replace(END, decision=decision)
    text = " ".join(drawn(stranger, width).replace("┃", " ").split())
    assert "LIKE NO KNOWN MATERIAL" in text
    assert "FINE SUGAR" not in text
    for said in (text, stranger.words.line):
        assert "nearest: fine sugar, margin" in said
        assert "may be fine sugar or cat litter" in said
    assert "Done: like no known material (final, after 3.20 s, nearest: fine sugar" in stranger.words.line
    assert "may be" not in replace(END, decision=replace(decision, candidates=("fine sugar",))).words.line


def test_an_early_answer_that_was_given_is_not_called_provisional():
    given = replace(MIDDLE, state="complete", decision=answer(1.7, sure=True)).words.answer
    assert (given.kind, given.stage) == ("final", "early, 1.70 s of 3.20 s, sure enough to stop")
    still = replace(MIDDLE, state="triggered", decision=answer(1.7, sure=True)).words.answer
    assert (still.kind, still.stage) == ("provisional", "provisional, 1.70 s of 3.20 s, sure enough to stop")


def test_a_single_class_has_no_runner_up():
    one = listening(1.0, classes=("rice",))[1]
    assert "ahead" not in drawn(one)
    assert "rice so far" in drawn(one)


def session(n=12, names=CLASSES):
    """Return a builder behind `n` pushes: every third one is like none, every fourth one failed."""
    builder, _ = listening(1.0, classes=names)
    for k in range(n):
        decision = answer(3.2, final=True, classes=names, warnings=("gap",), unknown=k % 3 == 2)
        failed = Push(None, FailureReason.GAP, "12 rows are missing")
        builder.end_capture(failed if k % 4 == 3 else Push(decision, truth=names[2]))
    return builder


@pytest.mark.parametrize("state", ["arming", "armed", "ended"])
@pytest.mark.parametrize(
    ("n", "title", "detail"),
    [
        (1, "FINE SUGAR", "margin"),
        (3, "LIKE NO KNOWN MATERIAL", "nearest: fine sugar"),
        (4, "NO ANSWER", "12 rows"),
    ],
)
def test_what_came_of_a_push_stays_and_the_hint_is_seen_too(state, n, title, detail):
    text = drawn(session(n).build(state, hint="push now"))
    assert title in text
    assert detail in text
    assert f"{Snapshot(state).words.state}: push now" in text
    assert ("! gap: missing rows" in text.partition("last seconds")[0]) == (n != 4)


@pytest.mark.parametrize(("width", "height", "least"), [(80, 24, 2), (110, 44, 8), (40, 24, 1)])
def test_the_history_has_the_last_pushes(width, height, least):
    lines = drawn(session().build("triggered", answer(1.7)), width, height).splitlines()
    assert len(lines) <= height
    begin = next(i for i, line in enumerate(lines) if line.startswith("push at"))
    numbers = [int(line.split()[0]) for line in lines[begin + 1 :]]
    assert numbers == list(range(12, 12 - len(numbers), -1))
    assert len(numbers) >= least
    assert "no answer" in lines[begin + 1]
    if width == 110:
        assert f"like no known material wrong, it was {CLASSES[2]}, nearest: fine sugar" in lines[begin + 4]
        assert f"wrong, it was {CLASSES[2]}, margin" in lines[begin + 3]


def test_names_of_any_script_leave_room_for_numbers():
    names = ("日本の玄米とうもろこし粉小麦粉大豆粉黒砂糖白砂糖塩胡椒", "W" * 60, "rice")
    builder = session(names=names)
    decision = answer(3.2, final=True, classes=names)
    for width in (60, 100):
        text = drawn(builder.build("complete", decision), width)
        for _, loss in decision.ranking:
            assert f" {loss:.3f} " in text
        assert max(map(cell_len, text.splitlines())) <= width


def test_a_crowd_of_candidates_is_cut():
    text = replace(END, decision=replace(END.decision, candidates=CLASSES)).words.line
    assert f"or {CLASSES[5]} or {len(CLASSES) - 6} more" in text
