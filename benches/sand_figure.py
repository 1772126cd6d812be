"""Draw docs/images/sand.png: the examples of docs/guide/sand.md are run, and what they find is drawn.

Wants the folder that holds ``sand_press`` (docs/guide/sand.md says where the recordings come from). Example:

  python benches/sand_figure.py FOLDER -o docs/images/sand.png
"""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

PAGE = Path(__file__).parents[1] / "docs" / "guide" / "sand.md"
COLOURS = ("#0072B2", "#56B4E9", "#009E73", "#D55E00")
INK = "#333333"


def run_page(folder: Path) -> dict[str, Any]:
    """Run the examples of the page in a folder, and return what they have named."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    found: dict[str, Any] = {}
    here = Path.cwd()
    os.chdir(folder)
    try:
        exec(compile("\n".join(blocks), str(PAGE), "exec"), found)
    finally:
        os.chdir(here)
    return found


def draw(found: dict[str, Any], output: Path) -> None:
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    at_rest, in_time, in_depth = figure.subplots(1, 3)
    real = found["rests"][0].wrench[:200, 0]
    at_rest.plot(np.arange(200) / 100, real - real.mean(), color=INK, lw=1.2, label="rest_00")
    at_rest.set(xlabel="time (s)", ylabel="fx less its mean (N)")
    at_rest.set_title("at rest: 12 readings a second, repeated", fontsize=9, loc="left", color=INK)
    for run, load, colour in zip(found["tared"], found["loads"], COLOURS, strict=True):
        name = run.name.removesuffix(".bag")
        in_time.plot(run.times(), load, color=colour, lw=1.2, label=name)
        onset = run.trigger_index
        in_time.plot(run.times()[onset], load[onset], "o", mfc="none", color=colour, ms=7)
    in_time.set(xlabel="time (s)", ylabel="vertical load (N)")
    in_time.set_title("tared; circles: onsets", fontsize=9, loc="left", color=INK)
    for (depth, force, power, factor), run, colour in zip(
        found["curves"], found["tared"], COLOURS, strict=True
    ):
        in_depth.loglog(depth, force, ".", ms=3, color=colour, alpha=0.6)
        line = np.array([3.0, 35.0])
        name = f"{run.name.removesuffix('.bag')}: {power:.2f}"
        in_depth.loglog(line, factor * line**power, color=colour, lw=1.2, label=name)
    in_depth.set(xlabel="depth below the onset (mm)", ylabel="vertical load (N)")
    ticks = (3, 5, 10, 20, 35)
    in_depth.set_xticks(ticks, [str(tick) for tick in ticks], minor=False)
    in_depth.set_xticks([], minor=True)
    in_depth.set_title("force against depth, and its power", fontsize=9, loc="left", color=INK)
    for panel in (at_rest, in_time, in_depth):
        panel.spines[["top", "right"]].set_visible(False)
        panel.legend(frameon=False, fontsize=8)
    figure.savefig(output, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="the folder that holds sand_press")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    draw(run_page(arguments.folder), arguments.output)


if __name__ == "__main__":
    main()
