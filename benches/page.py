"""Makes docs/benchmarks.md, the table of README.md, and python/README.md, of the stored figures; --check compares."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template
from typing import Any

Json = dict[str, Any]

BENCHES = Path(__file__).resolve().parent
ROOT = BENCHES.parent
SITE = "https://github.com/granular-id/granular-id"
UNITS = {"baseline": "baseline", "avx2": "AVX2", "avx512": "AVX-512"}  # from narrow to wide
METHODS = {
    "best": "**best**",
    "multiband": "**multiband**",
    "multirocket": "MultiRocket + ridge",
    "minirocket": "MiniRocket + ridge",
    "multirocket+hydra": "MultiRocket, Hydra + ridge",
    "quant": "QUANT + forest",
    "rdst": "RDST + ridge",
    "freshprince": "FreshPRINCE",
    "catch22+rf": "Catch22 + forest",
    "raw+svm": "raw + SVM",
    "raw+hfmh": "**raw+hfmh (paper), bins of the data**",
}
FEATURES = {
    "scipy + numpy, in a loop": "scipy + numpy, loop",
    "scipy + numpy, vectorised": "scipy + numpy, vectorised",
    "numba, 1 thread": "numba, 1 thread",
    "numba, 2 threads": "numba, 2 threads",
    "**granular_id, 1 thread**": "granular_id, 1 thread",
    "**granular_id, 2 threads**": "granular_id, 2 threads",
    "numpy, transposing copy of the samples": "transposing copy (floor)",
}
INSTRUCTIONS = {
    "features of the paper": ("extract 1600 x 6", "granular_id, 1 thread"),
    "three silent axes": ("extract 1600 x 6, three silent axes", "granular_id, 1 thread, 3 silent axes"),
    "**multi-band features**": ("multi-band 1600 x 6", "multi-band, 1 thread"),
}
DECISIONS = {
    "**features of the paper**, one answer": "ours, cold",
    "the same, live": "ours, warm",
    "the same, live, with candidates and refusal": "ours, warm, with rules",
    "**multi-band features**, one answer": "ours, bands, cold",
    "multi-band features, live": "ours, bands, warm",
    "multi-band features, one answer, with candidates and refusal": "ours, bands, cold, with rules",
    "scipy + numpy, `ECOCClassifier`": "scipy + numpy, ECOCClassifier.predict",
    "scipy + numpy, `SVC`": "scipy + numpy, SVC.predict",
    "scipy + numpy, scores of the same model by numpy": "scipy + numpy, scores by hand",
}


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
    load = made["load before"] is not None and f"load before {made['load before']}"
    machine = (made["processor"], f"{made['cores']} cores", made["system"])
    versions = (f"{name} {number}" for name, number in made["versions"].items() if number)
    when = (made["date"], commit, priorities.get(made["real-time priority"]), load)
    return [", ".join(filter(None, line)) for line in (when, machine, (made["compiler"], *versions))]


def widest(results: Json) -> tuple[str, Json]:
    """Return the name of the vector unit that the core chooses, and the times with it."""
    unit = [unit for unit in UNITS if unit in results["features"]][-1]
    return UNITS[unit], results["features"][unit]


def features(us: Json) -> str:
    copy = us["transposing copy (floor)"]
    lines = ((shown, digits(us[name]), f"{digits(us[name] / copy, 2)}x") for shown, name in FEATURES.items())
    return table(("", "µs", "of the copy"), lines)


def instructions(results: Json, counts: Json) -> str:
    counted = [unit for unit in UNITS if f"extract 1600 x 6, {unit}" in counts["instructions"]]
    timed = [unit for unit in UNITS if unit in results["features"]]
    lines = []
    for shown, (path, name) in INSTRUCTIONS.items():
        thousands = [f"{counts['instructions'][f'{path}, {unit}'] / 1e3:,.0f}" for unit in counted]
        lines.append([shown, *thousands, *(digits(results["features"][unit][name]) for unit in timed)])
    units = [f"{UNITS[unit]}, thousands" for unit in counted] + [f"{UNITS[unit]}, µs" for unit in timed]
    return table(("", *units), lines)


def classifier(ecoc: Json) -> str:
    rows = ("OneVsOne(SVC(linear))", "SVC(linear)", "ECOCClassifier")
    lines = (
        (f"`{name}`", *(digits(ecoc[kind]["seconds"][name], 2) for kind in ("noise", "walk")))
        for name in rows
    )
    return table(("fit and predict", "noise, s", "slow drift, s"), lines)


def accuracies(folders: Json) -> str:
    """Methods from the most accurate on the sliding recordings on."""
    sliding, failures = (folders[name]["methods"] for name in ("sliding_wrench", "robot_failures"))
    lines = []
    for method in sorted(filter(sliding.get, METHODS), key=lambda method: -sliding[method]["accuracy"]):
        percent = [f"{100 * rows[method]['accuracy']:.1f}" for rows in (sliding, failures)]
        lines.append((METHODS[method], *percent, digits(1e3 * sliding[method]["features_s"], 2)))
    return table(("", "sliding, %", "robot failures, %", "sliding: features, ms"), lines)


def page(results: Json, accuracy: Json, counts: Json) -> str:
    (unit, us), decision = widest(results), results["decision"]
    return Template((BENCHES / "page.md").read_text(encoding="utf-8")).substitute(
        made="\n".join(f"- {line}" for line in origin(results["made"])),
        unit=unit,
        runs=results["runs"],
        features=features(us),
        compiler=counts["compiler"].partition(" (")[0],
        instructions=instructions(results, counts),
        bands=digits(us["multi-band, 2 threads"]),
        row=digits(decision["microseconds per row pushed"]["ours, warm"], 2),
        band_row=digits(decision["microseconds per row pushed"]["ours, bands, warm"], 2),
        decision=table(
            ("", "µs"), ((k, digits(decision["microseconds"][name])) for k, name in DECISIONS.items())
        ),
        ecoc=classifier(results["ecoc"]),
        memory=digits(results["ecoc"]["walk"]["megabytes"], 2),
        accuracy_made="; ".join(origin(accuracy["made"])),
        draws=accuracy["seeds"],
        accuracies=accuracies(accuracy["folders"]),
    )


def speed(results: Json) -> str:
    """For README.md."""
    (unit, us), decided = widest(results), results["decision"]["microseconds"]
    ours, loop, copy = (
        us[name] for name in ("granular_id, 1 thread", "scipy + numpy, loop", "transposing copy (floor)")
    )
    theirs, cold = decided["scipy + numpy, scores by hand"], decided["ours, cold"]
    rows = (
        ("features of a push, 1600 x 6", f"**{digits(ours)}**", digits(loop), f"{loop / ours:.0f}"),
        ("from the last sample to the label", f"**{digits(cold)}**", digits(theirs), f"{theirs / cold:.0f}"),
    )
    made, copied = results["made"]["processor"].partition(" (")[0], digits(copy)
    return f"""The same bits as `scipy.signal.sosfilt` and `numpy.histogram`, in batches and streams. One thread of an
{made}, {unit}, where numpy transposes the samples in {copied} µs; [all benchmarks](docs/benchmarks.md).

{table(("microseconds", "granular_id", "scipy + numpy", "times"), rows)}"""


def readme(text: str, results: Json) -> str:
    start, end = "## Speed\n\n", "\n\n## Limits\n"
    before, rest = text.split(start)
    return f"{before}{start}{speed(results)}{end}{rest.split(end)[1]}"


def on_the_index(text: str) -> str:
    """The same text with links that lead somewhere on the page of a package index."""
    text = re.sub(r"!\[([^]]*)\]\((?!https)", rf"![\1]({SITE}/raw/main/", text)
    return re.sub(r"(?<!!)\[([^]]*)\]\((?!https)", rf"[\1]({SITE}/blob/main/", text)


def written() -> dict[Path, str]:
    """Return the files and what they hold by the stored figures."""
    results, accuracy, counts = (
        json.loads((BENCHES / f"{name}.json").read_text("utf-8"))
        for name in ("results", "accuracy", "counts")
    )
    top = readme((ROOT / "README.md").read_text(encoding="utf-8"), results)
    return {
        ROOT / "docs/benchmarks.md": page(results, accuracy, counts["bench"]),
        ROOT / "README.md": top,
        ROOT / "python/README.md": on_the_index(top),
    }


if __name__ == "__main__":
    for path, text in written().items():
        if "--check" not in sys.argv:
            path.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            sys.exit(
                f"{path.relative_to(ROOT)} is not what benches/page.py makes of the stored figures: run it"
            )
