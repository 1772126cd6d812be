"""``granular-id train``: a model that names materials, in one safe file; ``granular-id model info`` looks into it."""

from __future__ import annotations

import json as json_format
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granular_id.cli.method import ONE_VS_ONE, OneSpace
from granular_id.cli.options import Force, at_least, between, command, option
from granular_id.cli.outputs import JSON_FILE, MODEL, PICTURE, check_outputs, say_written, show
from granular_id.cli.recordings import Reading, Steps, equal_recordings

if TYPE_CHECKING:
    from granular_id.identifier import Identifier, Training
    from granular_id.recording import Dataset

TEXT = """
Train a model on all recordings and write it into one file, which `granular-id identify` and `granular-id live` use.

What may be expected of it is measured on recordings that are held out, as strictly as they allow: whole sessions where
every material has several; else halves in time order; else random folds. The output says which. On the same recordings
it is found from which margin on an answer may be given before the push is over.

Features are chosen among the multi-band ones (--space best), the paper's are --space raw+hfmh; the options of its
histogram (--cutoff-hz, --n-bins ...), --C and --coding are for a --space that has them.

PATH is a file or folder of any format, as for `granular-id evaluate`.

Examples:

`granular-id train recordings -o kitchen.safetensors`

`granular-id train recordings -o kitchen.safetensors --posterior kullback_leibler --figure over_time.png`

`granular-id train irregular -o m.safetensors --rate-hz 100 --max-gap-s inf --n-samples shortest`

`granular-id train recordings -o paper.safetensors --space raw+hfmh --bin-range auto`
"""

METHOD, ESTIMATE, OUTPUT = "Method", "Estimate", "Output"


class Posterior(str, Enum):
    """Choices of ``--posterior``."""

    none = "none"
    kullback_leibler = "kullback_leibler"
    wu_lin_weng = "wu_lin_weng"


@dataclass(kw_only=True)
class ModelOptions(OneSpace):
    """What a model is made of."""

    coding: Annotated[str, option(METHOD, "onevsone (the paper), onevsall, ordinal, denserandom ...")] = (
        ONE_VS_ONE
    )
    posterior: Annotated[Posterior, option(METHOD, "Also fit probabilities of the materials.")] = (
        Posterior.none
    )

    def given(self) -> dict[str, Any]:
        """Return the settings that are not the usual ones; the recipe itself knows where C has no use."""
        given = super().given()
        given.pop("C", None)
        return given if self.coding == ONE_VS_ONE else given | {"coding": self.coding}

    def recipe(self) -> dict[str, Any]:
        """Return the settings as `granular_id.identifier.Recipe` takes them."""
        if self.tare_s is not None:
            steady = "; --initial steady keeps an offset of the sensor out of the histogram"
            raise ValueError(
                "--tare-s is not for models, which take samples as they come: leave it out"
                f"{steady if 'hfmh' in self.space else ''}"
            )
        return {
            **{name: value for name, value in self.settings.items() if name != "tare_s"},
            "space": self.space,
            "C": self.c,
            "coding": self.coding,
            "posterior": None if self.posterior is Posterior.none else self.posterior.value,
        }


@command(TEXT, Reading, Steps, ModelOptions)
def train(
    reading: Reading,
    steps: Steps,
    method: ModelOptions,
    *,
    output: Annotated[Path, option(OUTPUT, "Model file to write: .safetensors.", "--output", "-o")],
    target_error: Annotated[float, option(ESTIMATE, "Share of early answers that may be wrong.")] = 0.01,
    coverage: Annotated[
        float, option(ESTIMATE, "Share of recordings whose candidates hold the right material.")
    ] = 0.9,
    share_known: Annotated[
        float, option(ESTIMATE, "Share of known materials that is not called unknown.")
    ] = 0.95,
    early: Annotated[bool, option(ESTIMATE, "Allow answers before the end.")] = True,
    folds: Annotated[int, option(ESTIMATE, "Random folds, without sessions and order in time.")] = 5,
    seed: Annotated[int, option(ESTIMATE, "Same seed, same bytes.")] = 0,
    figure: Annotated[
        Path | None, option(OUTPUT, "Draw accuracy against seconds seen: png, svg or pdf.")
    ] = None,
    json: Annotated[
        Path | None, option(OUTPUT, "Write estimates, and accuracy against seconds seen.")
    ] = None,
    force: Force = False,
    quiet: Annotated[bool, option(OUTPUT, "Print the estimate only.", "--quiet")] = False,
) -> None:
    """Train, estimate, write."""
    between("--target-error", target_error)
    between("--coverage", coverage)
    between("--share-known", share_known)
    at_least("--folds", folds, 2)
    at_least("--seed", seed, 0)
    method.refuse_impossible(steps.rate_hz)
    settings = method.recipe()
    check_outputs(
        ("--output", output, MODEL),
        ("--figure", figure, PICTURE),
        ("--json", json, JSON_FILE),
        source=reading.path,
        force=force,
    )
    reading.refuse_absent()
    from granular_id.identifier import SPACES, Recipe

    if method.space in SPACES:  # else the recipe says which there are
        method.refuse_unused()
    recipe = Recipe(**settings, random_state=seed)
    data = equal_recordings(reading, steps, quiet=quiet)

    from granular_id.identifier import Identifier, train as fit

    training = fit(
        data,
        recipe,
        early=early,
        target_error=target_error,
        coverage=coverage,
        share_known=share_known,
        n_folds=folds,
        threads=method.threads,
        progress=not quiet,
    )
    identifier = Identifier(training.core)
    if figure is not None and training.held is None:
        why = training.trained["why_no_estimate"]
        raise ValueError(f"--figure shows held-out recordings, and there are none: {why}")
    _print_model(identifier, brief=True)
    identifier.save(output)  # first: what goes wrong with a figure must not cost the training
    _write_extras(training, data, figure, json)
    say_written([output, figure, json], repeat=not quiet)


def _write_extras(training: Training, data: Dataset, figure: Path | None, json: Path | None) -> None:
    """Write the figure and the JSON file that were asked for."""
    from granular_id._files import write_json
    from granular_id.identifier import over_time

    course = None
    if training.held is not None:
        course = over_time(training.held, data.rate_hz, training.early, synthetic=data.is_synthetic)
    if figure is not None and course is not None:
        from granular_id.plotting import plot_over_time

        plot_over_time(course, path=figure)
    if json is not None:
        write_json(json, {**training.trained, "over_time": None if course is None else course.to_dict()})


# ``granular-id model``

model = typer.Typer(no_args_is_help=True, help="Look into a model file, as `granular-id train` writes it.")

INFO = """
Say what a model was trained on, which materials it knows, what it takes, how well it did on recordings held out, and
when it answers early.

The file is checked as strictly as for use: what this prints is a model that works.

Examples:

`granular-id model info kitchen.safetensors`

`granular-id model info kitchen.safetensors --json kitchen.json`
"""


@model.command("info")
@command(INFO)
def info(
    *,
    file: Annotated[Path, typer.Argument(metavar="MODEL", help="Model file.")],
    json: Annotated[Path | None, option(OUTPUT, "Write everything but the weights.")] = None,
    force: Force = False,
) -> None:
    """Print what is in a model file."""
    check_outputs(("--json", json, JSON_FILE), source=file, force=force)

    from granular_id.identifier import Identifier

    identifier = Identifier.load(file)
    _print_model(identifier)
    if json is not None:
        from granular_id._files import write_json

        write_json(json, _everything(identifier))
        say_written([json])


def _print_model(identifier: Identifier, *, brief: bool = False) -> None:
    """Print what a model is and what may be expected of it; when brief, only the latter."""
    from granular_id.identifier import description, promises

    lines = promises(identifier) if brief else [*description(identifier), *promises(identifier)]
    for line in lines:
        show(line, "bold yellow" if "SYNTHETIC" in line else "")


def _plain(spec: Any) -> dict[str, object]:
    """Say what is extracted, in types that JSON knows."""
    said = dict(spec.__getnewargs_ex__()[1])
    said = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in said.items()}
    bands = getattr(spec, "bands", None)
    return said if bands is None else said | {"bands": bands, "block_sizes": spec.block_sizes}


def _everything(identifier: Identifier) -> dict[str, object]:
    core = identifier.core
    metadata = dict(core.metadata)
    return {
        **{
            name: metadata[name]
            for name in sorted(metadata)
            if name not in ("axes", "units", "trained", "lead_s")
        },
        "classes": list(identifier.classes),
        "space": identifier.space,
        "spec": _plain(core.spec),
        "n_samples": identifier.n_samples,
        "rate_hz": identifier.rate_hz,
        "lead_s": identifier.lead_s,
        "axes": list(identifier.axes),
        "units": json_format.loads(metadata["units"]),
        "n_features": core.n_features,
        "n_learners": core.n_learners,
        "loss": core.loss,
        "decoding": core.decoding,
        "early": None if core.early is None else core.early.tolist(),
        "trained": identifier.trained,
    }
