"""Figures of recordings, onsets and confusions: what they show, how they are saved, what is refused."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from granular_id.plotting import plot_confusion, plot_mean_forces, plot_onsets, plot_recordings
from granular_id.plotting.style import evenly, number_text
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize
from onset_cases import RATE_HZ, noise, push


@pytest.fixture(scope="module")
def synthetic():
    materials = ["rice", "fine sugar", "wheat flour", "macaroni", "oat flakes"]
    return synthesize(materials, n_per_class=3, duration_s=0.5)


def _real(n_samples=40, label="sand"):
    wrench = np.zeros((n_samples, 6)) + np.arange(1.0, 7.0)
    return Recording(wrench, rate_hz=100.0, label=label, name=label)


def _bands(panel):
    return [collection.get_paths()[0].vertices for collection in panel.collections]


# -- mean forces


def test_lines_are_means_and_bands_one_deviation(synthetic):
    figure = plot_mean_forces(synthetic, axes=("fy",))
    assert [panel.get_title() for panel in figure.axes] == list(dict.fromkeys(synthetic.y.tolist()))
    assert len({(panel.get_xlim(), panel.get_ylim()) for panel in figure.axes}) == 1
    panel = figure.axes[1]
    fy = synthetic.X[synthetic.y == "fine sugar"][:, :, 1]
    mean_line = next(line for line in panel.lines if len(line.get_xdata()) == 250)
    np.testing.assert_allclose(mean_line.get_xdata(), np.arange(250) / 500)
    np.testing.assert_allclose(mean_line.get_ydata(), fy.mean(axis=0))
    (band,) = _bands(panel)
    for sign in (-1, 1):
        edge = np.column_stack([np.arange(250) / 500, fy.mean(axis=0) + sign * fy.std(axis=0)])
        distance = np.abs(band[:, None] - edge[None, ::25]).sum(axis=2).min(axis=0)
        assert distance.max() < 1e-9


def test_titles_name_synthetic_recordings_and_the_quantity(synthetic):
    real = Recording(_real(250).wrench, rate_hz=500.0, label="sand", name="real")
    assert "ynthetic" not in plot_mean_forces(Dataset([real])).get_suptitle()
    mixed = plot_mean_forces(Dataset([*synthetic, real]))
    assert mixed.get_suptitle().startswith("15 of 16 recordings synthetic")
    figure = plot_mean_forces(synthetic, axes=("tx", "ty", "tz"))
    assert figure.get_supylabel() == "torque, N m"
    assert figure.get_suptitle().startswith("Synthetic recordings: torque per material")
    assert len(_bands(figure.axes[0])) == 3


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (("fx", "qx"), "axes must name some of fx, fy, fz, tx, ty, tz, each once, got fx, qx"),
        ((), "got nothing"),
        (("fx", "fx"), "each once, got fx, fx"),
        (("fx", "ty"), "mixes units .N, N m., got fx, ty"),
    ],
)
def test_axes_are_checked(synthetic, axes, message):
    with pytest.raises(ValueError, match=message):
        plot_mean_forces(synthetic, axes=axes)


# -- other axes


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


@pytest.mark.parametrize(
    ("options", "axes", "label", "title"),
    [
        ({}, ["ax", r"\$a_y"], "signal, m/s2", "Signal per material"),
        ({"units": ("",) * 4}, ["wx", "ax"], "signal", "Signal per material"),
        ({"units": ("rad/s", "rad/s", "m/s2", "g")}, ["ax"], "ax, m/s2", "ax per material"),
        (
            {"axes": ("fx", "fy", "fz", "wz"), "units": ("N", "N", "N", "")},
            ["$F_x$", "$F_z$"],
            "force, N",
            "Force",
        ),
        ({"axes": ("tx", "ty", "tz", "s")}, ["$T_z$", "s"], "signal, m/s2", "Signal"),
    ],
)
def test_means_are_of_the_unit_in_which_materials_differ_most(options, axes, label, title):
    figure = plot_mean_forces(_drives(**options))
    assert (_legend(figure), figure.get_supylabel()) == (axes, label)
    assert figure.get_suptitle().startswith(title)


def test_recordings_are_drawn_in_the_unit_of_the_first_axis():
    assert plot_recordings(_drives()).get_supylabel() == "signal, rad/s"
    assert _legend(plot_recordings(_drives())) == ["wx", "wy"]
    many = _drives(axes=tuple(f"s{k}" for k in range(9)), units=("",) * 9)
    assert (plot_recordings(many).get_supylabel(), len(_legend(plot_recordings(many)))) == ("signal", 6)
    assert plot_recordings(many, axes=["s8"]).get_supylabel() == "s8"
    assert plot_recordings(many, axes=many.axes).get_supylabel() == "signal"
    mixed = _drives(units=("", "", "m/s2", ""))
    with pytest.raises(ValueError, match=r"mixes units \(not known, m/s2\), got wx, ax"):
        plot_recordings(mixed, axes=["wx", "ax"])
    assert plot_onsets(_drives(), rest_s=0.2).get_supylabel() == "relative to rest, rad/s"
    assert plot_onsets(_drives(("",) * 4), rest_s=0.2).get_supylabel() == "relative to rest"


def test_unequal_lengths_are_refused_with_a_remedy():
    with pytest.raises(ValueError, match=r"\.align"):
        plot_mean_forces(Dataset([_real(40), _real(50)]))


# -- onsets


@pytest.fixture
def data():
    pushes = [Recording(push(k, 60 + 10 * k), rate_hz=RATE_HZ, name=f"push $_{k}") for k in range(7)]
    still = Recording(noise(7, 900), rate_hz=RATE_HZ, name="still")
    return Dataset([*pushes, still])


def _titles(figure):
    """Names stand on the right, and with a reason on the left where there is no onset."""
    panels = figure.axes[::2]
    return [panel.get_title(loc="left") or panel.get_title(loc="right") for panel in panels]


def test_what_was_found_stated_recorded_and_missing(data, tmp_path):
    data = Dataset([replace(data[0], trigger_index=300), *data[1:]])
    data = data.find_onsets(overrule={"push $_5": 0.25, "push $_6": None})
    figure = plot_onsets(data, tmp_path / "onsets.png", n=6)
    assert (tmp_path / "onsets.png").stat().st_size > 10_000
    titles = _titles(figure)
    assert len(titles) == 6
    assert "push $_6, no onset:\nnone, as stated" in titles
    assert "still, no onset:\nno change stands out from the noise of the first 0.1 s" in titles
    times = dict(zip(titles, (p.get_title(loc="right") for p in figure.axes[1::2]), strict=True))
    assert times["push $_5"] == "0.250 s"
    assert times["push $_0"] == "0.600 s"
    dashes = {
        title: {line.get_linestyle() for line in panel.lines if len(line.get_xdata()) == 2}
        for title, panel in zip(titles, figure.axes[::2], strict=True)
    }
    assert dashes["push $_5"] == {"--"}
    assert dashes["push $_0"] == {"-."}
    assert dashes[titles[1]] == {"-"}
    assert dashes["push $_6, no onset:\nnone, as stated"] == set()


def test_onsets_that_were_not_looked_for_are_found_first(data):
    with pytest.raises(ValueError, match=r"^n must be"):
        plot_onsets(data, n=0)
    figure = plot_onsets(data, n=100, false_alarm_rate=0.01)
    assert len(figure.axes) == 2 * len(data)
    assert figure.get_suptitle() == "Onsets of 8 of 8 recordings: rest 0.1 s, false-alarm rate 0.01"
    found = data.find_onsets(false_alarm_rate=0.01)
    (line,) = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 2]
    assert line.get_xdata()[0] == found[0].trigger_index / RATE_HZ


# -- confusion


def test_confusion_is_per_cent_of_each_true_class():
    panel = plot_confusion([[199, 1, 0], [0, 0, 0], [1, 2, 1]], ["a", "b", "c"], title="Title").axes[0]
    shown = {text.get_position(): text.get_text() for text in panel.texts}
    # a class nobody tested keeps an empty row; rounding hides neither the last error nor the only hit
    assert shown == {(0, 0): ">99", (1, 0): "<1", (0, 2): "25", (1, 2): "50", (2, 2): "25"}
    assert panel.get_title() == "Title\nper cent of each true class"
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("predicted", "true")
    assert [tick.get_text() for tick in panel.get_yticklabels()] == ["a", "b", "c"]


def luminance(colour):
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in colour]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


@pytest.mark.parametrize(("ground", "ink"), [("#ffffff", "#333333"), ("#14181d", "#e6eaee")])
def test_numbers_stand_out_from_their_cells(ground, ink):
    from matplotlib.colors import to_rgb

    values = np.arange(2, 100, 3)
    matrix = np.diag(values) + np.roll(np.diag(100 - values), 1, axis=1)
    panel = plot_confusion(matrix, [str(value) for value in values]).axes[0]
    assert len(panel.patches) == len(panel.texts) == 2 * len(values)
    ratios = []
    for cell, text in zip(panel.patches, panel.texts, strict=True):
        alpha = cell.get_alpha()
        behind = alpha * np.array(to_rgb(cell.get_facecolor())) + (1 - alpha) * np.array(to_rgb(ground))
        front = to_rgb(ink if text.get_color() == "#333333" else text.get_color())
        light, dark = sorted((luminance(behind), luminance(front)), reverse=True)
        ratios.append((light + 0.05) / (dark + 0.05))
    assert min(ratios) > 3.5


@pytest.mark.parametrize(
    ("matrix", "labels", "message"),
    [
        ([[1, 2]], ["a"], r"matrix must be square, got shape \(1, 2\)"),
        ([[1]], ["a", "b"], "labels must name the 1 classes of matrix, got 2"),
        ([[-1]], ["a"], "not negative"),
        ([[np.nan]], ["a"], "finite"),
    ],
)
def test_confusion_is_checked(matrix, labels, message):
    with pytest.raises(ValueError, match=message):
        plot_confusion(matrix, labels)


# -- files and imports


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_figures_are_saved_whole(tmp_path, monkeypatch, ending):
    from matplotlib.figure import Figure

    def fail(self, stream, **options):
        raise OSError("disk full")

    path = tmp_path / f"figure.{ending}"
    path.write_bytes(b"old")
    plot_confusion([[1]], ["a"], path=path)
    whole = path.read_bytes()
    assert whole.startswith({"png": b"\x89PNG\r\n\x1a\n", "svg": b"<?xml", "pdf": b"%PDF"}[ending])
    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        plot_confusion([[1]], ["a"], path=path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == whole


def test_unknown_endings_and_missing_folders_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"path must end in .*png.*, got .*figure.xyz"):
        plot_confusion([[1]], ["a"], path=tmp_path / "figure.xyz")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        plot_confusion([[1]], ["a"], path=tmp_path / "missing" / "figure.png")


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"pip install 'typer"):
        plot_confusion([[1]], ["a"])


def test_plotting_is_imported_late_and_leaves_pyplot_alone():
    code = (
        "import sys, granular_id.evaluation\n"
        "assert not [name for name in sys.modules if name.startswith('granular_id.plotting')]\n"
        "import granular_id.plotting as p\n"
        "assert not any(m.startswith('matplotlib') for m in sys.modules)\n"
        "p.plot_confusion([[1]], ['a']).savefig('/dev/null', format='png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_places_and_numbers_are_rounded():
    assert [evenly(9, 3).tolist(), evenly(2, 5).tolist(), evenly(0, 5).tolist()] == [[0, 4, 8], [0, 1], []]
    assert [number_text(-0.04, 1), number_text(-1.25, 2)] == ["0.0", "\N{MINUS SIGN}1.25"]
