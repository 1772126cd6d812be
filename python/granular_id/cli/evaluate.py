"""``granular-id evaluate``: how well the materials in a folder of recordings are told apart."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from granular_id.cli.errors import guarded, in_options
from granular_id.cli.prepare import Preparation, prepare
from granular_id.cli.sentences import loaded_text, skipped_text
from granular_id.cli.session import Outputs, Run, evaluate_and_show
from granular_id.cli.settings import (
    at_least,
    bin_range_of,
    chosen_spaces,
    length_of,
    method_fits,
    names_in,
    positive,
)

if TYPE_CHECKING:
    from granular_id.recording import Dataset

__all__ = ["evaluate"]

EXAMPLES = """
Measure how well the materials in a folder of recordings are told apart.

FOLDER holds one sub-folder of CSV files per material (`rice/01.csv`), files named after it (`rice_01.csv`),
or an `index.csv`; header `time,fx,fy,fz,tx,ty,tz`, in seconds, N and N m. Nothing is resampled, cropped or
left out unless an option asks for it; a refusal names the option.

Examples:

`granular-id evaluate recordings`

`granular-id evaluate recordings --train 40 --test 10 --json result.json --csv predictions.csv`

`granular-id evaluate irregular --rate-hz 100 --max-gap-s 1 --n-samples shortest --bin-range auto`

`granular-id evaluate recordings --protocol chronological --spaces raw,raw+hfmh --figures figures`

Random partitions (the paper's protocol) flatter a method that recognises the session instead of the material.
Halves in time order run beside them where the data allow it, and the gap between the two is shown.
"""


class Protocol(str, Enum):
    """Choices of ``--protocol``."""

    paper = "paper"
    chronological = "chronological"
    both = "both"


class Handling(str, Enum):
    """Choices of ``--on-error``, ``--on-gap`` and ``--on-short``."""

    refuse = "raise"
    skip = "skip"


class Repair(str, Enum):
    """Choices of ``--on-time-error``."""

    refuse = "raise"
    repair = "repair"


DATA, SPLIT, METHOD, OUTPUT = "Recordings", "Partitions", "Method", "Output"


def _option(name: str, panel: str, text: str) -> Any:
    return typer.Option(name, help=text, rich_help_panel=panel)


@guarded
def evaluate(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of recordings.")],
    *,
    rate_hz: Annotated[
        float | None, _option("--rate-hz", DATA, "Resample to this rate (linear interpolation).")
    ] = None,
    max_gap_s: Annotated[
        float, _option("--max-gap-s", DATA, "Longest gap to fill when resampling; inf: any.")
    ] = 0.25,
    on_gap: Annotated[
        Handling, _option("--on-gap", DATA, "A longer gap: refuse, or leave the recording out.")
    ] = Handling.refuse,
    duration_s: Annotated[
        float | None, _option("--duration-s", DATA, "Keep this many seconds from the start.")
    ] = None,
    n_samples: Annotated[
        str | None, _option("--n-samples", DATA, "Keep this many samples, or: shortest.")
    ] = None,
    on_short: Annotated[
        Handling, _option("--on-short", DATA, "A shorter recording: refuse, or leave it out.")
    ] = Handling.refuse,
    on_error: Annotated[
        Handling, _option("--on-error", DATA, "A file that cannot be read: refuse, or leave it out.")
    ] = Handling.refuse,
    on_time_error: Annotated[
        Repair,
        _option("--on-time-error", DATA, "Time running backwards or repeated: refuse, or sort and merge."),
    ] = Repair.refuse,
    recorded_hz: Annotated[
        float | None, _option("--recorded-hz", DATA, "Rate of files that have no time column.")
    ] = None,
    exclude: Annotated[str, _option("--exclude", DATA, "Materials to leave out, separated by commas.")] = "",
    protocol: Annotated[
        Protocol, _option("--protocol", SPLIT, "both: chronological too where there is an order in time.")
    ] = Protocol.both,
    train: Annotated[
        int, _option("--train", SPLIT, "Training recordings of each class (random partitions).")
    ] = 50,
    test: Annotated[int, _option("--test", SPLIT, "Test recordings of each class (random partitions).")] = 12,
    partitions: Annotated[int, _option("--partitions", SPLIT, "Number of random partitions.")] = 20,
    seed: Annotated[int, _option("--seed", SPLIT, "Same seed, same numbers.")] = 0,
    spaces: Annotated[
        str, _option("--spaces", METHOD, "Feature spaces separated by commas; paper: all.")
    ] = "paper",
    cutoff_hz: Annotated[float, _option("--cutoff-hz", METHOD, "High-pass cut-off of the histogram.")] = 23.0,
    order: Annotated[int, _option("--order", METHOD, "High-pass order.")] = 8,
    n_bins: Annotated[int, _option("--n-bins", METHOD, "Bins per axis.")] = 100,
    bin_range: Annotated[
        str, _option("--bin-range", METHOD, "LOW,HIGH in N and N m; auto: learned per axis.")
    ] = "-1.5,1.5",
    c: Annotated[float, _option("--C", METHOD, "Box constraint of the support vector machines.")] = 1.0,
    threads: Annotated[
        int | None, _option("--threads", METHOD, "The numbers do not depend on it. Default: all cores.")
    ] = None,
    json: Annotated[Path | None, _option("--json", OUTPUT, "Write figures, settings and partitions.")] = None,
    csv: Annotated[Path | None, _option("--csv", OUTPUT, "Write every prediction.")] = None,
    figures: Annotated[
        Path | None,
        _option("--figures", OUTPUT, "Write mean_forces.png and confusion_PROTOCOL.png into this folder."),
    ] = None,
    confusion: Annotated[
        str | None, _option("--confusion", OUTPUT, "Space of the confusion matrix. Default: the best.")
    ] = None,
    quiet: Annotated[bool, _option("--quiet", OUTPUT, "Print the table of accuracies only.")] = False,
) -> None:
    """Print accuracies, confusions and seconds for a folder; see `EXAMPLES`."""
    if duration_s is not None and n_samples is not None:
        raise ValueError("give one of --duration-s and --n-samples, not both")
    for option, value in (
        ("--rate-hz", rate_hz),
        ("--recorded-hz", recorded_hz),
        ("--duration-s", duration_s),
        ("--C", c),
    ):
        positive(option, value)
    positive("--max-gap-s", max_gap_s, infinite=True)
    for option, count, least in (
        ("--train", train, 1),
        ("--test", test, 1),
        ("--partitions", partitions, 1),
        ("--seed", seed, 0),
        ("--threads", threads, 1),
    ):
        at_least(option, count, least)
    method: dict[str, Any] = {
        "cutoff_hz": cutoff_hz,
        "order": order,
        "n_bins": n_bins,
        "bin_range": bin_range_of(bin_range),
    }
    method_fits(rate_hz=rate_hz, **method)
    chosen = chosen_spaces(spaces, confusion)
    preparation = Preparation(
        rate_hz=rate_hz,
        max_gap_s=max_gap_s,
        duration_s=duration_s,
        n_samples=length_of(n_samples),
        exclude=names_in(exclude),
        on_gap=on_gap.value,
        on_short=on_short.value,
    )
    if folder.is_file():
        raise ValueError(f"{folder} is a file; evaluate wants a folder of recordings")
    outputs = Outputs(json=json, csv=csv, figures=figures)
    with outputs.ready():
        data = _prepared(
            folder,
            {"rate_hz": recorded_hz, "on_error": on_error.value, "on_time_error": on_time_error.value},
            preparation,
            quiet=quiet,
        )

        from granular_id.ecoc import ECOCClassifier  # noqa: PLC0415 (slow to import: a wrong folder is told at once)
        from granular_id.evaluation.plan import in_paper_order  # noqa: PLC0415
        from granular_id.spaces import feature_spaces  # noqa: PLC0415

        known = feature_spaces(rate_hz=data.rate_hz, threads=threads, **method)
        run = Run(
            spaces={name: known[name] for name in chosen or in_paper_order(known)},
            protocols=("paper",) if protocol is Protocol.both else (protocol.value,),
            tried="chronological" if protocol is Protocol.both else None,
            confusion_of=confusion,
            arguments={
                "n_partitions": partitions,
                "train_per_class": train,
                "test_per_class": test,
                "classifier": ECOCClassifier(C=c),
                "n_jobs": threads if threads is not None else -1,
                "random_state": seed,
            },
        )
        evaluate_and_show(data, run, outputs, quiet=quiet)


evaluate.__doc__ = EXAMPLES


def _prepared(folder: Path, reading: dict[str, Any], preparation: Preparation, *, quiet: bool) -> Dataset:
    """Read and prepare the recordings, saying what was done; when quiet, only what was skipped."""
    from granular_id._progress import showing  # noqa: PLC0415 (--help must not wait for numpy)
    from granular_id.io import RecordingFileError, load  # noqa: PLC0415

    console = Console(highlight=False)

    def say(text: str, always: str) -> None:
        shown = always if quiet else text
        if shown:
            console.print(shown, soft_wrap=True, markup=False)

    with showing(not quiet) as callback:
        try:
            data = load(
                folder,
                progress=None if callback is None else lambda done, total: callback(done, total, "reading"),
                **reading,
            )
        except ValueError as error:
            skippable = isinstance(error, RecordingFileError) and error.skippable
            hint = "; add --on-error skip to leave such files out" if skippable else ""
            raise ValueError(in_options(str(error), rate_option="--recorded-hz") + hint) from None
    say(loaded_text(data), skipped_text(data.history[-1]))
    if not data.labels:
        notes = (note for note in data.history[-1].notes if "no column label" in note)
        raise ValueError(f"{folder}: {next(notes, 'no recording has a label')}")
    return prepare(data, preparation, say)
