"""Draw what `accuracy.py --out` wrote: a panel of bars for each data set, best first.

Several sets of one folder are averaged, as in the table. Example:

  python benches/accuracy_figure.py target/accuracy.json -o docs/accuracy.png
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from matplotlib.figure import Figure

TITLES = {
    "sliding_wrench": "fingertip sliding over 20 materials,\nhalves of the sessions held out",
    "robot_failures": "robot failures, mean of 5 small sets,\n5 random folds, 4 draws",
}
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
    "raw+hfmh": "raw+hfmh (paper)",
}
OURS = ("best", "multiband", "raw+hfmh")
INK, OUR_COLOUR, PEER_COLOUR = "#333333", "#0072B2", "#C8C8C8"


def means(paths: list[Path]) -> dict[str, dict[str, float]]:
    """Mean accuracy in percent of each method on each folder of recordings."""
    found: dict[str, dict[str, float]] = {}
    for path in paths:
        comparisons = json.loads(path.read_text(encoding="utf-8"))["comparisons"]
        for name in TITLES:
            sets = [key for key in comparisons if key.startswith(name) and "mean of" in key] or [
                key for key in comparisons if key == name
            ]
            for key in sets:
                found[name] = {row["method"]: 100 * row["mean"] for row in comparisons[key]}
    return found


def draw(found: dict[str, dict[str, float]], output: Path) -> None:
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    panels = figure.subplots(1, len(found), squeeze=False)[0]
    for panel, (name, accuracies) in zip(panels, found.items(), strict=True):
        shown = sorted((method for method in NAMES if method in accuracies), key=accuracies.__getitem__)
        values = [accuracies[method] for method in shown]
        colours = [OUR_COLOUR if method in OURS else PEER_COLOUR for method in shown]
        bars = panel.barh([NAMES[method] for method in shown], values, color=colours, height=0.72)
        panel.bar_label(bars, [f"{value:.1f}" for value in values], padding=3, fontsize=8, color=INK)
        panel.set(xlim=(0, 108), xticks=[])
        panel.set_title(TITLES[name], fontsize=9, color=INK, loc="left")
        panel.spines[["top", "right", "bottom"]].set_visible(False)
        panel.tick_params(axis="y", length=0, labelsize=8, labelcolor=INK)
    figure.supxlabel("accuracy in %; blue: this package", fontsize=8, color=INK)
    figure.savefig(output, dpi=140)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULT")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    draw(means(options.results), options.output)


if __name__ == "__main__":
    main()
