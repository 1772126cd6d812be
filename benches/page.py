"""Makes docs/benchmarks.md and two tables of README.md from results.json, accuracy.json and counts.json."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template
from typing import Any

Json = dict[str, Any]

BENCHES = Path(__file__).resolve().parent
PAGE, README = BENCHES.parent / "docs/benchmarks.md", BENCHES.parent / "README.md"
UNITS = {"baseline": "baseline", "avx2": "AVX2", "avx512": "AVX-512"}  # from narrow to wide
NAMES = {
    "best": "best",
    "multiband": "multiband",
    "multirocket": "MultiRocket + ridge",
    "minirocket": "MiniRocket + ridge",
    "hydra": "Hydra + ridge",
    "multirocket+hydra": "MultiRocket, Hydra + ridge",
    "quant": "QUANT + forest",
    "catch22+rf": "Catch22 + forest",
    "dft+svm": "spectrum + SVM",
    "raw+svm": "raw + SVM",
    "1nn": "raw + nearest neighbour",
    "raw+hfmh": "raw+hfmh (paper), bins of the data",
}
OURS = ("best", "multiband", "raw+hfmh")
IN_README = ("best", "multiband", "multirocket", "minirocket", "catch22+rf", "quant", "raw+hfmh")


def digits(value: float, n: int = 3) -> str:
    """A number to n significant digits, written out."""
    value = float(f"{value:.{n}g}")
    return f"{value:,.{max(0, n - 1 - math.floor(math.log10(value)))}f}"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    rule = ("---", *["---:"] * (len(header) - 1))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))


def origin(made: Json) -> list[str]:
    """When, where and with what a run was made, as far as it is known."""
    commit = f"commit {made['commit']}{'' if made['commit is clean'] else ' with changes'}"
    priorities = {True: "real-time priority (`chrt -f 1`)", False: "ordinary priority"}
    how = priorities.get(made["real-time priority"])
    load = made["load before"] is not None and f"load before {made['load before']}"
    machine = (made["processor"], f"{made['cores']} cores", made["system"])
    versions = (f"{name} {number}" for name, number in made["versions"].items() if number)
    lines = (made["date"], commit, how, load), machine, (made["compiler"], *versions)
    return [", ".join(filter(None, line)) for line in lines]


def widest(results: Json) -> tuple[str, Json]:
    """Return the name of the vector unit that the core chooses, and the times with it."""
    unit = [unit for unit in UNITS if unit in results["features"]][-1]
    return UNITS[unit], results["features"][unit]


def features(results: Json) -> str:
    _, us = widest(results)
    rows = {
        "scipy + numpy, in a loop": "scipy + numpy, loop",
        "scipy + numpy, vectorised": "scipy + numpy, vectorised",
        "numba, 1 thread": "numba, 1 thread",
        "numba, 2 threads": "numba, 2 threads",
        "**granular_id, 1 thread**": "granular_id, 1 thread",
        "**granular_id, 2 threads**": "granular_id, 2 threads",
        "numpy, transposing copy of the samples": "transposing copy (floor)",
    }
    copy = us["transposing copy (floor)"]
    lines = ((shown, digits(us[name]), f"{digits(us[name] / copy, 2)}x") for shown, name in rows.items())
    return table(("", "µs", "of the copy"), lines)


def instructions(results: Json, counts: Json) -> str:
    rows = {
        "features of the paper": ("extract 1600 x 6", "granular_id, 1 thread"),
        "as float32": ("extract 1600 x 6, float32", "granular_id, 1 thread, float32"),
        "three silent axes": ("extract 1600 x 6, three silent axes", "granular_id, 1 thread, 3 silent axes"),
        "**multi-band features**": ("multi-band 1600 x 6", "multi-band, 1 thread"),
    }
    counted = [unit for unit in UNITS if f"extract 1600 x 6, {unit}" in counts["instructions"]]
    timed = [unit for unit in UNITS if unit in results["features"]]
    lines = []
    for shown, (path, name) in rows.items():
        thousands = [f"{counts['instructions'][f'{path}, {unit}'] / 1e3:,.0f}" for unit in counted]
        lines.append([shown, *thousands, *(digits(results["features"][unit][name]) for unit in timed)])
    units = [f"{UNITS[unit]}, thousands" for unit in counted] + [f"{UNITS[unit]}, µs" for unit in timed]
    return table(("", *units), lines)


def decision(results: Json) -> str:
    us = results["decision"]["microseconds"]
    rows = (
        ("**features of the paper**, asked once", "ours, cold"),
        ("the same, asked live", "ours, warm"),
        ("the same, asked live, with candidates and refusal", "ours, warm, with rules"),
        ("**multi-band features**, asked once", "ours, bands, cold"),
        ("multi-band features, asked live", "ours, bands, warm"),
        ("multi-band features, asked once, with candidates and refusal", "ours, bands, cold, with rules"),
        ("scipy + numpy, `ECOCClassifier`", "scipy + numpy, ECOCClassifier.predict"),
        ("scipy + numpy, `SVC`", "scipy + numpy, SVC.predict"),
        ("scipy + numpy, scores of the same model by numpy", "scipy + numpy, scores by hand"),
    )
    return table(("", "µs"), ((shown, digits(us[name])) for shown, name in rows))


def ecoc(results: Json) -> str:
    rows = ("OneVsOne(SVC(linear))", "SVC(linear)", "ECOCClassifier")
    seconds = [results["ecoc"][kind]["seconds"] for kind in ("noise", "walk")]
    lines = ((f"`{name}`", *(digits(kind[name], 2) for kind in seconds)) for name in rows)
    return table(("fit and predict", "noise, s", "slow drift, s"), lines)


def accuracies(accuracy: Json, chosen: Iterable[str]) -> str:
    """Methods from the most accurate on the sliding recordings on."""
    sliding, failures = (
        accuracy["folders"][name]["methods"] for name in ("sliding_wrench", "robot_failures")
    )
    lines = []
    for method in sorted(chosen, key=lambda method: -sliding[method]["accuracy"]):
        shown = f"**{NAMES[method]}**" if method in OURS else NAMES[method]
        percent = [f"{100 * rows[method]['accuracy']:.1f}" for rows in (sliding, failures)]
        lines.append((shown, *percent, digits(1e3 * sliding[method]["features_s"], 2)))
    return table(("", "sliding, %", "robot failures, %", "sliding: features, ms"), lines)


def speed(results: Json) -> str:
    """For README.md."""
    made, (unit, us), decided = results["made"], widest(results), results["decision"]["microseconds"]
    one, two = (f"numba {digits(us[f'numba, {threads}'])}" for threads in ("1 thread", "2 threads"))
    vectorised, scores = (
        digits(us["scipy + numpy, vectorised"]),
        digits(decided["scipy + numpy, scores by hand"]),
    )
    rows = (
        (
            "features of the paper, 682 at a time",
            us["granular_id, 1 thread"],
            f"scipy + numpy {vectorised}, {one}",
        ),
        ("on two threads", us["granular_id, 2 threads"], two),
        ("multi-band features, 682 at a time", us["multi-band, 1 thread"], ""),
        ("on two threads", us["multi-band, 2 threads"], ""),
        ("from the last sample to the label", decided["ours, cold"], f"scipy + numpy {scores}"),
        ("by multi-band features", decided["ours, bands, cold"], ""),
    )
    lines = ((shown, f"**{digits(ours)}**", others) for shown, ours, others in rows)
    return f"""{made["processor"]}, {unit}; medians. A transposing copy of the same samples by numpy takes
{digits(us["transposing copy (floor)"])} µs. [All benchmarks](docs/benchmarks.md), with versions.

{table(("µs per recording of 1600 x 6", "granular_id", "others"), lines)}"""


def page(results: Json, accuracy: Json, counts: Json) -> str:
    (unit, us), pushed = widest(results), results["decision"]["microseconds per row pushed"]
    return Template((BENCHES / "page.md").read_text(encoding="utf-8")).substitute(
        made="\n".join(f"- {line}" for line in origin(results["made"])),
        unit=unit,
        runs=results["runs"],
        features=features(results),
        compiler=counts["compiler"].partition(" (")[0],
        instructions=instructions(results, counts),
        bands=digits(us["multi-band, 2 threads"]),
        row=digits(pushed["ours, warm"], 2),
        band_row=digits(pushed["ours, bands, warm"], 2),
        decision=decision(results),
        ecoc=ecoc(results),
        memory=digits(results["ecoc"]["walk"]["megabytes"]["ECOCClassifier, resident"], 2),
        accuracy_made="; ".join(origin(accuracy["made"])),
        draws=accuracy["seeds"],
        accuracies=accuracies(accuracy, NAMES),
    )


def readme(text: str, results: Json, accuracy: Json) -> str:
    """The text with its two tables made anew, each between its comments."""
    for name, made in (("speed", speed(results)), ("accuracy", accuracies(accuracy, IN_README))):
        start, end = f"<!-- {name}: by make benchmarks -->\n", f"<!-- end of {name} -->"
        before, rest = text.split(start)
        text = f"{before}{start}\n{made}\n\n{end}{rest.split(end)[1]}"
    return text


def stored() -> tuple[Json, Json, Json]:
    """Return the figures of all benchmarks, of accuracy.py, and the counts of instructions."""
    names = ("results", "accuracy", "counts")
    results, accuracy, counts = (json.loads((BENCHES / f"{name}.json").read_text("utf-8")) for name in names)
    return results, accuracy, counts["bench"]


def written() -> dict[Path, str]:
    """Return the files and what they hold by the stored figures."""
    results, accuracy, counts = stored()
    text = readme(README.read_text(encoding="utf-8"), results, accuracy)
    return {PAGE: page(results, accuracy, counts), README: text}


if __name__ == "__main__":
    for path, text in written().items():
        if "--check" not in sys.argv:
            path.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            sys.exit(f"{path.name} is not what benches/page.py makes of the stored figures: run it")
