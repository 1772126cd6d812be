"""``granular-id record``: pushes into files, one material after another."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from granular_id._words import counted
from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.interrupts import stopping_the_robot
from granular_id.cli.moving import Moving, Sensing
from granular_id.cli.settings import at_least, names_in, positive

if TYPE_CHECKING:
    from granular_id.live.capture import Capture
    from granular_id.live.drive import Step
    from granular_id.live.recorder import Recorder
    from granular_id.live.stream import Stream

__all__ = ["record"]

TEXT = """
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
    """Record pushes; see `TEXT`."""
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

    from granular_id.live.recorder import Recorder, checked_label  # noqa: PLC0415 (--help must not wait for numpy)
    from granular_id.live.stream import opened  # noqa: PLC0415

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


record.__doc__ = TEXT


def _places(labels: list[str], url: str) -> dict[str, list[str]]:
    """Return the labels to be recorded from each URL; ``sim:`` alone simulates what the label says."""
    base, _, options = url.partition("?")
    if base != "sim:":
        return {url: labels}
    return {f"sim:{label}?{options}" if options else f"sim:{label}": [label] for label in labels}


def _recorded(recorder: Recorder, label: str, title: str, retries: int, console: Console) -> tuple[int, str]:
    """Record until it is accepted; return how many were refused, and a line about the recording."""
    from granular_id.live.capture_state import CaptureError  # noqa: PLC0415

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
