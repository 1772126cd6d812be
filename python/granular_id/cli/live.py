"""``granular-id live``: pushes named while they happen."""

from __future__ import annotations

import json as json_format
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.console import Console
from typer import Option

from granular_id._core import GranularIdError
from granular_id._files import check_source, made_folder
from granular_id._text import counted
from granular_id.cli import options as opt
from granular_id.cli.identify import read_for
from granular_id.cli.interrupts import leave_lost_terminal, stopping_the_robot
from granular_id.cli.outputs import LIVE_ANSWERS, check_outputs, show, warn_of_setups

if TYPE_CHECKING:
    from granular_id.identifier import Identifier
    from granular_id.live import HopIdentifier, LiveIdentifier, Push
    from granular_id.live.robot import Robot
    from granular_id.live.source import WrenchSource

Source = Annotated[
    str,
    Option(
        "--source",
        "-s",
        help="rdt://HOST, replay:PATH, sim:MATERIAL, sim:unknown, or with granular-id-contrib ur://HOST, bota:FILE "
        'and ros2://TOPIC; options as in "sim:rice?speed=10".',
    ),
]
Robots = Annotated[
    str,
    Option(
        help="auto: the simulated robot of a simulated sensor, else nobody. none: nobody. manual: you push when "
        "prompted. source: the arm that the source is part of, which WILL MOVE. ur://HOST, with "
        "granular-id-contrib: that arm, which WILL MOVE."
    ),
]
Direction = Annotated[str, Option(help="Where the robot pushes: X,Y,Z in its base frame.")]
Speed = Annotated[float, Option(callback=opt.POSITIVE, help="Speed of the robot; the paper's.")]
Begins = Annotated[
    Literal["auto", "motion", "force"],
    Option(help="What begins a push. auto: the robot's motion; without one the force."),
]
Threshold = Annotated[float, Option(callback=opt.POSITIVE, help="Change of force that is a motion, N.")]
MaxGap = Annotated[int, Option(min=0, help="Missing samples in a row that are filled in, flagged.")]
MaxForce = Annotated[
    float | None,
    Option(
        callback=opt.POSITIVE,
        help="A larger change of force from rest, N, stops the robot and ends the session.",
    ),
]
MaxTorque = Annotated[float | None, Option(callback=opt.POSITIVE, help="The same of torque, N m.")]


@stopping_the_robot()
def live(
    *,
    source: Source,
    model: Annotated[Path, Option("--model", "-m", help="Model file, from `granular-id train`.")],
    n: Annotated[int | None, Option("--n", "-n", min=1, help="Stop after so many answers.")] = None,
    early: Annotated[bool, Option("--early", help="Answer as soon as the model is sure enough.")] = False,
    hop_s: Annotated[
        float | None, Option(callback=opt.POSITIVE, help="Answer every so many seconds.")
    ] = None,
    accept: opt.Accept = None,
    robot: Robots = "auto",
    direction: Direction = "1,0,0",
    speed_m_s: Speed = 0.03,
    trigger: Begins = "auto",
    threshold_n: Threshold = 0.5,
    pre_s: Annotated[
        float | None,
        Option(callback=opt.POSITIVE, help="Seconds of rest ahead of the motion. Default: the model's."),
    ] = None,
    timeout_s: Annotated[float, Option(callback=opt.POSITIVE, help="Seconds to wait for the motion.")] = 30.0,
    max_gap: MaxGap = 0,
    max_force_n: MaxForce = None,
    max_torque_n_m: MaxTorque = None,
    view: Annotated[bool, Option("--view", help="Also show a page in the browser (127.0.0.1 only).")] = False,
    no_browser: Annotated[bool, Option("--no-browser", help="Print its address, do not open it.")] = False,
    json: Annotated[Path | None, Option(help="Write each answer as one line of JSON.")] = None,
    archive: Annotated[Path | None, Option(help="Append each answered push; a new one is made.")] = None,
    force: opt.Force = False,
    quiet: opt.Quiet = False,
) -> None:
    """Name the material of each push while the tool moves.

    The screen shows the axes, the ranking of materials as it grows, the answer, lag and losses. Without `--n` it goes
    on until Ctrl-C or the end of a replay, and ends with how many answers were right, where the source knows.
    With `--hop-s` it answers about the newest samples, as `granular-id identify --hop-s` does.

    A frame or sign other than in the training is refused before anything moves, unless `--accept` says that it may be;
    another sensor, filter, tool, trigger or speed is a warning beside every answer.

    `--archive` keeps what was pushed, with the answer in its `meta`; the label stays empty, unless the source knows it.
    `sim:unknown` works without hardware: what a simulation answers says nothing about real materials.

    Examples:

    - `granular-id live --source rdt://192.168.1.1 --model kitchen.safetensors --view`
    - `granular-id live --source "sim:rice,fine_sugar?speed=10" --model simulated.safetensors --n 20`
    - `granular-id live --source replay:drive.csv --model grounds.safetensors --hop-s 0.5 --view`
    - `granular-id live --source rdt://192.168.1.1 --model kitchen.safetensors --archive seen`
    """
    limits = {"max_force_n": max_force_n, "max_torque_n_m": max_torque_n_m}
    pushing: dict[str, Any] = {
        **limits,
        "direction": vector_in(direction),
        "speed_m_s": speed_m_s,
        "timeout_s": timeout_s,
    }
    beside = {
        "--early": early,
        "--pre-s": pre_s,
        "--robot": robot != "auto",
        "--trigger": trigger != "auto",
        "--direction": direction != "1,0,0",
        "--threshold-n": threshold_n != 0.5,
        "--max-force-n": max_force_n,
        "--max-torque-n-m": max_torque_n_m,
        "--archive": archive,
    }
    if hop_s is not None:
        opt.refuse(beside, "is about pushes; with --hop-s answers go on")
    if early:
        opt.refuse({"--archive": archive}, "keeps whole pushes, with --early there are none")
    if not view:
        opt.refuse({"--no-browser": no_browser}, "is about the page of --view")
    check_outputs(("--json", json, LIVE_ANSWERS), source=model, force=force)

    from granular_id.identifier import Identifier
    from granular_id.live import HopIdentifier, LiveIdentifier, Views, opened, setup_of

    refuse_absent_replay(source)
    identifier = Identifier.load(model)
    sensor = _open(source, identifier)
    _warn_of_model(identifier, sensor, early=early)
    with ExitStack() as stack:
        stream = stack.enter_context(opened(sensor))
        views = stack.enter_context(Views(_open_views(view=view, browser=not no_browser, quiet=quiet)))
        common: dict[str, Any] = {
            "views": views,
            "accept": [one.value for one in accept or ()],
            "max_gap": max_gap,
        }
        if hop_s is not None:
            identifying: HopIdentifier | LiveIdentifier = HopIdentifier(stream, identifier, hop_s, **common)
        else:
            setup = stack.enter_context(closing(setup_of(sensor, robot, trigger, threshold_n=threshold_n)))
            if n != 1 and stays(setup.robot):  # nobody is there to bring it back
                raise GranularIdError(
                    "the robot cannot go back by itself (move_back) after a push: add --n 1"
                )
            identifying = LiveIdentifier(
                stream, identifier, setup, early=early, pre_s=pre_s, **common, **pushing
            )
        warn_of_setups(identifying.differences)
        synthetic = {"synthetic": sensor.info.synthetic, "synthetic_model": identifier.synthetic}
        keep = stack.enter_context(_keeping(json, archive, identifier.axes, synthetic))
        try:
            _answer(identifying, n, keep, quiet=quiet)
        finally:
            views.close()
            for problem in views.errors:
                show(problem, "yellow")
            show(identifying.summary())


def _answer(
    identifying: HopIdentifier | LiveIdentifier, n: int | None, keep: Callable[[Push], None], *, quiet: bool
) -> None:
    """Answer pushes, or hops, until there are `n` or the source ends."""
    from granular_id.live import CaptureError

    try:
        for push in identifying.pushes(n):
            if quiet:
                show(str(push))
            keep(push)  # printed before: the disk may be full
    except CaptureError as error:
        raise GranularIdError(str(error)) from error
    except (KeyboardInterrupt, SystemExit):  # how a session without --n ends: with its summary
        leave_lost_terminal()
        raise
    if n is None:
        if not identifying.n_answered:
            raise GranularIdError(identifying.why_none)
        show("the source came to its end")


def vector_in(direction: str) -> tuple[float, ...]:
    """Read ``--direction``."""
    return tuple(opt.numbers_in("--direction", direction, "X,Y,Z such as 0,-1,0", 3))


def refuse_absent_replay(source: str) -> None:
    """Refuse recordings that are not there, before imports that take longer than a look."""
    from granular_id.live import SourceUrl

    url = SourceUrl.parse(source, {})
    if url.scheme == "replay":
        check_source(url.path)


def stays(robot: Robot | None) -> bool:
    """Whether an arm stays where its push has ended: somebody must bring it back."""
    from granular_id.live.robot import goes_back
    from granular_id.live.setup import starts_exactly

    return starts_exactly(robot) and not goes_back(robot)


def _open(source: str, identifier: Identifier) -> WrenchSource:
    """Make the source; recordings are read as those of the training of a model were."""
    from granular_id.live import ReplaySource, SourceUrl, open_source

    url = SourceUrl.parse(source, {})
    if url.scheme != "replay" or {"axes", "units", "rate_hz"} & url.options.keys():
        return open_source(source)
    url.allow("axes", "pause_s", "rate_hz", "speed", "units")
    data = read_for(Path(url.path), identifier, quiet=True)
    return ReplaySource(data, speed=url.number("speed", 1.0), pause_s=url.number("pause_s", 1.0))


def _warn_of_model(model: Identifier, source: WrenchSource, *, early: bool) -> None:
    if model.synthetic and not source.info.synthetic:
        show(
            "warning: the model was trained on SYNTHETIC recordings; its answers about real materials mean nothing",
            "bold yellow",
        )
    if early and model.core.early is None:
        show("note: the model has no early rule (see granular-id model): it answers at the end of a push")


def _open_views(*, view: bool, browser: bool, quiet: bool) -> list[Any]:
    from granular_id.live import MonitorServer, TerminalView

    views: list[Any] = []
    if view:
        page = MonitorServer(0)
        views.append(page)
        show(f"page: {page.url}")
        if browser:
            webbrowser.open(page.url)
    if not quiet:
        views.append(TerminalView(Console(highlight=False)))
    return views


@contextmanager
def _keeping(
    json: Path | None, archive: Path | None, axes: Sequence[str], about: dict[str, Any]
) -> Iterator[Callable[[Push], None]]:
    """Yield what writes a push; `about` goes beside each answer."""
    # all that an append needs is loaded before anything moves: in between rows would be lost meanwhile
    from granular_id._files import whole_lines
    from granular_id.recording import Dataset

    n_appended = n_answers = 0
    with ExitStack() as stack:
        appender = None
        if archive is not None:
            from granular_id.io.parquet.writing import Appender

            stack.enter_context(made_folder(archive))
            appender = Appender(archive, axes, "the sensor")
        answer = None if json is None else stack.enter_context(whole_lines(json))

        def keep(push: Push) -> None:
            nonlocal n_appended, n_answers
            if answer is not None:
                answer(json_format.dumps({"format": "granular_id.live/1"} | push.to_dict() | about))
                n_answers += 1
            if appender is not None and push.recording is not None:
                appender.append(Dataset([push.recording]))
                n_appended += 1

        try:
            yield keep
        finally:
            if archive is not None:
                show(f"stored {counted(n_appended)} in {archive}")
            if json is not None and n_answers:
                show(f"wrote {json}, {counted(n_answers, 'answer')}")
