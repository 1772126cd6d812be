"""``granular-id confidence``: how far the confidence of a model of a set of recordings can be trusted."""

from __future__ import annotations

from pathlib import Path

from granular_id._core import GranularIdError
from granular_id.cli.evaluate import BY
from granular_id.cli.method import OneSpace
from granular_id.cli.options import FORCE, a_share, command, count, numbers_in, option
from granular_id.cli.outputs import JSON_FILE, PICTURE, check_outputs, say_written, show
from granular_id.cli.recordings import Reading, Steps, equal_recordings

SURE, OUTPUT = "Confidence", "Output"


@command
def confidence(
    reading: Reading,
    steps: Steps,
    method: OneSpace,
    *,
    hold_out: str = option(SURE, BY, default="auto"),
    levels: str = option(
        SURE,
        "Shares of recordings whose candidates hold the material, separated by commas.",
        default="0.8,0.9,0.95",
    ),
    share_known: float = option(
        SURE, "Share of known recordings not to be refused.", default=0.95, callback=a_share
    ),
    seed: int = option(SURE, "Same seed, same figures.", default=0, callback=count(0)),
    figure: Path | None = option(OUTPUT, "Draw it: png, svg or pdf."),
    json: Path | None = option(OUTPUT, "Write all figures."),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print the figures only.", "--quiet", default=False),
) -> None:
    """Say how far the confidence of a model of these recordings can be trusted, in sessions that did not train.

    Three questions. Do probabilities mean what they say? Do candidates hold the right material as often as asked for,
    in the mean over held-out sessions and in the worst? Is a material refused that the model has never met: each one is
    left out in turn.

    Examples:

    `granular-id confidence recordings`
    `granular-id confidence recordings --space best --levels 0.9,0.99`
    `granular-id confidence recordings --hold-out tool --figure sure.png --json sure.json`
    """
    wanted = _levels(levels)
    method.refuse_impossible(steps.rate_hz)
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, JSON_FILE), source=reading.path, force=force
    )
    reading.refuse_absent()
    method.refuse_unused()
    data = equal_recordings(reading, steps, quiet=quiet)

    from granular_id.evaluation import confidence_study

    found = confidence_study(
        data,
        method.spaces(data.rate_hz)[method.space],
        by=hold_out,
        levels=wanted,
        share_known=share_known,
        n_jobs=method.n_jobs,
        random_state=seed,
        progress=not quiet,
    )
    show(found.table(), "bold yellow" if found.synthetic else "")
    if figure is not None:
        from granular_id.plotting import plot_confidence

        plot_confidence(found, path=figure)
    if json is not None:
        found.save(json)
    say_written([figure, json], repeat=not quiet)


def _levels(text: str) -> list[float]:
    """Read ``--levels``."""
    wanted = "numbers between 0 and 1, separated by commas, each once"
    found = numbers_in("--levels", text, wanted)
    if not all(0 < share < 1 for share in found) or len(set(found)) < len(found):
        raise GranularIdError(f"--levels must be {wanted}, got {text!r}")
    return found
