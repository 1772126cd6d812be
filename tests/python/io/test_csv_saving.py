"""Saving as CSV: the same bits back, safe names, nothing half-written."""

import unicodedata

import numpy as np

from granular_id.io import load, save
from granular_id.recording import Dataset, Recording

LABELS = (
    "../../up|/etc/passwd|a/b|a\\b|CON|com1.txt|com\u00b9|.hidden|...|\u00e4|rice|Gru\u0308tze & \u9162|"
    "\u0915\u094d\u0937\u0947\u0924\u094d\u0930|\u0301rice|\u0645\u06cc\u200c\u0634\u0648\u062f"
)


def sample(**fields):
    return Recording(np.random.default_rng(1).normal(size=(3, 6)), **{"rate_hz": 500, **fields})


def test_labels_never_become_paths(tmp_path):
    labels = [*LABELS.split("|"), "x" * 300, "\u9162" * 300, "\U0001f35a" * 3 + "\U00020000" * 300]
    data = Dataset([sample(label=label) for label in labels])
    folder = save(data, tmp_path / "set", "csv")
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
    assert (folder / "Gr\u00fctze_\u9162").is_dir()


def test_files_read_without_the_index_too(tmp_path):
    data = Dataset([sample(label="rice"), sample(label="rice", flags=[0, 1, 0]), sample(label=None)])
    folder = save(data, tmp_path / "set", "csv")
    assert (folder / "index.csv").read_text().splitlines()[0] == (
        "file,label,session,start_time,rate_hz,trigger_index,name,meta"
    )
    (folder / "index.csv").unlink()
    back = load(folder)
    assert back.names == ("rice/rice_1.csv", "rice/rice_2.csv", "unlabelled/unlabelled_3.csv")
    assert [r.rate_hz for r in back] == [500] * 3
    assert back[1].flags.tolist() == [0, 1, 0]


def test_relative_paths_have_ordinary_permissions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load(save(Dataset([sample(label="rice")]), "set", "csv")).labels == ("rice",)
    (tmp_path / "plain").mkdir()
    assert (tmp_path / "set").stat().st_mode == (tmp_path / "plain").stat().st_mode
