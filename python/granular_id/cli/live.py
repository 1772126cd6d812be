"""``granular-id live``: pushes named while they happen; ``granular-id record``: pushes into files or an archive."""

from __future__ import annotations

import json as json_format
import sys
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer
from rich.console import Console

from granular_id._core import GranularIdError
from granular_id._files import check_source, made_folder
from granular_id._text import counted, known_label
from granular_id.cli.errors import in_options
from granular_id.cli.interrupts import leave_lost_terminal, stopping_the_robot
from granular_id.cli.options import (
    FORCE,
    at_least,
    command,
    given_flags,
    names_in,
    numbers_in,
    option,
    positive,
)
from granular_id.cli.outputs import LIVE_ANSWERS, check_outputs, show, warn_of_setups
from granular_id.cli.recordings import ACCEPT, Difference

if TYPE_CHECKING:
    from granular_id.identifier import Identifier
    from granular_id.live import Push, Recorder
    from granular_id.live.capture import Capture
    from granular_id.live.push import Step
    from granular_id.live.robot import Robot
    from granular_id.live.setup import Setup
    from granular_id.live.source import WrenchSource
    from granular_id.live.stream import Stream

_MOST_SPEED, _MOST_BUFFER_S = 1000.0, 600.0
"""At 500 Hz a buffer of so many seconds takes 30 MB; at the highest speed a push takes 4 ms."""

SOURCE, MOTION, LIMITS = "Source", "Motion", "What a push must be like"


@dataclass(kw_only=True)
class Sensing:
    """A source of wrenches."""

    source: str = option(
        SOURCE,
        "rdt://HOST, replay:PATH, sim:MATERIAL, sim:unknown, or with granular-id-contrib ur://HOST, bota:FILE "
        "and ros2://TOPIC; options as in sim:rice?seed=1.",
        "--source",
        "-s",
        default=...,
    )
    speed: float | None = option(SOURCE, "Simulations and replays: so many seconds in one. Default: 1.")
    buffer_s: float = option(SOURCE, "So far behind may the program fall before rows are lost.", default=30.0)

    def __post_init__(self) -> None:
        for name, value, most in (
            ("--speed", self.speed, _MOST_SPEED),
            ("--buffer-s", self.buffer_s, _MOST_BUFFER_S),
        ):
            positive(name, value)
            if value is not None and value > most:
                raise GranularIdError(f"{name} must be at most {most:g}, got {value:g}")

    def refuse_absent(self) -> None:
        """Refuse recordings that are not there, before imports that take longer than a look."""
        from granular_id.live.source import SourceUrl

        url = SourceUrl.parse(self.source, {})
        if url.scheme == "replay":
            check_source(url.path)

    def open(self, url: str | None = None, axes: Sequence[str] | None = None) -> WrenchSource:
        """Make the source; nothing is read yet. `axes` are those to read of recordings, unless the URL says which."""
        from granular_id.live import SourceUrl, open_source
        from granular_id.recording import AXES

        address = self.source if url is None else url
        options: dict[str, object] = {} if self.speed is None else {"speed": self.speed}
        parsed = SourceUrl.parse(address, {})
        unstated = parsed.scheme == "replay" and "axes" not in parsed.options
        if unstated and axes is not None and tuple(axes) != AXES:
            options["axes"] = tuple(axes)
        return open_source(address, **options)


@dataclass(kw_only=True)
class Moving:
    """Who moves the tool, what starts a capture, and what is not acceptable."""

    robot: str = option(
        MOTION,
        "auto: the simulated robot of a simulated sensor, else nobody. none: nobody. manual: you push, and are told "
        "when. source: the arm that the source is part of, which WILL MOVE. ur://HOST, with "
        "granular-id-contrib: that arm, which WILL MOVE.",
        default="auto",
    )
    direction: str = option(MOTION, "Where the robot pushes: X,Y,Z in its base frame.", default="1,0,0")
    speed_m_s: float = option(MOTION, "Speed of the robot; the paper's.", default=0.03)
    trigger: Literal["auto", "motion", "force"] = option(
        MOTION,
        "What starts a recording. auto: the robot's motion; without a robot the force.",
        default="auto",
    )
    threshold_n: float = option(
        MOTION,
        "Change of force that is a motion, newton; a quarter of what may change before an arm moves.",
        default=0.5,
    )
    max_gap: int = option(
        LIMITS, "Missing samples in a row that are filled in, flagged; more: again.", default=0
    )
    allow_saturated: bool = option(
        LIMITS, "Take samples at the end of the sensor's range, flagged.", "--allow-saturated", default=False
    )
    max_lag_s: float = option(
        LIMITS,
        "Rows that come in later than this are late: noted in recordings and warned of in answers; refused "
        "where the sensor has no clock of its own.",
        default=0.02,
    )
    timeout_s: float = option(LIMITS, "How long to wait for the motion.", default=30.0)
    max_force_n: float | None = option(
        LIMITS,
        "A larger change of force from rest (length of fx, fy, fz, newton) stops the robot and ends the session. "
        "Default: none.",
    )
    max_torque_n_m: float | None = option(LIMITS, "The same of tx, ty, tz, newton metre. Default: none.")

    def __post_init__(self) -> None:
        from granular_id.live.setup import ROBOTS

        if self.robot not in ROBOTS and ":" not in self.robot:
            raise GranularIdError(f"--robot must be one of {', '.join(ROBOTS)} or a URL, got {self.robot!r}")
        positive("--threshold-n", self.threshold_n)
        positive("--timeout-s", self.timeout_s)
        positive("--speed-m-s", self.speed_m_s)
        positive("--max-force-n", self.max_force_n)
        positive("--max-torque-n-m", self.max_torque_n_m)
        at_least("--max-gap", self.max_gap, 0)
        if not 0 <= self.max_lag_s < float("inf"):
            raise GranularIdError(f"--max-lag-s must be at least 0 and finite, got {self.max_lag_s:g}")
        self.of_pushes: dict[str, Any] = {
            "direction": tuple(numbers_in("--direction", self.direction, "X,Y,Z such as 0,-1,0", 3)),
            "speed_m_s": self.speed_m_s,
            "max_gap": self.max_gap,
            "allow_saturated": self.allow_saturated,
            "max_lag_s": self.max_lag_s,
            "timeout_s": self.timeout_s,
            "max_force_n": self.max_force_n,
            "max_torque_n_m": self.max_torque_n_m,
        }
        self.of_windows: dict[str, Any] = {"max_gap": self.max_gap, "max_lag_s": self.max_lag_s}

    def setup(self, source: WrenchSource) -> Setup:
        """Choose robot and trigger."""
        from granular_id.live import setup_of

        return setup_of(source, self.robot, self.trigger, threshold_n=self.threshold_n)


MODEL, VIEWS, OUTPUT = "Model", "Views", "Output"


@dataclass(kw_only=True)
class Keeping:
    """What stays of a session."""

    json: Path | None = option(OUTPUT, "Write each answer into this file, one line of JSON each.")
    archive: Path | None = option(
        OUTPUT, "Append each answered push to this archive, with its answer; a new one is made."
    )
    force: bool = FORCE

    def check(self, model: Path, *, early: bool, hop_s: float | None) -> None:
        """Refuse what cannot be written, or would replace what is there."""
        check_outputs(("--json", self.json, LIVE_ANSWERS), source=model, force=self.force)
        other = "--early" if early else "--hop-s"
        if self.archive is not None and (early or hop_s is not None):
            raise GranularIdError(
                f"--archive keeps whole pushes, with {other} there are none: leave one of them out"
            )

    @contextmanager
    def writing(self, axes: Sequence[str], about: dict[str, Any]) -> Iterator[Callable[[Push], None]]:
        """Yield what writes a push; `about` goes beside each answer."""
        # all that an append needs is loaded before anything moves: in between rows would be lost meanwhile
        from granular_id._files import whole_lines
        from granular_id.io.parquet.writing import Appender
        from granular_id.recording import Dataset

        n_kept = 0
        with ExitStack() as stack:
            archive = None
            if self.archive is not None:
                stack.enter_context(made_folder(self.archive))
                archive = Appender(self.archive, axes, "the sensor")
            answer = None if self.json is None else stack.enter_context(whole_lines(self.json))

            def keep(push: Push) -> None:
                nonlocal n_kept
                if answer is not None:
                    answer(json_format.dumps(push.to_dict() | about))
                if archive is not None and push.recording is not None:
                    archive.append(Dataset([push.recording]))
                    n_kept += 1

            try:
                yield keep
            finally:
                if self.archive is not None:
                    show(f"kept {counted(n_kept)} in {self.archive}")


@command
@stopping_the_robot()
def live(
    sensing: Sensing,
    moving: Moving,
    keeping: Keeping,
    *,
    model: Path = option(MODEL, "Model file, from `granular-id train`.", "--model", "-m", default=...),
    n: int | None = option(MODEL, "Stop after so many answers.", "--n", "-n"),
    early: bool = option(
        MODEL,
        "Answer as soon as the model is sure enough, not at the end of the push.",
        "--early",
        default=False,
    ),
    accept: list[Difference] | None = option(MODEL, ACCEPT),
    pre_s: float | None = option(MODEL, "Rest before the motion; needed where the model does not know it."),
    hop_s: float | None = option(
        MODEL, "Answer every so many seconds about the newest samples; no trigger, and no robot moves."
    ),
    view: bool = option(VIEWS, "Also show a page in the browser (127.0.0.1 only).", "--view", default=False),
    port: int = option(VIEWS, "Of that page; 0: any free one.", default=0),
    no_browser: bool = option(VIEWS, "Print its address, do not open it.", "--no-browser", default=False),
    quiet: bool = option(OUTPUT, "No screen: one line per push.", "--quiet", "-q", default=False),
) -> None:
    """Name the material of each push while the tool moves.

    The screen shows the axes, the ranking of materials as it grows, the answer, lag and losses. `--view`
    adds a page for the browser, on this machine only. Without `--n` it goes on until Ctrl-C or the end of a
    replay; how many answers there were, and how many of them were right where the source knows it, stands at
    the end of either.

    With `--hop-s` it answers on and on, each time about the newest samples, as `granular-id identify
    --hop-s` does: for recordings of a robot that drives, and models of windows of them.

    A final answer says whether the signal is like no known material, with the nearest one, and which others
    it may be, where the model has rules for that (see `granular-id model info`); answers before the end of a
    push say neither.

    A frame or sign other than in the training is refused before anything moves, unless `--accept` says that
    it may be; another sensor, filter, tool, trigger or speed is a warning beside every answer. What either
    side does not know is not compared.

    `--archive` keeps what was pushed: each answered push is appended to an archive when it is over, with the answer
    in its `meta`. An answer is no label: the label stays empty, unless the source knows the truth.

    Works without any hardware: `sim:unknown` draws a material for each push, and tells afterwards which it
    was. What a simulation answers says nothing about real materials.

    Examples:

    `granular-id live --source rdt://192.168.1.1 --model kitchen.safetensors --view`
    `granular-id live --source sim:rice,fine_sugar --model simulated.safetensors --n 20 --speed 10`
    `granular-id live --source replay:drive.csv --model grounds.safetensors --hop-s 0.5 --view`
    `granular-id live --source rdt://192.168.1.1 --model kitchen.safetensors --archive seen`
    """
    at_least("--n", n, 1)
    _check_views(view=view, port=port, no_browser=no_browser)
    positive("--pre-s", pre_s)
    positive("--hop-s", hop_s)
    if hop_s is not None:
        _refuse_with_hop(moving, early=early, pre_s=pre_s)
    keeping.check(model, early=early, hop_s=hop_s)
    check_source(model)
    sensing.refuse_absent()

    from granular_id.identifier import Identifier
    from granular_id.live import CaptureError, HopIdentifier, LiveIdentifier, Views, opened

    identifier = Identifier.load(model)
    source = sensing.open(axes=identifier.axes)
    _warn_of_model(identifier, source, early=early)
    with ExitStack() as stack:
        stream = stack.enter_context(opened(source, sensing.buffer_s))
        opened_views = _open_views(view=view, port=port, browser=not no_browser, quiet=quiet)
        views = stack.enter_context(Views(opened_views))
        common: dict[str, Any] = {"views": views, "accept": [one.value for one in accept or []]}
        if hop_s is not None:
            common |= moving.of_windows
            identifying: HopIdentifier | LiveIdentifier = HopIdentifier(stream, identifier, hop_s, **common)
        else:
            setup = stack.enter_context(closing(moving.setup(source)))
            _refuse_to_creep(setup.robot, n)
            common |= {"early": early, "pre_s": pre_s} | moving.of_pushes
            identifying = LiveIdentifier(stream, identifier, setup, **common)
        warn_of_setups(identifying.differences)
        synthetic = {"synthetic": source.info.synthetic, "synthetic_model": identifier.synthetic}
        keep = stack.enter_context(keeping.writing(identifier.axes, synthetic))
        over = False
        try:
            for push in identifying.pushes(n):
                if quiet:
                    show(in_options(str(push)) if push.decision is None else str(push))
                keep(push)  # said before: the disk may be full
            over = n is None
            if over and not identifying.n_answered:
                raise GranularIdError(identifying.why_none)
        except CaptureError as error:
            raise GranularIdError(str(error)) from error
        except (KeyboardInterrupt, SystemExit):  # how a session without --n ends: with its summary
            leave_lost_terminal()
            raise
        finally:
            views.close()
            for problem in views.errors:
                show(problem, "yellow")
            show(f"{in_options(identifying.summary())}{'; the source came to its end' * over}")


def _warn_of_model(model: Identifier, source: WrenchSource, *, early: bool) -> None:
    if model.synthetic and not source.info.synthetic:
        show(
            "warning: the model was trained on SYNTHETIC recordings; its answers about real materials mean nothing",
            "bold yellow",
        )
    if early and model.core.early is None:
        show(
            "note: the model has no early rule (see granular-id model info): it answers at the end of a push"
        )


def _refuse_with_hop(moving: Moving, *, early: bool, pre_s: float | None) -> None:
    """Refuse what is about pushes, where answers go on."""
    given = ["--early"] * early + ["--pre-s"] * (pre_s is not None)
    for word in given + given_flags(moving):
        if word not in ("--max-gap", "--max-lag-s"):
            raise GranularIdError(f"{word} is about pushes; with --hop-s answers go on: leave it out")


def _check_views(*, view: bool, port: int, no_browser: bool) -> None:
    if not 0 <= port <= 65535:
        raise GranularIdError(f"--port must be between 0 and 65535, got {port}")
    if not view and (port or no_browser):
        raise GranularIdError(f"{'--port' if port else '--no-browser'} is about the page: add --view")


def _open_views(*, view: bool, port: int, browser: bool, quiet: bool) -> list[Any]:
    from granular_id.live import MonitorServer, TerminalView

    views: list[Any] = []
    if view:
        page = MonitorServer(port)
        views.append(page)
        show(f"page: {page.url}")
        if browser:
            webbrowser.open(page.url)
    if not quiet:
        views.append(TerminalView(Console(highlight=False)))
    return views


WHAT = "What to record"


@command
@stopping_the_robot()
def record(
    sensing: Sensing,
    moving: Moving,
    *,
    label: str = option(
        WHAT,
        "Name of the material; several, separated by commas, one after another.",
        "--label",
        "-l",
        default=...,
    ),
    n: int = option(WHAT, "Recordings of each.", "--n", "-n", default=10),
    output: Path | None = option(WHAT, "Folder; a file for each recording is added to it.", "--output", "-o"),
    archive: Path | None = option(WHAT, "Archive to append each recording to, instead; a new one is made."),
    session: str | None = option(WHAT, "What is recorded in one go (one filling, one set-up). Default: now."),
    duration_s: float = option(WHAT, "Length of a recording.", default=3.2),
    pre_s: float = option(WHAT, "Of that, rest before the motion.", default=0.25),
    retries: int = option(
        WHAT, "So many refused recordings in a row are tried again; an arm's at most twice.", default=3
    ),
    quiet: bool = option(WHAT, "Only what went wrong, and the last line.", "--quiet", "-q", default=False),
) -> None:
    """Record pushes through materials, into files or an archive, with label, session, sensor and time.

    A recording is accepted only if it is whole: rest before the motion, every sample, no saturation, the
    right rate. What was refused is said, and recorded again. Works without any hardware, with a simulated
    sensor and robot; such recordings are marked as SYNTHETIC.

    Examples:

    `granular-id record --source rdt://192.168.1.1 --label rice --n 20 --robot manual -o kitchen`
    `granular-id record --source sim: --label "rice,fine sugar,potting gravel" --n 10 --speed 20 -o simulated`
    `granular-id record --source rdt://192.168.1.1 --label rice --n 20 --robot manual --archive pushes`
    """
    folder = output if archive is None else archive
    if folder is None or None not in (output, archive):
        got = "neither" if folder is None else "both"
        raise GranularIdError(
            f"wanted one of -o FOLDER (a file for each push) and --archive ARCHIVE, got {got}"
        )
    at_least("--n", n, 1)
    at_least("--retries", retries, 0)
    positive("--duration-s", duration_s)
    if not 0 <= pre_s < duration_s:
        raise GranularIdError(
            f"--pre-s must be at least 0 and below --duration-s {duration_s:g}, got {pre_s:g}"
        )
    if session is not None and not session.strip():
        raise GranularIdError("--session is empty: give it a name, or leave it out")

    from granular_id.io.parquet.layout import is_parquet_archive
    from granular_id.live import Recorder, opened

    if archive is None and is_parquet_archive(folder):
        raise GranularIdError(f"-o {folder} is an archive: give it by --archive, or name another folder")
    labels = _labels_in(label, sensing.source)
    # All of them before the first push: a misspelt material is found now.
    places = [(sensing.open(url), names) for url, names in _places(labels, sensing.source).items()]
    n_refused = 0
    with made_folder(folder):
        for source, names in places:
            with opened(source, sensing.buffer_s) as stream, closing(moving.setup(source)) as setup:
                _refuse_absent_hands(stream, setup.robot, labels, n)
                recorder = Recorder(
                    stream,
                    setup.robot,
                    folder,
                    archive=archive is not None,
                    session=session,
                    trigger=setup.trigger,
                    n_samples=round(duration_s * source.info.rate_hz),
                    pre_s=pre_s,
                    on_step=None if quiet or source.info.synthetic else _Prompt(by_hand=setup.robot is None),
                    **moving.of_pushes,
                )
                session = recorder.session  # one session, whatever the number of sources
                for name in names:
                    for k in range(n):
                        title = f"{name} {k + 1}/{n}"
                        changed = (k == 0 and name != labels[0]) or (k > 0 and setup.robot is not None)
                        if changed and not source.info.synthetic:
                            _wait_for(title, recorder)
                        refused, said = _recorded(recorder, name, title, retries)
                        if k == 0:
                            _check_truth(name, recorder, stream.info.name)
                        n_refused += refused
                        if not quiet:
                            show(said)
    synthetic = "SYNTHETIC " if any(source.info.synthetic for source, _ in places) else ""
    again = f"; {n_refused} refused and recorded again" if n_refused else ""
    wrote = f"{counted(n * len(labels), f'{synthetic}recording')} of {counted(len(labels), 'material')}"
    show(f"wrote {wrote} into {folder}, session {session!r}{again}")
    if not quiet:
        show(f"look at them with: granular-id {'data' if archive is None else 'archive'} info {folder}")


def _labels_in(text: str, source: str) -> list[str]:
    """Read ``--label``; a simulation knows its materials."""
    from granular_id.live.recorder import checked_label

    labels = names_in(text)
    if source.startswith("sim:"):
        from granular_id.synthetic import PAPER_MATERIALS

        labels = [known_label(name, (material.name for material in PAPER_MATERIALS)) for name in labels]
    if not labels:
        raise GranularIdError(f"--label must name at least one material, got {text!r}")
    if len(set(labels)) < len(labels):
        raise GranularIdError(
            f"--label must name each material once, got {text!r}: --n says how often it is recorded"
        )
    for name in labels:
        checked_label(name)
    return labels


def _places(labels: list[str], url: str) -> dict[str, list[str]]:
    """Return the labels to be recorded from each URL; ``sim:`` alone simulates what the label says."""
    base, _, options = url.partition("?")
    if base != "sim:":
        return {url: labels}
    return {f"sim:{label}?{options}" if options else f"sim:{label}": [label] for label in labels}


def _recorded(recorder: Recorder, label: str, title: str, retries: int) -> tuple[int, str]:
    """Record until it is accepted; return how many were refused, and a line about the recording."""
    from granular_id.live import CaptureError

    refused = 0
    while True:
        try:
            recorded = recorder.record(label)
            break
        except CaptureError as error:
            if error.reason.is_lasting or refused == retries:
                raise GranularIdError(f"{title}: {error}") from error
            refused += 1
            show(f"{title}: refused, {error}; once more", "yellow")
    one = recorded.recording
    begin = one.trigger_index or 0
    rise_n = float(one.wrench[begin:, 0].mean() - one.wrench[: begin or 1, 0].mean())
    late = f", up to {1e3 * one.meta['late_s']:.0f} ms late" if "late_s" in one.meta else ""
    line = f"{title}: {one.n_samples} samples{late}, mean fx {rise_n:+.2f} N over rest, {recorded.path}"
    return refused, line


def _check_truth(label: str, recorder: Recorder, source: str) -> None:
    """Warn where a source that knows what it measures knows better."""
    truth = None if recorder.last is None else recorder.last.meta.get("truth")
    if truth not in (None, label):
        show(f"warning: recorded as {label!r}, but {source} says that it was {truth!r}", "yellow")


class _Prompt:
    """Says when a push may begin; otherwise nothing is seen of a recorder that waits."""

    def __init__(self, *, by_hand: bool) -> None:
        self._by_hand = by_hand
        self._said: Capture | None = None

    def __call__(self, _: Step, capture: Capture) -> None:
        if capture.state.value == "armed" and self._said is not capture:
            self._said = capture
            show("ready: push now" if self._by_hand else "ready", "bold")


def _refuse_absent_hands(stream: Stream, robot: Robot | None, labels: list[str], n: int) -> None:
    """Refuse what needs a person at the container where nobody can be asked: else one bed gets two labels."""
    if stream.info.synthetic or stream.replays or sys.stdin.isatty():
        return
    nobody = "and nobody can be asked: standard input is no terminal"
    if len(labels) > 1:
        raise GranularIdError(
            f"--label names {len(labels)} materials, somebody must change them, {nobody}; record one at a time"
        )
    if n > 1 and _stays(robot):
        raise GranularIdError(
            f"--n {n}: somebody must bring the robot back after each push, as it cannot go back itself, {nobody}"
        )


def _stays(robot: Robot | None) -> bool:
    """Whether an arm stays where its push has ended: somebody must bring it back."""
    from granular_id.live.robot import goes_back
    from granular_id.live.setup import starts_exactly

    return starts_exactly(robot) and not goes_back(robot)


def _refuse_to_creep(robot: Robot | None, n: int | None) -> None:
    """Refuse pushes one after another by an arm that cannot go back: `live` asks nobody to bring it back."""
    if n != 1 and _stays(robot):
        raise GranularIdError("the robot cannot go back by itself (move_back) after a push: add --n 1")


def _wait_for(title: str, recorder: Recorder) -> None:
    """Give a person time to change the material, and to bring an arm back to where its push begins."""
    if sys.stdin.isatty():
        _forget_typed()
        asked = f"{title}: press Enter when material and tool are in place"
        try:
            typer.prompt(asked, default="", show_default=False)
        except typer.Abort:  # what a prompt makes of Ctrl-C
            raise KeyboardInterrupt from None
        recorder.resume()  # somebody says that the tool is in place


def _forget_typed() -> None:
    """Drop what was typed before a question: it is no answer to it."""
    with suppress(ImportError, OSError):  # Windows has no termios
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)
