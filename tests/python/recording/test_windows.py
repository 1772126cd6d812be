"""``Dataset.windows``: long recordings cut into short ones that know where they come from."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id.recording import Dataset, Recording, SampleFlag, overlapping_windows


def drive(n=100, **fields):
    samples = np.arange(3.0 * n).reshape(n, 3)
    known = {"wrench": samples, "rate_hz": 10, "axes": ("ax", "ay", "az"), "name": "drive", "label": "mud"}
    return Recording(**(known | fields))


@pytest.mark.parametrize(
    ("n", "duration_s", "hop_s", "starts", "dropped"),
    [
        (100, 2.5, None, [0, 25, 50, 75], 0),
        (109, 2.5, None, [0, 25, 50, 75], 9),
        (100, 2.5, 2, [0, 20, 40, 60], 15),
        (100, 4.0, 8.0, [0], 60),
        (25, 2.5, 0.1, [0], 0),
        (100, 2.449, 2.551, [0, 26, 52], 28),  # to the nearest sample
    ],
)
def test_where_windows_begin_and_what_is_dropped(n, duration_s, hop_s, starts, dropped):
    one = drive(n)
    data = Dataset([one]).windows(duration_s, hop_s)
    length = round(10 * duration_s)
    assert data.X.tolist() == [one.wrench[start : start + length].tolist() for start in starts]
    assert dict(data.history[-1].rows[0]) == {"name": "drive", "windows": len(starts), "dropped": dropped}
    assert data.history[-1].totals["windows"] == len(starts)


def test_a_window_knows_where_it_comes_from():
    meta = {"units": {"ax": "m/s2"}, "tool": "wheel"}
    window = Dataset([drive(session="s1", start_time=1e9, meta=meta)]).windows(3.4)[1]
    assert window.name == "drive @ 3.4 s"
    assert (window.label, window.session, window.rate_hz) == ("mud", "s1", 10)
    assert window.axes == ("ax", "ay", "az")
    assert window.start_time == 1e9 + 3.4
    assert window.meta == {**meta, "window": {"recording": "drive", "start_s": 3.4}}
    two = drive(session="s1")
    windows = Dataset([two, drive(name="b")]).windows(5, 1)
    assert windows.sessions.tolist() == ["s1"] * 6 + [None] * 6
    assert np.shares_memory(windows[1].wrench, two.wrench)


def test_flags_and_triggers_go_where_they_lie():
    flags = np.zeros(100, np.uint8)
    flags[42] = SampleFlag.SATURATED
    data = Dataset([drive(flags=flags, trigger_index=57)]).windows(2)
    places = [None if r.flags is None else r.flags.nonzero()[0].tolist() for r in data]
    assert places == [None, None, [2], None, None]
    assert [r.trigger_index for r in data] == [None, None, 17, None, None]


def test_windows_of_windows_are_of_the_recording():
    data = Dataset([drive()]).windows(5).windows(2)
    assert data.names == ("drive @ 0 s", "drive @ 2 s", "drive @ 5 s", "drive @ 7 s")
    assert data[3].meta["window"] == {"recording": "drive", "start_s": 7.0}


def test_recordings_shorter_than_a_window():
    data = Dataset([drive(19, name="short"), drive(20)])
    with pytest.raises(ValueError, match=r"'short' is shorter .* 20 wanted; 1 of 2 .*on_short='skip'"):
        data.windows(2)
    long = data.windows(2, on_short="skip")
    assert long.names == ("drive @ 0 s",)
    assert long.history[-1].rows[0]["skipped"].startswith("is shorter")
    with pytest.raises(ValueError, match="none of the 2 recordings is as long as a window of 30 samples"):
        data.windows(3, on_short="skip")


def test_windows_of_one_recording_are_no_witnesses_of_each_other():
    rng = np.random.default_rng(0)
    about = [{"label": label, "name": f"{label}{k}", "meta": {"tool": k}} for label in "ab" for k in range(5)]
    data = Dataset([Recording(rng.normal(size=(400, 6)), 100.0, **one) for one in about])
    found = [finding.code for finding in data.windows(1.0, 0.5).check()]
    assert "near-duplicates" not in found  # they overlap
    assert not [code for code in found if code.startswith("leak")]  # each recording has one label


def test_windows_of_nameless_recordings_are_told_apart():
    data = Dataset([drive(name=""), drive(name="", meta={"window": "hann"})]).windows(5)
    assert data.names == ("recording 1 @ 0 s", "recording 1 @ 5 s", "recording 2 @ 0 s", "recording 2 @ 5 s")


PAIRS = {2.5: [], 2.4: [(0, 1), (1, 2)], 1.2: [(0, 1), (0, 2), (1, 2)]}


@pytest.mark.parametrize("hop_s", PAIRS)
def test_windows_that_share_samples(hop_s):
    data = Dataset([drive(n=25 + 2 * round(10 * hop_s))]).windows(2.5, hop_s)
    assert list(overlapping_windows(data.recordings)) == PAIRS[hop_s]


def test_windows_without_a_measured_sample_are_left_out():
    flags = np.zeros(100, np.uint8)
    flags[20:60] = SampleFlag.GAP_FILLED
    data = Dataset([drive(flags=flags)]).windows(2)
    assert data.names == ("drive @ 0 s", "drive @ 6 s", "drive @ 8 s")
    assert dict(data.history[-1].rows[0]) == {"name": "drive", "windows": 3, "dropped": 40}
    assert data.history[-1].totals["windows_without_a_measured_sample"] == 2
    with pytest.raises(ValueError, match="no window has a measured sample"):
        Dataset([drive(flags=np.full(100, SampleFlag.GAP_FILLED, np.uint8))]).windows(2)


def test_windows_of_files_of_the_same_name_share_no_samples():
    rng = np.random.default_rng(0)
    days = [Dataset([drive(wrench=rng.normal(size=(100, 3)))]).windows(5) for _ in range(2)]
    assert list(overlapping_windows(Dataset.concatenate(days).recordings)) == []
