"""``granular-id confidence``: how far the confidence of a model of a set of recordings can be trusted."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from granular_id._checks import named
from granular_id._core import GranularIdError
from granular_id.cli import options as opt
from granular_id.cli.outputs import PICTURE, check_outputs, drawing, json_of, show, write_files
from granular_id.cli.recordings import read


def confidence(
    path: opt.Recordings,
    *,
    space: opt.Space = "best",
    hold_out: opt.HoldOut = "auto",
    levels: Annotated[
        str, Option(help="Shares of recordings whose candidates hold the material.")
    ] = "0.8,0.9,0.95",
    share_known: opt.ShareKnown = 0.95,
    figure: opt.Figure = None,
    json: opt.Json = None,
    force: opt.Force = False,
) -> None:
    """Say how far the confidence of a model of these recordings can be trusted, in sessions that did not train.

    Three questions. Do probabilities mean what they say? Do candidates hold the right material as often as requested,
    in the mean over held-out sessions and in the worst? Is a material refused that the model has never met: each one is
    left out in turn.

    Examples:

    - `granular-id confidence recordings`
    - `granular-id confidence recordings --space multiband --levels 0.9,0.99`
    - `granular-id confidence recordings --hold-out tool --figure sure.png --json sure.json`
    """
    wanted = "numbers between 0 and 1, separated by commas, each once"
    shares = opt.numbers_in("--levels", levels, wanted)
    if not all(0 < share < 1 for share in shares) or len(set(shares)) < len(shares):
        raise GranularIdError(f"--levels must be {wanted}, got {levels!r}")
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, json_of("confidence")), source=path, force=force
    )
    from granular_id.evaluation import confidence_study
    from granular_id.spaces import feature_spaces

    named(feature_spaces(), "space", space)
    data = read(path, prepared=True)
    chosen = feature_spaces(rate_hz=data.rate_hz)[space]
    found = confidence_study(data, chosen, by=hold_out, levels=shares, share_known=share_known, n_jobs=-1)
    lines = [line for line in found.table().splitlines() if line]  # on one screen
    show("\n".join(lines), "bold yellow" if found.synthetic else "")
    write_files((figure, drawing("plot_confidence", found)), (json, found.save))
