"""``granular-id record``: pushes into files, or into an archive."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from granular_id._core import GranularIdError
from granular_id._files import NO_FOLDERS, RECORDINGS, made_folder
from granular_id._text import counted, known_label
from granular_id.cli.interrupts import leave_lost_terminal, stopping_the_robot
from granular_id.cli.live import (
    Begins,
    Direction,
    MaxForce,
    MaxGap,
    MaxTorque,
    Robots,
    Source,
    Speed,
    Threshold,
    refuse_absent_replay,
    stays,
    vector_in,
)
from granular_id.cli.options import POSITIVE, names_in
from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from granular_id.live import Recorder
    from granular_id.live.capture import Capture
    from granular_id.live.push import Step
    from granular_id.live.robot import Robot
    from granular_id.live.stream import Stream

_RETRIES = 3
"""So many refused recordings in a row are tried again."""


@stopping_the_robot()
def record(
    *,
    source: Source,
    label: Annotated[str, Option("--label", "-l", help="Material; several, with commas, one after another.")],
    output: Annotated[
        Path, Option("--output", "-o", help="Folder for a file a push; x.parquet, an archive.")
    ],
    n: Annotated[int, Option("--n", "-n", min=1, help="Recordings of each.")] = 10,
    session: Annotated[str | None, Option(help="What is recorded in one go. Default: now.")] = None,
    duration_s: Annotated[float, Option(callback=POSITIVE, help="Length, 0.25 s of rest included.")] = 3.2,
    robot: Robots = "auto",
    direction: Direction = "1,0,0",
    speed_m_s: Speed = 0.03,
    trigger: Begins = "auto",
    threshold_n: Threshold = 0.5,
    max_gap: MaxGap = 0,
    max_force_n: MaxForce = None,
    max_torque_n_m: MaxTorque = None,
) -> None:
    """Record pushes through materials, into files or an archive, with label, session, sensor and time.

    A recording is accepted only if it is whole: rest before the motion, every sample, no saturation, the
    right rate. What was refused is printed, and recorded again. Works without any hardware, with a simulated
    sensor and robot; such recordings are marked as SYNTHETIC.

    Examples:

    - `granular-id record --source rdt://192.168.1.1 --label rice --n 20 --robot manual -o kitchen`
    - `granular-id record --source "sim:?speed=20" --label "rice,fine sugar" --n 10 -o simulated`
    """
    vector = vector_in(direction)
    if session is not None and not session.strip():
        raise GranularIdError("--session is empty: give it a name, or leave it out")
    refuse_absent_replay(source)
    in_archive = _into_archive(output)

    from granular_id.live import Recorder, open_source, opened, setup_of

    labels = _labels_in(label, source)
    # All of them before the first push: a misspelt material is found now.
    places = [(open_source(url), names) for url, names in _places(labels, source).items()]
    n_refused, recorded = 0, list[str]()

    def say_recorded() -> None:
        leave_lost_terminal()
        if recorded:
            synthetic = "SYNTHETIC " if any(sensor.info.synthetic for sensor, _ in places) else ""
            again = f"; {n_refused} refused and recorded again" if n_refused else ""
            n_labels = counted(len(set(recorded)), "material")
            wrote = f"{counted(len(recorded), f'{synthetic}recording')} of {n_labels}"
            show(f"wrote {wrote} into {output}, session {session!r}{again}")

    with ExitStack() as at_end, made_folder(output):
        at_end.callback(say_recorded)
        for sensor, names in places:
            with (
                opened(sensor) as stream,
                closing(setup_of(sensor, robot, trigger, threshold_n=threshold_n)) as setup,
            ):
                _refuse_absent_hands(stream, setup.robot, labels, n)
                recorder = Recorder(
                    stream,
                    setup.robot,
                    output,
                    archive=in_archive,
                    session=session,
                    trigger=setup.trigger,
                    n_samples=round(duration_s * sensor.info.rate_hz),
                    direction=vector,
                    speed_m_s=speed_m_s,
                    max_gap=max_gap,
                    max_force_n=max_force_n,
                    max_torque_n_m=max_torque_n_m,
                    on_step=None
                    if sensor.info.synthetic
                    else _prompt("ready" if setup.robot else "ready: push now"),
                )
                session = recorder.session  # one session, whatever the number of sources
                for name in names:
                    for k in range(n):
                        title = f"{name} {k + 1}/{n}"
                        changed = (k == 0 and name != labels[0]) or (k > 0 and setup.robot is not None)
                        if changed and not sensor.info.synthetic:
                            _wait_for(title, recorder)
                        refused, line = _recorded(recorder, name, title)
                        recorded.append(name)
                        if k == 0:
                            _check_truth(name, recorder, stream.info.name)
                        n_refused += refused
                        show(line)


def _into_archive(output: Path) -> bool:
    """Whether pushes go into an archive, by what is there or by its name, as `data convert` takes it."""
    from granular_id.io.parquet.layout import is_parquet_archive

    if output.suffix.lower() == ".parquet" or is_parquet_archive(output):
        return True
    if output.suffix.lower() in (*RECORDINGS, *NO_FOLDERS):
        raise GranularIdError(
            f"--output writes a folder, a file a push, or an archive, {output.stem}.parquet, got {output.name!r}: "
            f"granular-id data convert FOLDER {output.stem}.npz makes one file of a folder"
        )
    return False


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


def _recorded(recorder: Recorder, label: str, title: str) -> tuple[int, str]:
    """Record until it is accepted; return how many were refused, and a line about the recording."""
    from granular_id.live import CaptureError

    refused = 0
    while True:
        try:
            recorded = recorder.record(label)
            break
        except CaptureError as error:
            if error.reason.is_lasting or refused == _RETRIES:
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


def _prompt(text: str) -> Callable[[Step, Capture], None]:
    """Return what says when a push may begin; otherwise nothing is seen of a recorder that waits."""
    announced: list[Capture] = []

    def say(_: Step, capture: Capture) -> None:
        if capture.state.value == "armed" and capture not in announced:
            announced[:] = [capture]
            show(text, "bold")

    return say


def _refuse_absent_hands(stream: Stream, robot: Robot | None, labels: list[str], n: int) -> None:
    """Refuse what needs a person at the container where nobody can answer: else one bed gets two labels."""
    if stream.info.synthetic or stream.replays or sys.stdin.isatty():
        return
    nobody = "and nobody can answer: standard input is no terminal"
    if len(labels) > 1:
        raise GranularIdError(
            f"--label names {len(labels)} materials, somebody must change them, {nobody}; record one at a time"
        )
    if n > 1 and stays(robot):
        raise GranularIdError(
            f"--n {n}: somebody must bring the robot back after each push, as it cannot go back itself, {nobody}"
        )


def _wait_for(title: str, recorder: Recorder) -> None:
    """Give a person time to change the material, and to bring an arm back to where its push begins."""
    if sys.stdin.isatty():
        _forget_typed()
        question = f"{title}: press Enter when material and tool are in place"
        try:
            typer.prompt(question, default="", show_default=False)
        except typer.Abort:  # what a prompt makes of Ctrl-C
            raise KeyboardInterrupt from None
        recorder.resume()  # somebody says that the tool is in place


def _forget_typed() -> None:
    """Drop what was typed before a question: it is no answer to it."""
    with suppress(ImportError, OSError):  # Windows has no termios
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)
