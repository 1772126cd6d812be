"""``granular-id live``: pushes named while they happen."""

from __future__ import annotations

import json as json_format
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from granular_id._text import counted
from granular_id.cli.errors import guarded
from granular_id.cli.interrupts import leave_lost_terminal, stopping_the_robot
from granular_id.cli.method import at_least, direction_of, names_in, option, positive, taking
from granular_id.cli.reading import ACCEPT, Accepted
from granular_id.cli.session import LIVE_ANSWERS, RERUN_LOG, Force, check_outputs

if TYPE_CHECKING:
    from granular_id.live.capture import Capture
    from granular_id.live.drive import Step
    from granular_id.live.identification import LiveIdentifier
    from granular_id.live.push import Push
    from granular_id.live.recorder import Recorder
    from granular_id.live.setup import Setup
    from granular_id.live.source import WrenchSource
    from granular_id.live.stream import Stream
    from granular_id.live.view import View, Views
# The options of everything live: where the wrenches come from, who moves the tool, what a push must be like.

_MOST_SPEED, _MOST_BUFFER_S = 1000.0, 600.0
"""At 500 Hz a buffer of so many seconds takes 30 MB; at the highest speed a push takes 4 ms."""

SOURCE, MOTION, LIMITS = "Source", "Motion", "What a push must be like"


class Mover(str, Enum):
    """Choices of ``--robot``."""

    auto = "auto"
    none = "none"
    manual = "manual"
    source = "source"


class Start(str, Enum):
    """Choices of ``--trigger``."""

    auto = "auto"
    motion = "motion"
    force = "force"


class Sensing:
    """A source of wrenches, named by its URL."""

    def __init__(
        self,
        *,
        source: Annotated[
            str,
            option(
                "--source -s",
                SOURCE,
                "rdt://HOST, replay:PATH, sim:MATERIAL, sim:unknown, ur://HOST, franka://HOST, bota:FILE or "
                "ros2://TOPIC; options as in sim:rice?seed=1.",
            ),
        ],
        speed: Annotated[
            float | None,
            option("--speed", SOURCE, "Simulations and replays: so many seconds in one. Default: 1."),
        ] = None,
        buffer_s: Annotated[
            float, option("--buffer-s", SOURCE, "So far behind may the program fall before rows are lost.")
        ] = 30.0,
    ) -> None:
        positive("--speed", speed)
        positive("--buffer-s", buffer_s)
        for name, value, most in (
            ("--speed", speed or 1.0, _MOST_SPEED),
            ("--buffer-s", buffer_s, _MOST_BUFFER_S),
        ):
            if value > most:
                raise ValueError(f"{name} must be at most {most:g}, got {value:g}")
        self.url = source
        self.buffer_s = buffer_s
        self.options: dict[str, object] = {} if speed is None else {"speed": speed}

    def open(self, url: str | None = None) -> WrenchSource:
        """Make the source; nothing is read yet."""
        from granular_id.live.source import open_source

        return open_source(self.url if url is None else url, **self.options)


class Moving:
    """Who moves the tool, what starts a capture, and what is not acceptable."""

    def __init__(
        self,
        *,
        robot: Annotated[
            Mover,
            option(
                "--robot",
                MOTION,
                "auto: the simulated robot of a simulated sensor, else nobody. manual: you push, and are told when. "
                "source: the arm of ur:// or franka://, which WILL MOVE.",
            ),
        ] = Mover.auto,
        direction: Annotated[
            str, option("--direction", MOTION, "Where the robot pushes: X,Y,Z in its base frame.")
        ] = "1,0,0",
        speed_m_s: Annotated[float, option("--speed-m-s", MOTION, "Speed of the robot; the paper's.")] = 0.03,
        trigger: Annotated[
            Start,
            option(
                "--trigger",
                MOTION,
                "What starts a recording. auto: the robot's motion; without a robot the force.",
            ),
        ] = Start.auto,
        threshold_n: Annotated[
            float, option("--threshold-n", MOTION, "Change of force that is a motion, newton.")
        ] = 0.5,
        max_gap: Annotated[
            int,
            option(
                "--max-gap", LIMITS, "So many missing samples in a row are filled in, flagged; more: again."
            ),
        ] = 0,
        allow_saturated: Annotated[
            bool,
            option("--allow-saturated", LIMITS, "Take samples at the end of the sensor's range, flagged."),
        ] = False,
        max_lag_s: Annotated[
            float,
            option(
                "--max-lag-s",
                LIMITS,
                "Rows that come in later than this are late: noted in recordings and warned of in answers; refused "
                "where the sensor has no clock of its own.",
            ),
        ] = 0.02,
        timeout_s: Annotated[float, option("--timeout-s", LIMITS, "How long to wait for the motion.")] = 30.0,
    ) -> None:
        positive("--threshold-n", threshold_n)
        positive("--timeout-s", timeout_s)
        positive("--speed-m-s", speed_m_s)
        at_least("--max-gap", max_gap, 0)
        if not 0 <= max_lag_s < float("inf"):
            raise ValueError(f"--max-lag-s must be at least 0 and finite, got {max_lag_s:g}")
        self.motion: dict[str, Any] = {"direction": direction_of(direction), "speed_m_s": speed_m_s}
        self.limits: dict[str, Any] = {
            "max_gap": max_gap,
            "allow_saturated": allow_saturated,
            "max_lag_s": max_lag_s,
            "timeout_s": timeout_s,
        }
        self._robot, self._trigger, self._threshold_n = robot.value, trigger.value, threshold_n

    def setup(self, source: WrenchSource) -> Setup:
        """Choose robot and trigger."""
        from granular_id.live.setup import setup_of

        return setup_of(source, self._robot, self._trigger, threshold_n=self._threshold_n)


TEXT = """
Name the material of each push while the tool moves.

The screen shows the six axes, the ranking of materials as it grows, the answer, lag and losses. `--view` adds a page
for the browser, on this machine only. Without `--n` it goes on until Ctrl-C or the end of a replay; how many answers
there were, and how many of them were right where the source knows it, stands at the end of either.

A final answer says whether the signal is like no known material, with the nearest one, and which others it may be,
where the model has rules for that (see `granular-id model info`); answers before the end of a push say neither.

A frame or sign other than in the training is refused before anything moves, unless `--accept` says that it may be;
another sensor, filter, tool, trigger or speed is a warning beside every answer. What either side does not know is not
compared.

Works without any hardware: `sim:unknown` draws a material for each push, and tells afterwards which it was. What a
simulation answers says nothing about real materials.

Examples:

`granular-id live --source rdt://192.168.1.1 --model kitchen.safetensors --view`

`granular-id live --source "sim:unknown?materials=rice,fine_sugar" --model simulated.safetensors --n 20 --speed 10`
"""

MODEL, VIEWS, OUTPUT = "Model", "Views", "Output"


@guarded
@stopping_the_robot()
@taking(Sensing, Moving)
def live(
    sensing: Sensing,
    moving: Moving,
    *,
    model: Annotated[Path, option("--model -m", MODEL, "Model file, from `granular-id train`.")],
    n: Annotated[int | None, option("--n -n", MODEL, "Stop after so many answers.")] = None,
    early: Annotated[
        bool,
        option("--early", MODEL, "Answer as soon as the model is sure enough, not at the end of the push."),
    ] = False,
    accept: Annotated[list[Accepted] | None, option("--accept", MODEL, ACCEPT)] = None,
    pre_s: Annotated[
        float | None,
        option("--pre-s", MODEL, "Rest before the motion; needed where the model does not know it."),
    ] = None,
    view: Annotated[
        bool, option("--view", VIEWS, "Also show a page in the browser (127.0.0.1 only).")
    ] = False,
    port: Annotated[int, option("--port", VIEWS, "Of that page; 0: any free one.")] = 0,
    no_browser: Annotated[
        bool, option("--no-browser", VIEWS, "Print the page's address instead of opening it.")
    ] = False,
    rerun: Annotated[
        Path | None, option("--rerun", VIEWS, "Log everything into a file for the Rerun viewer (.rrd).")
    ] = None,
    json: Annotated[
        Path | None, option("--json", OUTPUT, "Write each answer into this file, one line of JSON each.")
    ] = None,
    force: Force = False,
    quiet: Annotated[bool, option("--quiet -q", OUTPUT, "No screen: one line per push.")] = False,
) -> None:
    """Name pushes; see `TEXT`."""
    at_least("--n", n, 1)
    if not 0 <= port <= 65535:
        raise ValueError(f"--port must be between 0 and 65535, got {port}")
    if not view and (port or no_browser):
        raise ValueError(f"{'--port' if port else '--no-browser'} is about the page: add --view")
    positive("--pre-s", pre_s)
    check_outputs(("--json", json, LIVE_ANSWERS), ("--rerun", rerun, RERUN_LOG), source=model, force=force)

    from granular_id._files import whole_lines
    from granular_id.identifier import Identifier
    from granular_id.live.capture_state import CaptureError
    from granular_id.live.identification import LiveIdentifier
    from granular_id.live.stream import opened
    from granular_id.live.view import Views

    identifier = Identifier.load(model)
    source = sensing.open()
    console = Console(highlight=False)
    if identifier.synthetic and not source.info.synthetic:
        console.print(
            "warning: the model was trained on SYNTHETIC recordings; its answers about real materials mean nothing",
            style="bold yellow",
            soft_wrap=True,
        )
    if early and identifier.core.early is None:
        console.print(
            "note: the model has no early rule (see granular-id model info): it answers before the end of a push only "
            "where the answer can no longer change",
            soft_wrap=True,
        )
    with ExitStack() as stack:
        stream = stack.enter_context(opened(source, sensing.buffer_s))
        setup = moving.setup(source)
        views = stack.enter_context(Views([]))
        for shown in _views(console, view=view, port=port, browser=not no_browser, rerun=rerun, quiet=quiet):
            views.add(shown)  # one by one: those that are open are closed where the next cannot be opened
        identifying = LiveIdentifier(
            stream,
            identifier,
            setup,
            early=early,
            pre_s=pre_s,
            views=views,
            accept=[one.value for one in accept or []],
            **moving.motion,
            **moving.limits,
        )
        _warn(console, identifying.differences)
        answer = stack.enter_context(nullcontext() if json is None else whole_lines(json))
        over = False
        try:
            for push in identifying.pushes(n):
                if quiet:
                    console.print(_line(push), soft_wrap=True, markup=False)
                if answer is not None:  # said before: the disk may be full
                    answer(json_format.dumps(_row(push, identifying)))
            over = n is None
            if over and not identifying.n_answered:
                raise ValueError("the source came to its end before any push was answered")
        except CaptureError as error:
            raise ValueError(str(error)) from error
        except (KeyboardInterrupt, SystemExit):  # how a session without --n ends: with its tally
            leave_lost_terminal()
            raise
        finally:
            views.close()
            _sum_up(console, identifying, views, over=over)


live.__doc__ = TEXT


def _views(
    console: Console, *, view: bool, port: int, browser: bool, rerun: Path | None, quiet: bool
) -> Iterator[View]:
    """Open what was asked for, and say where it is."""
    if view:
        from granular_id.live.monitor import MonitorServer

        page = MonitorServer(port)
        console.print(f"page: {page.url}", soft_wrap=True, markup=False)
        if browser:
            webbrowser.open(page.url)
        yield page
    if rerun is not None:
        from granular_id.live.rerun_log import RerunLog

        yield RerunLog(rerun)
    if not quiet:
        from granular_id.live.terminal import TerminalView

        yield TerminalView(console)


def _warn(console: Console, differences: tuple[str, ...]) -> None:
    from granular_id.recording import other_setup

    for difference in differences:
        text = f"warning: {other_setup(difference)}"
        console.print(text, style="bold yellow", soft_wrap=True, markup=False)


def _row(push: Push, identifying: LiveIdentifier) -> dict[str, Any]:
    """Return a push as JSON-like values."""
    decision = None if push.decision is None else push.decision.to_dict()
    failure = None if push.reason is None else {"reason": push.reason.value, "text": push.text}
    return {
        "decision": decision,
        "failure": failure,
        "truth": push.truth,
        "synthetic": identifying.stream.info.synthetic,
        "synthetic_model": identifying.model.synthetic,
    }


def _line(push: Push) -> str:
    if push.decision is None:
        return f"no answer: {push.text}"
    verdict = {True: "  right", False: f"  WRONG, it was {push.truth}", None: ""}[push.is_right]
    if push.is_right and push.decision.unknown:
        verdict += f", it was {push.truth}"
    if push.is_right is not None and push.truth not in dict(push.decision.ranking):
        verdict += ", which the model does not know"
    return f"{push.decision}{verdict}"


def _sum_up(console: Console, identifying: LiveIdentifier, views: Views, *, over: bool) -> None:
    for complaint in views.complaints:
        console.print(f"a view ended: {complaint}", style="yellow", soft_wrap=True, markup=False)
    n, failed = identifying.n_answered, identifying.n_pushes - identifying.n_answered
    right = (
        f", {identifying.n_right} right ({100 * identifying.n_right / n:.0f} %)"
        if identifying.knows_truth and n
        else ""
    )
    synthetic = "SYNTHETIC: " if identifying.stream.info.synthetic else ""
    lost = f"; {failed} could not be captured" if failed else ""
    refused = f"; {identifying.n_unknown} like no known material" if identifying.n_unknown else ""
    end = "; the source came to its end" if over else ""
    console.print(f"{synthetic}{counted(n, 'answer')}{right}{refused}{lost}{end}", soft_wrap=True)


# ``granular-id record``: pushes into files, one material after another.

TEXT_RECORD = """
Record pushes through materials: one file per push, with label, session, sensor and time.

A recording is accepted only if it is whole: rest before the motion, every sample, no saturation, the right rate.
What was refused is said, and recorded again. Works without any hardware, with a simulated sensor and robot; such
recordings are marked as SYNTHETIC.

Examples:

`granular-id record --source rdt://192.168.1.1 --label rice --n 20 --robot manual -o kitchen`

`granular-id record --source sim: --label "rice,fine sugar,potting gravel" --n 10 --speed 20 -o simulated`
"""

WHAT = "What to record"


@guarded
@stopping_the_robot()
@taking(Sensing, Moving)
def record(
    sensing: Sensing,
    moving: Moving,
    *,
    label: Annotated[
        str,
        option("--label -l", WHAT, "Name of the material; several, separated by commas, one after another."),
    ],
    n: Annotated[int, option("--n -n", WHAT, "Recordings of each.")] = 10,
    output: Annotated[Path, option("--output -o", WHAT, "Folder; recordings are added to what is there.")],
    session: Annotated[
        str | None,
        option("--session", WHAT, "What is recorded in one go (one filling, one set-up). Default: now."),
    ] = None,
    duration_s: Annotated[float, option("--duration-s", WHAT, "Length of a recording.")] = 3.2,
    pre_s: Annotated[float, option("--pre-s", WHAT, "Of that, rest before the motion.")] = 0.25,
    retries: Annotated[
        int, option("--retries", WHAT, "So many refused recordings in a row are tried again.")
    ] = 3,
    quiet: Annotated[bool, option("--quiet -q", WHAT, "Only what went wrong, and the last line.")] = False,
) -> None:
    """Record pushes; see `TEXT_RECORD`."""
    at_least("--n", n, 1)
    at_least("--retries", retries, 0)
    positive("--duration-s", duration_s)
    if not 0 <= pre_s < duration_s:
        raise ValueError(f"--pre-s must be at least 0 and below --duration-s {duration_s:g}, got {pre_s:g}")
    labels = names_in(label)
    if not labels:
        raise ValueError(f"--label must name at least one material, got {label!r}")
    if len(set(labels)) < len(labels):
        raise ValueError(
            f"--label must name each material once, got {label!r}: --n says how often it is recorded"
        )
    if session is not None and not session.strip():
        raise ValueError("--session is empty: give it a name, or leave it out")

    from granular_id.live.recorder import Recorder, checked_label
    from granular_id.live.stream import opened

    for name in labels:
        checked_label(name)
    console = Console(highlight=False)
    # All of them before the first push: a misspelt material is found out now.
    places = [(sensing.open(url), names) for url, names in _places(labels, sensing.url).items()]
    n_refused = 0
    for source, names in places:
        with opened(source, sensing.buffer_s) as stream:
            setup = moving.setup(source)
            recorder = Recorder(
                stream,
                setup.robot,
                output,
                session=session,
                trigger=setup.trigger,
                n_samples=round(duration_s * source.info.rate_hz),
                pre_s=pre_s,
                on_step=None
                if quiet or source.info.synthetic
                else _Prompt(console, by_hand=setup.robot is None),
                **moving.motion,
                **moving.limits,
            )
            session = recorder.session  # one session, whatever the number of sources
            for name in names:
                for k in range(n):
                    real_robot = setup.robot is not None and not source.info.synthetic
                    if not source.info.synthetic and (real_robot or k == 0) and (name, k) != (labels[0], 0):
                        _wait_for(f"{name} {k + 1}/{n}")
                    refused, said = _recorded(recorder, name, f"{name} {k + 1}/{n}", retries, console)
                    if k == 0:
                        _check_truth(console, name, stream)
                    n_refused += refused
                    if not quiet:
                        console.print(said, soft_wrap=True, markup=False)
    synthetic = "SYNTHETIC " if any(source.info.synthetic for source, _ in places) else ""
    again = f"; {n_refused} refused and recorded again" if n_refused else ""
    wrote = f"{counted(n * len(labels), f'{synthetic}recording')} of {counted(len(labels), 'material')}"
    console.print(
        f"wrote {wrote} into {output}, session {session!r}{again}",
        soft_wrap=True,
        markup=False,
    )
    if not quiet:
        console.print(f"look at them with: granular-id data info {output}", soft_wrap=True, markup=False)


record.__doc__ = TEXT_RECORD


def _places(labels: list[str], url: str) -> dict[str, list[str]]:
    """Return the labels to be recorded from each URL; ``sim:`` alone simulates what the label says."""
    base, _, options = url.partition("?")
    if base != "sim:":
        return {url: labels}
    return {f"sim:{label}?{options}" if options else f"sim:{label}": [label] for label in labels}


def _recorded(recorder: Recorder, label: str, title: str, retries: int, console: Console) -> tuple[int, str]:
    """Record until it is accepted; return how many were refused, and a line about the recording."""
    from granular_id.live.capture_state import CaptureError

    refused = 0
    while True:
        try:
            recorded = recorder.record(label)
            break
        except CaptureError as error:
            if error.reason.is_lasting or refused == retries:
                raise ValueError(f"{title}: {error}") from error
            refused += 1
            said = f"{title}: refused, {error}; once more"
            console.print(said, style="yellow", soft_wrap=True, markup=False)
    one = recorded.recording
    begin = one.trigger_index or 0
    rise_n = float(one.wrench[begin:, 0].mean() - one.wrench[: begin or 1, 0].mean())
    late = f", up to {1e3 * one.meta['late_s']:.0f} ms late" if "late_s" in one.meta else ""
    return (
        refused,
        f"{title}: {one.n_samples} samples{late}, mean fx {rise_n:+.2f} N over rest, {recorded.path}",
    )


def _check_truth(console: Console, label: str, stream: Stream) -> None:
    """Warn where a source that knows what it measures knows better."""
    truth = stream.truth
    if truth not in (None, label):
        said = f"warning: recorded as {label!r}, but {stream.info.name} says that it was {truth!r}"
        console.print(said, style="yellow", soft_wrap=True, markup=False)


class _Prompt:
    """Says when a push may begin; otherwise nothing is seen of a recorder that waits."""

    def __init__(self, console: Console, *, by_hand: bool) -> None:
        self._console, self._by_hand = console, by_hand
        self._said: Capture | None = None

    def __call__(self, _: Step, capture: Capture) -> None:
        if capture.state.value == "armed" and self._said is not capture:
            self._said = capture
            self._console.print("ready: push now" if self._by_hand else "ready", style="bold")


def _wait_for(title: str) -> None:
    """Give a person time to change the material, and to bring an arm back to where its push begins."""
    if sys.stdin.isatty():
        asked = f"{title}: press Enter when material and tool are in place"
        try:
            typer.prompt(asked, default="", show_default=False)
        except typer.Abort:  # what a prompt makes of Ctrl-C
            raise KeyboardInterrupt from None
