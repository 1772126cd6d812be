"""``granular-id data check``: what would spoil an evaluation, recording by recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.groups import option, taking
from granular_id.cli.reading import Reading
from granular_id.cli.session import JSON_FILE, Force, check_outputs, say_written
from granular_id.cli.settings import between

__all__ = ["check"]

TEXT = """
Look recordings over for what would spoil an evaluation, and give each a verdict.

Rate, jitter, gaps, clipping, stuck axes, drift, outliers, duplicates, and what gives a label away without the forces:
the clock, the length, the session, the file. Exit code 0 when there is no error, 3 when there is one.

Examples:

`granular-id data check recordings`

`granular-id data check recordings --sensor-range 145,145,290,5,5,5 --json check.json`

`granular-id data check recordings --sensor-range "ATI Mini45 SI-145-5" --strict`
"""

OUTPUT, SENSOR = "Output", "Sensor"
FOUND_ERRORS = 3


@guarded
@taking(Reading)
def check(
    reading: Reading,
    *,
    sensor_range: Annotated[
        str | None,
        option("--sensor-range", SENSOR, "Largest values of the axes, or a name: 'ATI Mini45 SI-145-5'."),
    ] = None,
    false_alarm_rate: Annotated[
        float,
        option("--false-alarm-rate", SENSOR, "Chance that a sound data set shows an outlier or a leak."),
    ] = 0.01,
    strict: Annotated[bool, option("--strict", OUTPUT, "Exit with 3 for warnings too.")] = False,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write findings and verdicts.")] = None,
    force: Force = False,
) -> None:
    """Print findings and verdicts; see `TEXT`."""
    check_outputs(("--json", json, JSON_FILE), source=reading.path, force=force)
    between("--false-alarm-rate", false_alarm_rate)
    limits = _range_of(sensor_range)
    data = reading.load(quiet=False)
    report = data.check(sensor_range=limits, false_alarm_rate=false_alarm_rate, progress=True)
    console = Console(highlight=False)
    console.print()
    console.print(report.text(width=min(console.width, 100)), soft_wrap=True, markup=False)
    if json is not None:
        from granular_id._files import whole_file  # noqa: PLC0415 (slow to import: --help must not wait)

        with whole_file(json) as draft:  # JSON also where the name has no ending
            draft.write_text(report.to_json() + "\n", encoding="utf-8")
        say_written(console, [json], None)
    if report.worst == "error" or (strict and report.worst == "warning"):
        raise typer.Exit(FOUND_ERRORS)


def _range_of(text: str | None) -> str | float | list[float] | None:
    """Read ``--sensor-range``: a name, one number, or a number per axis."""
    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        if "," in text:
            wanted = "a number, one per axis such as 145,145,290,5,5,5, or the name of a sensor"
            raise ValueError(f"--sensor-range must be {wanted}, got {text!r}") from None
        return text
    return numbers if len(numbers) > 1 else numbers[0]


check.__doc__ = TEXT
