"""The pictures of README.md and the guide, all of SYNTHETIC recordings: python docs/pictures.py [name ...].

They are drawn with the package of the moment and committed; those of the gallery are drawn whenever the site is built.
The page of a live session wants Chromium.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import FancyBboxPatch
from playwright.sync_api import sync_playwright

import granular_id as gid
from granular_id.evaluation import confidence_study
from granular_id.plotting import plot_accuracy, plot_confidence, plot_over_time
from granular_id.recording import Payload

IMAGES = Path(__file__).parent / "images"
BLUE, ORANGE, GREEN, INK, FAINT = "#0072B2", "#D55E00", "#009E73", "#333333", "#BBBBBB"
plt.rcParams.update(
    {"axes.spines.top": False, "axes.spines.right": False, "savefig.dpi": 180}
)
plt.rcParams.update(
    {
        "axes.edgecolor": FAINT,
        "text.color": INK,
        "axes.labelcolor": INK,
        "font.size": 10,
    }
)


def method():
    """A push, what of it lies above 23 Hz, the histogram of that, and the answer."""
    materials = ["macaroni", "fine sugar"]
    data = gid.synthesize(
        [*materials, "rice", "cat litter"], n_per_class=12, sessions=3, seed=1
    )
    model = gid.Identifier.fit(data, "raw+hfmh", estimate=False)
    pushes = gid.synthesize(materials, n_per_class=1, seed=3)
    figure, rows = plt.subplots(
        2,
        4,
        figsize=(7, 3.2),
        width_ratios=(4, 4, 4, 3),
        sharex="col",
        layout="constrained",
    )
    for row, push, colour in zip(rows, pushes, (ORANGE, BLUE), strict=True):
        force, times_s = push.wrench[:, 0], push.times()
        sos = gid.signal.butter(8, 23, "highpass", fs=push.rate_hz)
        high = gid.signal.sosfilt(sos, force)
        counts, edges = gid.signal.histogram(high, bins=100, range=(-1.5, 1.5))
        row[0].plot(times_s, force, color=colour, linewidth=0.8)
        row[1].plot(times_s, high, color=colour, linewidth=0.5)
        row[1].set_ylim(-1.6, 1.6)
        row[2].stairs(counts, edges, color=colour, fill=True)
        row[2].set(yscale="log", ylim=(0.6, 1000), yticks=(1, 10, 100))
        row[3].axis("off")
        label = model.identify(push).label
        row[3].text(
            0,
            0.5,
            label.replace(" ", "\n"),
            size=14,
            weight="bold",
            color=colour,
            va="center",
        )
        for panel in row[:3]:
            panel.tick_params(labelsize=9, colors=INK)
    titles = ("push: $F_x$, N", "→ above 23 Hz", "→ histogram", "→ label")
    for panel, title in zip(rows[0], titles, strict=True):
        panel.set_title(title, fontsize=12, loc="left")
    for panel, what in zip(rows[1], ("time, s", "time, s", "N", ""), strict=True):
        panel.set_xlabel(what)
    return figure


def onset():
    """Three pushes with the onsets found, and noise, which has none."""
    pushes = gid.synthesize(["dry peas", "rice", "wheat flour"], n_per_class=1, seed=2)
    noise = np.random.default_rng(0).normal(scale=0.05, size=(1600, 6))
    still = gid.Recording(noise, rate_hz=500, label="rice", name="no push")
    found = gid.Dataset([*pushes, still]).find_onsets(replace=True)
    figure, panels = plt.subplots(
        4, 1, figsize=(7, 4.6), sharex=True, layout="constrained"
    )
    for panel, push in zip(panels, found, strict=True):
        panel.plot(
            push.times(),
            push.wrench[:, 0] - push.wrench[:50, 0].mean(),
            color=BLUE,
            linewidth=0.8,
        )
        at = push.trigger_index
        name = push.label if push.name != "no push" else "noise of the sensor"
        panel.set_title(
            f"{name}: " + ("no onset" if at is None else f"{at / 500:.3f} s"),
            loc="left",
            fontsize=10,
        )
        if at is not None:
            panel.axvline(at / 500, color=ORANGE)
    figure.supylabel("$F_x$ less its rest, N", fontsize=10)
    panels[-1].set_xlabel("time, s (vertical lines: onsets found)")
    return figure


def gap():
    """Accuracy in new sessions, and what random draws promise."""
    materials = [
        "rice",
        "fine sugar",
        "cat litter",
        "dry peas",
        "oat flakes",
        "breadcrumbs",
    ]
    data = gid.synthesize(materials, n_per_class=16, sessions=4, seed=1)
    return plot_accuracy(
        gid.evaluate(data, ["multiband", "raw+hfmh", "hfmh"], progress=False)
    )


def confidence():
    """Probabilities, candidates and novelty scores, as `granular-id confidence --figure` draws them."""
    data = gid.synthesize(
        list(gid.synthetic.PAPER_MATERIALS)[:8], n_per_class=24, sessions=6, seed=0
    )
    return plot_confidence(confidence_study(data, "multiband"))


def accuracy_over_time():
    """Share of provisional answers that are right, and of early ones."""
    data = gid.synthesize(n_per_class=30, sessions=6, seed=1)
    return plot_over_time(
        gid.Identifier.fit(data, "best", target_error=0.05).over_time_
    )


def setups():
    """A push in the set-up of the training, in another, and brought from there into the first."""
    push = gid.synthesize(["macaroni"], n_per_class=1, seed=1)
    trained = push.transform(frame="flange").tare(lead_s=0.1)
    turned = push.transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], frame="wrist")
    gripper = Payload(0.306, (0, 0, 0.05), bias=(5, 2, 3, 0, 0, 0), frame="wrist")
    load = gripper.wrench([0, 0, 1])
    other = gid.Dataset([replace(one, wrench=one.wrench + load) for one in turned])
    brought = (
        other.compensate(gripper, gravity=(0, 0, 1))
        .transform([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], frame="flange")
        .tare(lead_s=0.1)
    )
    titles = ("of the training", "another set-up", "brought over")
    figure, panels = plt.subplots(
        1, 3, figsize=(7, 2.4), sharey=True, layout="constrained"
    )
    for panel, title, data in zip(
        panels, titles, (trained, other, brought), strict=True
    ):
        for axis, colour in enumerate((ORANGE, BLUE, GREEN)):
            force = data[0].wrench[:, axis]
            name = f"$F_{'xyz'[axis]}$"
            panel.plot(data[0].times(), force, color=colour, linewidth=0.8, label=name)
        panel.set_title(title, loc="left", fontsize=11)
        panel.set_xlabel("time, s")
    panels[0].set_ylabel("N")
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside right center",
        frameon=False,
    )
    return figure


def archives():
    """What stands where: recordings of many robots in one folder, cut into partitions, each of which makes a file."""
    figure, panel = plt.subplots(figsize=(7, 2.6), layout="constrained")
    panel.set(xlim=(0, 100), ylim=(0, 40))
    panel.axis("off")

    def box(x, y, width, height, text, colour):
        style = {"boxstyle": "round,pad=0.4", "facecolor": "white", "edgecolor": colour}
        panel.add_patch(FancyBboxPatch((x, y), width, height, **style))
        panel.text(
            x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=7.5
        )

    def arrow(start, end):
        panel.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": INK})

    for y, robot in zip((29, 17, 5), ("robot 1", "robot 2", "robot 300"), strict=True):
        box(1, y, 10, 5, robot, ORANGE)
        arrow((13, y + 2.5), (27, 19.5))
    panel.text(20, 36, "archive add", ha="center", family="monospace", fontsize=8)
    box(29, 3, 18, 33, "fleet/\n\nrecordings-*.parquet\nsamples/*.parquet", BLUE)
    panel.text(
        53.5, 35, "extract,\nidentify", ha="center", family="monospace", fontsize=8
    )
    for y in (29, 17, 5):
        arrow((49, 19.5), (57, y + 2.5))
        box(59, y, 17, 5, "\u2264 1024 recordings", FAINT)
        arrow((78, y + 2.5), (84, y + 2.5))
        box(86, y, 12, 5, "one file", GREEN)
    panel.text(67.5, 0, "partitions, on threads or Dask", ha="center", fontsize=8.5)
    panel.text(92, 0, "features/", ha="center", fontsize=8.5)
    return figure


def answers():
    """That of the tutorial: its commands, until it is there."""
    tutorial = (IMAGES.parent / "tutorial.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder, "answers.png")
        for block in re.findall(
            r"^```sh\n(.*?)^```", tutorial, re.MULTILINE | re.DOTALL
        ):
            subprocess.run(["bash", "-ec", block], cwd=folder, check=True)
            if drawn.exists():
                break
        shutil.copy(drawn, IMAGES)


def monitor():
    """The page of a live session after six pushes, through materials that the model knows and one that it does not."""
    materials = ["rice", "fine sugar", "cat litter", "oat flakes", "potting gravel"]
    source = "sim:rice,fine_sugar,macaroni,cat_litter?seed=5"
    words = f"live --source {source} --view --no-browser --pre-s 0.25 --n 20".split()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        model = Path(folder, "model.safetensors")
        data = gid.synthesize(materials, n_per_class=30, sessions=6, seed=1)
        gid.Identifier.fit(data, "multiband", target_error=None).save(model)
        command = [sys.executable, "-m", "granular_id", *words, "--model", str(model)]
        live = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        address = next(
            filter(None, (re.search(r"http://\S+", line) for line in live.stdout))
        )[0]
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 700})
        page.goto(address)
        page.get_by_text("of 6 right").wait_for(timeout=60_000)
        page.screenshot(path=IMAGES / "monitor.png")
        live.kill()


PICTURES = (
    *(method, onset, gap, confidence, accuracy_over_time),
    *(setups, archives, answers, monitor),
)

if __name__ == "__main__":
    for picture in PICTURES:
        if picture.__name__ not in (
            sys.argv[1:] or [each.__name__ for each in PICTURES]
        ):
            continue
        if figure := picture():
            figure.savefig(
                IMAGES / f"{picture.__name__}.png", metadata={"Software": None}
            )
