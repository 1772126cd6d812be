"""Saving as CSV: the same bits back, safe names, nothing half-written."""

import errno
import os
import pathlib
import unicodedata

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from granular_id._checks import OVERRIDES
from granular_id.io import load, save, save_csv
from granular_id.io.csv import save as module
from granular_id.recording import Dataset, Recording

finite = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text(
    st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"], exclude_characters=OVERRIDES),
    min_size=1,
    max_size=20,
).filter(lambda text: text == text.strip())
trees = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), inner)
    ),
    max_leaves=6,
)


@st.composite
def recordings(draw):
    n = draw(st.integers(1, 6))
    fields = {
        "wrench": draw(arrays(np.float64, (n, 6), elements=finite)),
        "label": draw(st.none() | texts),
        "session": draw(st.none() | texts),
        "start_time": draw(st.none() | finite),
        "trigger_index": draw(st.none() | st.integers(0, n - 1)),
        "meta": draw(st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), trees, max_size=3)),
        "flags": draw(st.none() | arrays(np.uint8, n, elements=st.integers(0, 15))),
        "name": draw(st.just("") | texts),
    }
    if draw(st.booleans()):
        fields["rate_hz"] = draw(st.floats(1e-3, 1e6))
    else:
        # from nearly even, which the reader would take for a rate, to wild
        spread = draw(st.sampled_from([0, 1e-6, 1e-3, 1]))
        jitter = draw(st.lists(st.floats(0, 1), min_size=n - 1, max_size=n - 1))
        fields["time_s"] = np.cumsum([0.0, *(0.002 * (1 + spread * part) for part in jitter)])
    return Recording(**fields)


@given(data=st.lists(recordings(), min_size=1, max_size=4))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_round_trip_without_a_differing_bit(tmp_path_factory, data):
    saved = Dataset(data)
    back = load(save_csv(saved, tmp_path_factory.mktemp("trip") / "set"))
    for a, b in zip(saved, back, strict=True):
        assert a == b
        assert a.wrench.tobytes() == b.wrench.tobytes()
        assert a.times().tobytes() == b.times().tobytes()


def sample(**fields):
    return Recording(np.random.default_rng(1).normal(size=(3, 6)), **{"rate_hz": 500, **fields})


def test_labels_never_become_paths(tmp_path):
    labels = [
        "../../up",
        "/etc/passwd",
        "a/b",
        "a\\b",
        "CON",
        "com1.txt",
        ".hidden",
        "...",
        "ä",
        "Gru\u0308tze & \u9162",
        "\u0915\u094d\u0937\u0947\u0924\u094d\u0930",
        "\u0301rice",
        "\u0645\u06cc\u200c\u0634\u0648\u062f",
        "com\u00b9",
        "x" * 300,
        "\u9162" * 300,
        "\U0001f35a" * 3 + "\U00020000" * 300,
        "rice",
    ]
    data = Dataset([sample(label=label) for label in labels])
    folder = save_csv(data, tmp_path / "set")
    assert load(folder).y.tolist() == labels
    written = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))
    assert len(list(tmp_path.iterdir())) == 1
    for name in written:
        assert unicodedata.is_normalized("NFC", name)
        assert all(c in "._-/" or unicodedata.category(c)[0] in "LMN" for c in name)
        for part in name.split("/"):
            assert part[0] not in "._-"
            assert part[-1] not in "._- "
            assert len(part.encode()) < 143
            assert part.split(".")[0].lower() not in {"con", "com1", "com\u00b9"}
    assert "Gru\u0308tze & \u9162" in labels
    assert (folder / "Gr\u00fctze_\u9162").is_dir()


def test_files_read_without_the_index_too(tmp_path):
    data = Dataset([sample(label="rice"), sample(label="rice", flags=[0, 1, 0]), sample(label=None)])
    folder = save_csv(data, tmp_path / "set")
    assert (folder / "index.csv").read_text().splitlines()[0] == (
        "file,label,session,start_time,rate_hz,trigger_index,name,meta"
    )
    (folder / "index.csv").unlink()
    back = load(folder)
    assert back.names == ("rice/rice_1.csv", "rice/rice_2.csv", "unlabelled/unlabelled_3.csv")
    assert [r.rate_hz for r in back] == [500] * 3
    assert back[1].flags.tolist() == [0, 1, 0]


def test_an_empty_folder_is_used_and_a_full_one_refused(tmp_path):
    folder = tmp_path / "set"
    folder.mkdir()
    save_csv(Dataset([sample()]), folder)
    before = sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    with pytest.raises(FileExistsError, match="the folder is not empty; nothing is overwritten"):
        save_csv(Dataset([sample()]), folder)
    file = folder / "index.csv"
    with pytest.raises(FileExistsError, match="there is something already; nothing is overwritten"):
        save_csv(Dataset([sample()]), file)
    with pytest.raises(FileNotFoundError, match="nowhere: no such folder"):
        save_csv(Dataset([sample()]), tmp_path / "nowhere" / "set")
    with pytest.raises(TypeError, match="dataset must be a Dataset, got list"):
        save_csv([sample()], tmp_path / "other")
    assert sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")) == before


def test_a_link_is_not_written_through(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with pytest.raises(FileExistsError, match="link: there is something already; nothing is overwritten"):
        save_csv(Dataset([sample()]), tmp_path / "link")


def test_relative_paths_go_where_they_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load(save_csv(Dataset([sample(label="rice")]), "set")).labels == ("rice",)
    assert (tmp_path / "set" / "index.csv").is_file()


@pytest.mark.parametrize("form", ["csv", "parquet", "mcap"])
def test_what_stops_the_writing_of_a_folder_names_the_folder(tmp_path, monkeypatch, form):
    data = Dataset([sample(label="rice"), sample(label="peas")])

    def full(self, *args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    with monkeypatch.context() as patch:
        patch.setattr(pathlib.Path, "mkdir", full)
        with pytest.raises(OSError, match=r"^cannot write \S*/set: No space left on device$"):
            save(data, tmp_path / "set", form)
    os_open = os.open

    def full_for_new(path, flags, *args, **kwargs):
        return full(path) if flags & os.O_CREAT else os_open(path, flags, *args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", full_for_new)
        patch.setattr(pathlib.Path, "open", full)
        patch.setattr(pathlib.Path, "write_bytes", full)
        if form != "parquet":  # pyarrow opens its files itself
            with pytest.raises(OSError, match=r"^cannot write \S*/set: No space left on device$"):
                save(data, tmp_path / "set", form)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_nothing_is_left_when_writing_fails(tmp_path, monkeypatch, error):
    written = []

    def failing(recording, path):
        written.append(recording)
        if len(written) == 2:
            raise error
        return "half"

    monkeypatch.setattr(module, "_write", failing)
    with pytest.raises(type(error)):
        save_csv(Dataset([sample(), sample()]), tmp_path / "set")
    assert len(written) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="file modes of POSIX")
def test_folders_have_ordinary_permissions(tmp_path):
    (tmp_path / "plain").mkdir()
    folder = save_csv(Dataset([sample()]), tmp_path / "set")
    assert folder.stat().st_mode == (tmp_path / "plain").stat().st_mode
