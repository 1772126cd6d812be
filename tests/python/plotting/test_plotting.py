"""Figures: what they show, how they are saved, what is refused."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from granular_id.plotting import plot_confusion, plot_mean_forces
from granular_id.recording import Dataset, Recording
from granular_id.synthetic import synthesize

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def synthetic():
    return synthesize(
        ["rice", "fine sugar", "wheat flour", "macaroni", "oat flakes"], n_per_class=3, duration_s=0.5
    )


def _real(n_samples=40, label="sand", value=1.0):
    wrench = np.zeros((n_samples, 6)) + value * np.arange(1, 7)
    return Recording(wrench, rate_hz=100.0, label=label, name=f"{label} {value}")


def _bands(panel):
    return [collection.get_paths()[0].vertices for collection in panel.collections]


def test_one_panel_a_material_in_the_order_of_the_data(synthetic):
    figure = plot_mean_forces(synthetic)
    assert [panel.get_title() for panel in figure.axes] == [
        "rice",
        "fine sugar",
        "wheat flour",
        "macaroni",
        "oat flakes",
    ]
    assert len({panel.get_ylim() for panel in figure.axes}) == 1
    assert len({panel.get_xlim() for panel in figure.axes}) == 1
    assert figure.get_supxlabel() == "time, s"
    assert figure.get_supylabel() == "force, N"
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["$F_x$", "$F_z$"]


def test_lines_are_means_and_bands_one_standard_deviation(synthetic):
    figure = plot_mean_forces(synthetic, axes=("fy",))
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


def test_the_title_says_synthetic_only_of_synthetic_recordings(synthetic):
    real = _real(250)
    real = Recording(real.wrench, rate_hz=500.0, label="sand", name="real")
    assert plot_mean_forces(synthetic).get_suptitle().startswith("Synthetic recordings: force")
    assert "ynthetic" not in plot_mean_forces(Dataset([real])).get_suptitle()
    mixed = Dataset([*synthetic, real])
    assert plot_mean_forces(mixed).get_suptitle().startswith("15 of 16 recordings synthetic")


def test_torques_are_in_newton_metre(synthetic):
    figure = plot_mean_forces(synthetic, axes=("tx", "ty", "tz"))
    assert figure.get_supylabel() == "torque, N m"
    assert "torque per material" in figure.get_suptitle()
    assert len(_bands(figure.axes[0])) == 3


@pytest.mark.parametrize("n_materials", [1, 2, 4, 9])
def test_any_number_of_materials(n_materials):
    data = Dataset([_real(label=f"m{i}") for i in range(n_materials)])
    figure = plot_mean_forces(data)
    assert len(figure.axes) == n_materials
    lowest = figure.axes[-1]
    figure.draw_without_rendering()
    assert any(label.get_visible() and label.get_text() for label in lowest.get_xticklabels())


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


def test_unequal_lengths_are_refused_with_the_way_out():
    with pytest.raises(ValueError, match=r"\.align"):
        plot_mean_forces(Dataset([_real(40), _real(50)]))


def test_confusion_is_per_cent_of_each_true_class():
    figure = plot_confusion([[199, 1, 0], [0, 0, 0], [1, 2, 1]], ["a", "b", "c"], title="Title")
    panel = figure.axes[0]
    shown = {text.get_position(): text.get_text() for text in panel.texts}
    # a class nobody tested keeps an empty row; rounding hides neither the last error nor the only hit
    assert shown == {(0, 0): ">99", (1, 0): "<1", (0, 2): "25", (1, 2): "50", (2, 2): "25"}
    assert panel.get_title() == "Title\nper cent of each true class"
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("predicted", "true")
    assert [tick.get_text() for tick in panel.get_yticklabels()] == ["a", "b", "c"]


def test_confusion_numbers_stand_out_from_their_cell():
    panel = plot_confusion([[95, 5], [50, 50]], ["a", "b"]).axes[0]
    colours = {text.get_text(): text.get_color() for text in panel.texts}
    assert colours["95"] == "white"
    assert colours["5"] == colours["50"] == "#333333"


@pytest.mark.parametrize(
    ("matrix", "labels", "message"),
    [
        ([[1, 2]], ["a"], r"matrix must be square, got shape \(1, 2\)"),
        ([1, 2], ["a", "b"], "matrix must be square"),
        (np.zeros((0, 0)), [], "matrix must be square"),
        ([[1]], ["a", "b"], "labels must name the 1 classes of matrix, got 2"),
        ([[-1]], ["a"], "not negative"),
        ([[np.nan]], ["a"], "finite"),
    ],
)
def test_confusion_is_checked(matrix, labels, message):
    with pytest.raises(ValueError, match=message):
        plot_confusion(matrix, labels)


@pytest.mark.parametrize("ending", ["png", "svg", "pdf", "PNG"])
def test_figures_are_saved_whole(tmp_path, ending):
    path = tmp_path / f"figure.{ending}"
    path.write_bytes(b"old")
    plot_confusion([[1]], ["a"], path=path)
    start = path.read_bytes()[:8]
    assert start == PNG if ending.lower() == "png" else start.startswith((b"<?xml", b"%PDF"))
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_save_leaves_the_old_file_and_no_draft(tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    def fail(self, stream, **options):
        raise OSError("disk full")

    monkeypatch.setattr(Figure, "savefig", fail)
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    with pytest.raises(OSError, match="disk full"):
        plot_confusion([[1]], ["a"], path=path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"old"


def test_unknown_endings_and_missing_folders_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"path must end in .*png.*, got .*figure.xyz"):
        plot_confusion([[1]], ["a"], path=tmp_path / "figure.xyz")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        plot_confusion([[1]], ["a"], path=tmp_path / "missing" / "figure.png")


@pytest.mark.parametrize("plot", [plot_mean_forces, lambda d: plot_confusion([[1]], ["a"])])
def test_without_matplotlib_the_extra_is_named(monkeypatch, synthetic, plot):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"pip install 'granular-id\[app\]'"):
        plot(synthetic)


def test_importing_is_cheap_and_plotting_touches_no_global_state():
    code = (
        "import sys, granular_id.plotting as p\n"
        "assert not any(m.startswith('matplotlib') for m in sys.modules)\n"
        "p.plot_confusion([[1]], ['a']).savefig('/dev/null', format='png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_measuring_imports_no_plotting():
    code = (
        "import sys, granular_id.evaluation, granular_id.evaluation.selection\n"
        "assert not [name for name in sys.modules if name.startswith('granular_id.plotting')]\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
