from dataclasses import replace

import numpy as np
import pytest

from granular_id.plotting.onset import plot_onsets
from granular_id.recording import Dataset, Recording
from onset_cases import RATE_HZ, noise, push

pytest.importorskip("matplotlib")


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
    assert figure.legends[0]._ncols == len(figure.legends[0].get_texts())  # one line, none hangs below
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
    assert figure.axes[-1].get_xlabel() == "time from the onset or, without one, the end of rest, s"


def test_onsets_are_found_first_where_they_were_not_and_the_line_stands_there(data):
    figure = plot_onsets(data, n=100, false_alarm_rate=0.01)
    assert len(figure.axes) == 2 * len(data)
    assert figure.get_suptitle() == "Onsets of 8 of 8 recordings: rest 0.1 s, false-alarm rate 0.01"
    found = data.find_onsets(false_alarm_rate=0.01)
    (line,) = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 2]
    assert line.get_xdata()[0] == found[0].trigger_index / RATE_HZ


def test_other_axes_irregular_and_synthetic_recordings():
    one = Recording(push(2)[:, :1], rate_hz=RATE_HZ, axes=("force",), name="one", meta={"synthetic": True})
    assert "synthetic" in plot_onsets(Dataset([one])).get_suptitle()
    times = np.arange(900) / RATE_HZ
    times[5] += 0.0005
    irregular = Dataset([Recording(noise(1, 900), time_s=times, name="irregular")])
    figure = plot_onsets(irregular.find_onsets(overrule={"irregular": 0.2}))
    assert figure.axes[1].get_title(loc="right") == "0.200 s"


@pytest.mark.parametrize(
    ("n", "error"), [(0, ValueError), (-1, ValueError), (1.5, TypeError), (True, TypeError)]
)
def test_bad_n_is_named(data, n, error):
    with pytest.raises(error, match=r"^n must be"):
        plot_onsets(data, n=n)
