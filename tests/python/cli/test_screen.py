"""One screen: each command prints at most 24 lines of 80 columns, the answer first; its options are few and used."""

import shlex
from dataclasses import replace

import pytest
import typer.main

from cli_cases import make, run
from granular_id.cli.app import app
from granular_id.io import save
from granular_id.recording import Dataset
from granular_id.synthetic import synthesize

COMMANDS = {
    "evaluate": "evaluate {wide} --report r.html --json r.json --csv p.csv",
    "evaluate, spoiled": "evaluate {spoiled} --report r.html --json r.json --csv p.csv",
    "evaluate, paper": "evaluate {small} --paper 2,6,3",
    "train": "train {wide} -o new.safetensors --space multiband --figure f.png --json n.json",
    "identify": "identify {simulated} {wide} --csv a.csv --json a.json",
    "identify, each moment": "identify {model} {small} --hop-s 0.1",
    "live": "live --source sim:rice?speed=50 --model {simulated} --pre-s 0.1 --n 2 --json l.jsonl",
    "record": "record --source sim:?speed=50 --label rice,macaroni --n 4 -o pushes",
    "explain": "explain {wide} rice macaroni --space multiband",
    "confidence": "confidence {wide} --space multiband",
    "adapt": "adapt {model} {small} -o adapted.safetensors --labelled",
    "extract": "extract {archive} -o features",
    "model": "model {simulated}",
    "data info": "data info {wide}",
    "data check": "data check {odd}",
    "data plot": "data plot {small} -o p.png",
    "data convert": "data convert {wide} x.npz --resample-hz 250 --tare-s 0.1 --duration-s shortest --window-s 0.2",
    "data synthesize": "data synthesize s.npz --n-per-class 1",
    "archive add": "archive add fleet {small}",
    "archive info": "archive info {archive}",
    "archive check": "archive check {archive}",
    "setup show": "setup show {simulated} {small}",
    "identify, archive": "identify {model} {archive} -o answers",
    "refusal": "evaluate {odd} --spaces raw",
    "usage": "evaluate --frobnicate",
}
"""Each command on a small set: 11 materials, 4 sessions."""


@pytest.fixture(scope="module")
def made(folder, model, tmp_path_factory):
    """What the commands take."""
    place = tmp_path_factory.mktemp("screen")
    wide = synthesize(n_per_class=4, duration_s=0.6, sessions=4)
    save(wide, place / "wide.npz")
    apart = [replace(one, start_time=1e9 + 1e4 * ord(one.label[0]) + i) for i, one in enumerate(wide)]
    save(
        Dataset([*apart, *(replace(one, name=f"{one.name} again") for one in apart[:8])]),
        place / "spoiled.npz",
    )
    save(Dataset([*make(4, jitter=0.5), *wide.resample(50)]), place / "odd.npz")
    files = {name: place / f"{name}.npz" for name in ("wide", "odd", "spoiled")}
    files |= {"small": folder, "model": model}
    files |= {"simulated": place / "simulated.safetensors", "archive": place / "fleet"}
    for words in ("archive add {archive} {small}", "train {wide} -o {simulated} --space multiband"):
        assert run(*shlex.split(words.format(**files))).exit_code == 0
    return files


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", COMMANDS)
def test_command_prints_one_screen(made, tmp_path, monkeypatch, name):
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    links = {key: tmp_path / f"{key}{path.suffix}" for key, path in made.items()}
    for key, link in links.items():
        link.symlink_to(made[key])
    words = COMMANDS[name].format(**{key: link.name for key, link in links.items()})
    result = run(*shlex.split(words))
    assert (result.exit_code == 2) == (name in ("refusal", "usage")), result.output
    lines = result.output.splitlines()
    assert len(lines) <= 24, result.output
    assert max(map(len, lines)) <= 80, result.output


# -- options


def commands_in(group, name=""):
    for word, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands_in(command, f"{name}{word} ")
        else:
            options = [one for one in command.params if one.param_type_name == "option"]
            yield name + word, [max(one.opts, key=len) for one in options]


SLOTS = dict(commands_in(typer.main.get_command(app)))


def test_commands_and_their_options_are_few():
    assert {name.partition(",")[0] for name in COMMANDS} >= SLOTS.keys() - {"demo", "setup payload"}
    assert sum(map(len, SLOTS.values())) <= 230
    many = {name: len(options) for name, options in SLOTS.items() if len(options) > 14}
    assert many.keys() <= {"data convert", "live"}
    assert max(many.values()) <= 25


def test_every_command_has_examples_in_its_help():
    for name in SLOTS:
        result = run(*name.split(), "--help", columns=80)
        assert (result.exit_code, "…" in result.stdout) == (0, False)
        assert f"granular-id {name} " in " ".join(result.stdout.split()) or name == "demo"
