"""``granular-id live``: pushes named while they happen."""

from __future__ import annotations

import json as json_format
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.console import Console

from granular_id._words import counted
from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.interrupts import leave_lost_terminal, stopping_the_robot
from granular_id.cli.moving import Moving, Sensing
from granular_id.cli.reading import ACCEPT, Accepted
from granular_id.cli.session import LIVE_ANSWERS, RERUN_LOG, Force, check_outputs
from granular_id.cli.settings import at_least, positive

if TYPE_CHECKING:
    from granular_id.live.identification import LiveIdentifier
    from granular_id.live.push import Push
    from granular_id.live.view import View, Views

__all__ = ["live"]

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

    from granular_id._files import whole_lines  # noqa: PLC0415 (--help must not wait for numpy)
    from granular_id.identifier import Identifier  # noqa: PLC0415
    from granular_id.live.capture_state import CaptureError  # noqa: PLC0415
    from granular_id.live.identification import LiveIdentifier  # noqa: PLC0415
    from granular_id.live.stream import opened  # noqa: PLC0415
    from granular_id.live.view import Views  # noqa: PLC0415

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
        from granular_id.live.monitor import MonitorServer  # noqa: PLC0415

        page = MonitorServer(port)
        console.print(f"page: {page.url}", soft_wrap=True, markup=False)
        if browser:
            webbrowser.open(page.url)
        yield page
    if rerun is not None:
        from granular_id.live.rerun_log import RerunLog  # noqa: PLC0415 (an extra)

        yield RerunLog(rerun)
    if not quiet:
        from granular_id.live.terminal import TerminalView  # noqa: PLC0415

        yield TerminalView(console)


def _warn(console: Console, differences: tuple[str, ...]) -> None:
    from granular_id.recording.setup import other_setup  # noqa: PLC0415 (--help must not wait for numpy)

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
