"""Figures of recordings: what they show, how they are saved, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granular_id.plotting import plot_mean_forces, plot_onsets, plot_recordings
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize
from onset_cases import RATE_HZ, noise, push


@pytest.fixture(scope="module")
def synthetic():
    materials = ["rice", "fine sugar", "wheat flour", "macaroni", "oat flakes"]
    return synthesize(materials, n_per_class=3, duration_s=0.5)


def _real(n_samples=40):
    wrench = np.zeros((n_samples, 6)) + np.arange(1.0, 7.0)
    return Recording(wrench, rate_hz=500.0, label="sand", name="real")


def _drives(units=("rad/s", "rad/s", "m/s2", "m/s2"), axes=("wx", "wy", "ax", "$a_y"), differing=2):
    """Two grounds that differ in one axis."""
    rng = np.random.default_rng(0)
    meta = {"units": {axis: unit for axis, unit in zip(axes, units, strict=True) if unit}}
    drives = []
    for k in range(8):
        signal = rng.normal(size=(60, len(axes)))
        signal[:, differing] += 10 * (k % 2)
        label = ("grass", "sand")[k % 2]
        drives.append(Recording(signal, 50.0, label, name=f"drive {k}", axes=axes, meta=meta))
    return Dataset(drives)


def _legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_lines_are_means_and_bands_one_deviation(synthetic):
    figure = plot_mean_forces(synthetic, axes=("fy",))
    assert [panel.get_title() for panel in figure.axes] == list(dict.fromkeys(synthetic.y.tolist()))
    assert len({(panel.get_xlim(), panel.get_ylim()) for panel in figure.axes}) == 1
    panel = figure.axes[1]
    fy = synthetic.X[synthetic.y == "fine sugar"][:, :, 1]
    mean_line = next(line for line in panel.lines if len(line.get_xdata()) == 250)
    np.testing.assert_allclose(mean_line.get_xdata(), np.arange(250) / 500)
    np.testing.assert_allclose(mean_line.get_ydata(), fy.mean(axis=0))
    band = panel.collections[0].get_paths()[0].vertices
    for sign in (-1, 1):
        edge = np.column_stack([np.arange(250) / 500, fy.mean(axis=0) + sign * fy.std(axis=0)])
        distance = np.abs(band[:, None] - edge[None, ::25]).sum(axis=2).min(axis=0)
        assert distance.max() < 1e-9


def test_titles_name_synthetic_recordings(synthetic):
    for plot in (plot_recordings, plot_mean_forces):
        assert plot(synthetic).get_suptitle().startswith("Synthetic recordings")
    assert "of 15 SYNTHETIC recordings" in plot_onsets(synthetic, n=1).get_suptitle()
    mixed = plot_mean_forces(Dataset([*synthetic, _real(250)]))
    assert mixed.get_suptitle().startswith("15 of 16 recordings synthetic")
    assert "ynthetic" not in plot_mean_forces(Dataset([_real()])).get_suptitle()


@pytest.mark.parametrize(
    ("options", "axes", "label"),
    [
        ({}, ["ax", r"\$a_y"], "signal, m/s2"),
        ({"units": ("",) * 4}, ["wx", "ax"], "signal"),
        ({"units": ("rad/s", "rad/s", "m/s2", "g")}, ["ax"], "ax, m/s2"),
        ({"axes": ("fx", "fy", "fz", "wz"), "units": ("N", "N", "N", "")}, ["$F_x$", "$F_z$"], "force, N"),
        ({"axes": ("tx", "ty", "tz", "s")}, ["$T_z$", "s"], "signal, m/s2"),
    ],
)
def test_means_are_of_the_unit_that_differs_most(options, axes, label):
    figure = plot_mean_forces(_drives(**options))
    assert (_legend(figure), figure.get_supylabel()) == (axes, label)


def test_recordings_are_drawn_in_the_unit_of_the_first_axis():
    figure = plot_recordings(_drives())
    assert (figure.get_supylabel(), _legend(figure)) == ("signal, rad/s", ["wx", "wy"])
    many = _drives(axes=tuple(f"s{k}" for k in range(9)), units=("",) * 9)
    assert len(_legend(plot_recordings(many))) == 6
    assert plot_recordings(many, axes=["s8"]).get_supylabel() == "s8"
    assert plot_onsets(_drives()).get_supylabel() == "relative to rest, rad/s"


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (("fx", "qx"), "axes must name some of fx, fy, fz, tx, ty, tz, each once, got fx, qx"),
        ((), "got nothing"),
        (("fx", "ty"), "mixes units .N, N m., got fx, ty"),
    ],
)
def test_axes_that_cannot_be_drawn_are_refused(synthetic, axes, message):
    with pytest.raises(ValueError, match=message):
        plot_mean_forces(synthetic, axes=axes)


def test_onsets_found_stated_recorded_and_missing_are_named():
    pushes = [Recording(push(k, 60 + 10 * k), rate_hz=RATE_HZ, name=f"push $_{k}") for k in range(7)]
    data = Dataset([*pushes, Recording(noise(7, 900), rate_hz=RATE_HZ, name="still")])
    with pytest.raises(ValueError, match=r"^n must be"):
        plot_onsets(data, n=0)
    assert len(plot_onsets(data, n=100).axes) == 2 * len(data)
    data = Dataset([replace(data[0], trigger_index=300), *data[1:]])
    data = data.find_onsets(overrule={"push $_5": 0.25, "push $_6": None})
    panels = np.reshape(plot_onsets(data, n=6).axes, (6, 2))
    titles = [left.get_title(loc="left") or left.get_title(loc="right") for left, _ in panels]
    assert "push $_6, no onset:\nnone, as stated" in titles
    assert "still, no onset:\nno change stands out from the noise of the first 0.1 s" in titles
    times = dict(zip(titles, (right.get_title(loc="right") for _, right in panels), strict=True))
    assert (times["push $_5"], times["push $_0"]) == ("0.250 s", "0.600 s")


@pytest.mark.parametrize(
    ("ending", "start"), [("png", b"\x89PNG\r\n\x1a\n"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_figures_are_saved_as_their_ending_says(tmp_path, ending, start):
    path = tmp_path / f"figure.{ending}"
    plot_recordings(Dataset([_real()]), axes=["fx"], path=path)
    assert path.read_bytes().startswith(start)


def test_figure_that_cannot_be_saved_leaves_the_old_file(tmp_path, monkeypatch):
    def fail(self, stream, **options):
        raise OSError("disk full")

    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        plot_recordings(Dataset([_real()]), path=path)
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b"old"]
    with pytest.raises(ValueError, match=r"path must end in .*png.*, got .*figure.xyz"):
        plot_recordings(Dataset([_real()]), path=tmp_path / "figure.xyz")
