"""``granular-id train``: a model that names materials, in one safe file; ``granular-id model info`` looks into it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from granular_id._core import GranularIdError
from granular_id._files import write_json
from granular_id.cli.evaluate import BY
from granular_id.cli.method import OneSpace
from granular_id.cli.options import FORCE, a_share, command, count, names_in, option
from granular_id.cli.outputs import (
    JSON_FILE,
    MODEL,
    PICTURE,
    check_outputs,
    say_written,
    show_sentence,
    write_files,
)
from granular_id.cli.recordings import Reading, Steps, equal_recordings

METHOD, ESTIMATE, OUTPUT = "Method", "Estimate", "Output"


@command
def train(
    reading: Reading,
    steps: Steps,
    method: OneSpace,
    *,
    output: Path = option(OUTPUT, "Model file to write: .safetensors.", "--output", "-o", default=...),
    hold_out: str = option(ESTIMATE, BY, default="auto"),
    target_error: float = option(
        ESTIMATE, "Share of early answers that may be wrong.", default=0.01, callback=a_share
    ),
    coverage: float = option(
        ESTIMATE, "Share of recordings whose candidates hold the material.", default=0.9, callback=a_share
    ),
    share_known: float = option(
        ESTIMATE, "Share of known materials not called unknown.", default=0.95, callback=a_share
    ),
    background: str | None = option(
        METHOD, "Materials recorded, but never named: gravel,sand. The unknown stands out better."
    ),
    early: bool = option(ESTIMATE, "Allow answers before the end.", default=True),
    seed: int = option(ESTIMATE, "Same seed, same bytes.", default=0, callback=count(0)),
    figure: Path | None = option(OUTPUT, "Draw accuracy against seconds seen: png, svg or pdf."),
    json: Path | None = option(OUTPUT, "Write estimates, and accuracy against seconds seen."),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print the estimate only.", "--quiet", default=False),
) -> None:
    """Train a model on all recordings and write it into one file.

    `granular-id identify` and `granular-id live` use it. What may be expected of it is measured on recordings
    that are held out, as strictly as they allow: whole sessions where half of the materials have several; else
    halves in time order; else random folds. The output says which. On the same recordings it is found from which
    margin on an answer may be given before the push is over. Where new recordings will be of another tool, or
    depth, --hold-out tool measures that, and chooses by it.

    Features are chosen among the multi-band ones (--space best), the paper's are --space raw+hfmh; the
    options of its histogram (--cutoff-hz, --n-bins ...) and --C are for a --space that has them.

    Examples:

    `granular-id train recordings -o kitchen.safetensors`
    `granular-id train recordings -o kitchen.safetensors --figure over_time.png`
    `granular-id train irregular -o m.safetensors --rate-hz 100 --max-gap-s inf --n-samples shortest`
    `granular-id train recordings -o any-tool.safetensors --hold-out tool`
    `granular-id train recordings -o paper.safetensors --space raw+hfmh --bin-range auto`
    """
    from granular_id.identifier import SPACES

    if method.space not in SPACES:
        raise GranularIdError(
            f"--space must be one of {', '.join(map(repr, SPACES))}, got {method.space!r:.60}"
        )
    method.refuse_impossible(steps.rate_hz)
    if method.tare_s is not None:
        steady = "; --initial steady keeps an offset of the sensor out of the histogram"
        raise GranularIdError(
            "--tare-s is not for models, which take samples as they come: leave it out"
            f"{steady if 'hfmh' in method.space else ''}"
        )
    check_outputs(
        ("--output", output, MODEL),
        ("--figure", figure, PICTURE),
        ("--json", json, JSON_FILE),
        source=reading.path,
        force=force,
    )
    reading.refuse_absent()
    method.refuse_unused()
    data = equal_recordings(reading, steps, quiet=quiet)

    from granular_id.identifier import Identifier, describe_performance

    identifier = Identifier.fit(
        data,
        method.space if not method.given() else method.pipeline(data.rate_hz),
        by=hold_out,
        target_error=target_error if early else None,
        coverage=coverage,
        share_known=share_known,
        background=() if background is None else names_in(background),
        random_state=seed,
        threads=method.threads,
        progress=not quiet,
    )
    course = identifier.over_time_
    if figure is not None and course is None:
        why = identifier.trained["why_no_estimate"]
        raise GranularIdError(f"--figure shows held-out recordings, and there are none: {why}")
    _print(describe_performance(identifier))
    identifier.save(output)  # first: what goes wrong with a figure must not cost the training
    if figure is not None and course is not None:
        from granular_id.plotting import plot_over_time

        plot_over_time(course, path=figure)
    if json is not None:
        known = {name: value for name, value in identifier.trained.items() if name != "source"}
        write_json(json, {**known, "over_time": None if course is None else course.to_dict()})
    say_written([output, figure, json], repeat=not quiet)


# ``granular-id model``

model = typer.Typer(no_args_is_help=True, help="Look into a model file, as `granular-id train` writes it.")


@model.command("info")
@command
def info(
    *,
    file: Path = typer.Argument(metavar="MODEL", help="Model file."),
    json: Path | None = option(OUTPUT, "Write everything but the weights."),
    force: bool = FORCE,
) -> None:
    """Say what a model knows, takes and was trained on, how well it did, and when it answers early.

    How well it did was measured on recordings held out. The file is checked as strictly as for use: what this
    prints is a model that works.

    Examples:

    `granular-id model info kitchen.safetensors`
    `granular-id model info kitchen.safetensors --json kitchen.json`
    """
    check_outputs(("--json", json, JSON_FILE), source=file, force=force)

    from granular_id.identifier import Identifier, describe_model, describe_performance, model_facts

    identifier = Identifier.load(file)
    _print([*describe_model(identifier), *describe_performance(identifier)])
    write_files((json, lambda path: write_json(path, model_facts(identifier))))


def _print(lines: Sequence[str]) -> None:
    for line in lines:
        show_sentence(line, "bold yellow" if "SYNTHETIC" in line else "")
