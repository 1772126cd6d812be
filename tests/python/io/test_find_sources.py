"""Which files a path holds, and where label and session come from: folders, names, index.csv, options."""

import os

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load, load_parts, save
from granular_id.recording import AXES
from remedies import lines_of, run

HEADER = "time," + ",".join(AXES)
ROWS = ["0,1,2,3,4,5,6", "0.01,1,2,3,4,5,6", "0.02,6,5,4,3,2,1"]


def write(path, header=HEADER, rows=ROWS):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([header, *rows, ""]))


def tree(folder, *paths):
    for path in paths:
        write(folder / path)
    return folder


READ = {
    # depth 0: the name without the number at its end
    "fine_sugar_2.csv fine_sugar_10.csv": ["fine_sugar", "fine_sugar"],
    "rice_1 (1).csv rice_1.csv rice_2 - Copy.csv rice_2.csv": ["rice"] * 4,
    "brown_rice.csv cat_litter.csv fine_sugar.csv": ["brown_rice", "cat_litter", "fine_sugar"],
    "peas-3.csv rice-1.csv": ["peas", "rice"],
    "peas3.csv rice (2).csv": ["peas", "rice"],
    "peas_2025-03-04.csv rice_20250304_101500.csv": ["peas", "rice"],
    "run3-rice.csv run4-peas.csv": ["rice", "peas"],
    "01_peas.csv 02_rice.csv": ["peas", "rice"],
    "2025-03-04_peas_1.csv 2025-03-04_rice_1.csv": ["peas", "rice"],
    "peas_04-03-2025.csv rice_day2_01.csv rice_trial_1.csv": ["peas", "rice", "rice"],
    "peas_20250304_01.csv rice_20250304_02.csv": ["peas", "rice"],
    "peas_01_20250304.csv rice_02_20250305.csv": ["peas", "rice"],
    "peas_01_250304.csv rice_1_2025-03-04.csv rice_250304_0914.csv": ["peas", "rice", "rice"],
    "2025-03-04_01_peas.csv 2025-03-04_02_rice.csv": ["peas", "rice"],
    "peas_push_03.csv rice_push_04.csv": ["peas", "rice"],
    # counted words of any language, where all names end so
    "peas_s1.csv peas_s2.csv rice_s1.csv": ["peas", "peas", "rice"],
    "peas_trial1_s1.csv peas_trial1_s2.csv rice_trial1_s1.csv": ["peas", "peas", "rice"],
    "oats_Tag1.csv oats_Tag2.csv peas_Tag1.csv rice_Tag1.csv": ["oats", "oats", "peas", "rice"],
    "peas_Tag1_V1.csv peas_Tag2_V1.csv rice_Tag1_V1.csv rice_Tag1_V2.csv": ["peas", "peas", "rice", "rice"],
    "peas_01_01.csv peas_02_01.csv rice_01_01.csv rice_01_02.csv": ["peas", "peas", "rice", "rice"],
    "brown_rice1.csv brown_rice2.csv white_rice1.csv": ["brown_rice", "brown_rice", "white_rice"],
    "beads_d2_1.csv beads_d4_1.csv glass_d2_1.csv": ["beads_d2", "beads_d4", "glass_d2"],
    "beads_4_1.csv beads_6_1.csv glass_4_1.csv": ["beads_4", "beads_6", "glass_4"],
    "2_mm_sand.csv sand_0.5mm_1.csv sand_40_2.csv": ["2_mm_sand", "sand_0.5mm", "sand_40"],
    "P1_rice_01.csv P1_sugar_03.csv P2_rice_01.csv": ["rice", "sugar", "rice"],
    "A1-rice-T01.csv B1-rice-T01.csv B1-salt-T01.csv": ["rice", "rice", "salt"],
    "d2_beads_1.csv d2_beads_2.csv d4_beads_1.csv": ["d2_beads", "d2_beads", "d4_beads"],
    "rice-7-left.csv salt-7-left.csv": ["rice-7-left", "salt-7-left"],
    "rosbag2_2025_03_04-10_11_12.csv": [None],
    "1.csv 2.csv": [None, None],
    "trial_1.csv trial_2.csv": [None, None],
    # depth 1: the folder
    "fine sugar/push_1.csv rice/push_1.csv": ["fine sugar", "rice"],
    "mat01/mat01_01.csv mat02/mat02_01.csv": ["mat01", "mat02"],
    "peas/1.csv rice/1.csv rice/2.csv rice/10.csv": ["peas", "rice", "rice", "rice"],
    "rice/empty.csv rice/full.csv sugar/empty.csv sugar/full.csv": ["rice", "rice", "sugar", "sugar"],
    "test/1.csv rice/1.csv": ["rice", "test"],
    "peas/left.csv peas/right.csv rice/left.csv rice/right.csv": ["peas", "peas", "rice", "rice"],
    "peas/1.csv peas/wet.csv rice/1.csv rice/wet.csv": ["peas", "peas", "rice", "rice"],
    "raw_data/peas/1.csv raw_data/rice/1.csv": ["peas", "rice"],
    "peas/Messung_1.csv peas/Messung_2.csv rice/Messung_1.csv": ["peas", "peas", "rice"],
    "peas/1x.csv peas/2x.csv rice/1x.csv": ["peas", "peas", "rice"],
    "rice_data/1.csv sand_data/1.csv": ["rice_data", "sand_data"],
    # a folder a push: without its number
    "2025-03-04_rice_1/ft.csv 2025-03-04_rice_2/ft.csv 2025-03-05_peas_1/ft.csv": ["rice", "rice", "peas"],
    "rice_1/ft.csv rice_2/ft.csv sugar_1/ft.csv": ["rice", "rice", "sugar"],
    "rice_1/1.csv rice_2/1.csv rice_2/2.csv": ["rice_1", "rice_2", "rice_2"],
    "rice_1/a.csv rice_2/b.csv": ["rice_1", "rice_2"],
    "rice_1/ft.csv rice_2/ft.csv sand_40/ft.csv sand_80/ft.csv": ["rice_1", "rice_2", "sand_40", "sand_80"],
}


@pytest.mark.parametrize("paths", READ)
def test_labels_by_default_are_noted(tmp_path, paths):
    names = paths.replace(".csv ", ".csv\n").splitlines()
    data = load(tree(tmp_path, *names))
    assert [r.label for r in data] == READ[paths]
    assert data.sessions.tolist() == [None] * len(data)
    label, session, *_ = [note for note in data.history[-1].notes if "one recording only" not in note]
    if READ[paths][0] is not None:
        place = "folder" if "/" in paths else "name of the file"
        place = "name of the folder" if READ[paths][0] + "_1/ft" in paths else place
        assert label.startswith(f"label: {place} ('{READ[paths][0]}' of {data.names[0]}")
    assert session == "session: not known"


def test_a_recording_that_is_there_twice_is_noted(tmp_path):
    tree(tmp_path, "rice/1.csv", "rice/1 (1).csv", "rice/2.csv", "rice/2.txt", "peas/1.csv", "peas/2.csv")
    notes = load(tmp_path).history[-1].notes
    assert "2 files may be a recording that is there already ('2.txt' as '2.csv')" in notes


def test_results_beside_recordings_are_no_index(tmp_path):
    tree(tmp_path, "rice_1.csv", "rice_2.csv", "peas_1.csv")
    write(tmp_path / "summary.csv", "file,mean_fx", ["rice_1.csv,2"])
    assert load(tmp_path).labels == ("peas", "rice")


def test_labels_that_differ_by_case_are_noted_first(tmp_path):
    names = ["fine_sugar_1.csv", "Fine sugar_2.csv", "rice_1.csv", "rice_2.csv", "mix 1-2.csv", "mix 1.2.csv"]
    notes = load(tree(tmp_path, *names)).history[-1].notes
    assert notes[0].startswith(
        "labels that differ by case or blanks only are materials of their own: 'Fine sugar'"
    )


def test_labels_of_two_parts_are_noted(tmp_path):
    names = [f"{who}_{what}_{i}.csv" for who in ("anna", "bert") for what in ("rice", "peas") for i in (1, 2)]
    first, *_ = load(tree(tmp_path, *names)).history[-1].notes
    assert first.startswith("labels are pairs of anna, bert and peas, rice, each a material")


def test_folders_of_days_with_numbered_files_want_an_index(tmp_path):
    tree(tmp_path, "2025-03-04/001.csv", "2025-03-04/002.csv", "2025-03-05/003.csv")
    with pytest.raises(RecordingFileError, match="list file and label in an index") as caught:
        load(tmp_path)
    assert not caught.value.ways


PUSHES = {
    "rice/rice_1/ft.csv rice/rice_2/ft.csv peas/peas_1/ft.csv": (["peas", "rice", "rice"], [None] * 3),
    "rice/push_1/ft.csv rice/push_2/ft.csv peas/push_1/ft.csv": (["peas", "rice", "rice"], [None] * 3),
    "d1/rice_1/ft.csv d1/rice_2/ft.csv d2/peas_1/ft.csv": (["rice", "rice", "peas"], ["d1", "d1", "d2"]),
    "rice/Lauf1/1.csv rice/Lauf1/2.csv peas/Lauf2/1.csv": (
        ["peas", "rice", "rice"],
        ["Lauf2", "Lauf1", "Lauf1"],
    ),
}


def test_pushes_with_other_files_beside_are_named_by_their_folders(tmp_path):
    folders = ("run_1_rice", "run_2_rice", "run_3_peas")
    for folder in folders:
        write(tmp_path / folder / "joints.csv", "time,q1,q2", ["0,1,2", "1,2,3"])
    data = load(tree(tmp_path, *(f"{folder}/ft.csv" for folder in folders)))
    assert data.y.tolist() == ["rice", "rice", "peas"]


def test_notes_above_the_folders_of_recordings_are_left_out(tmp_path):
    tree(tmp_path, "rice/1.csv", "peas/1.csv")
    (tmp_path / "merkintoja.txt").write_text("a bag of 2 kg")
    data = load(tmp_path)
    assert data.labels == ("peas", "rice")
    assert "not read, as they lie above the recordings: merkintoja.txt" in data.history[-1].notes


def test_dates_within_names_have_a_line(tmp_path):
    days = [("anna", "2025-03-04", "oats"), ("anna", "2025-03-04", "rice"), ("ben", "20250305", "oats")]
    tree(tmp_path, *("-".join((*one, "1.csv")) for one in days))
    with pytest.raises(RecordingFileError, match="a date stands within names") as caught:
        load(tmp_path)
    data = run(lines_of(caught.value.problem)[0])
    assert data.y.tolist() == ["oats", "rice", "oats"]
    assert data.sessions.tolist() == ["2025-03-04", "2025-03-04", "20250305"]


def test_pushes_within_a_folder_of_data_are_named_by_their_folders(tmp_path):
    data = load(tree(tmp_path, "data/rice_1/ft.csv", "data/rice_2/ft.csv", "data/peas_1/ft.csv"))
    assert data.y.tolist() == ["peas", "rice", "rice"]


@pytest.mark.parametrize("paths", ["monday_1/ft.csv monday_2/ft.csv", "monday/1/ft.csv tuesday/1/ft.csv"])
def test_days_in_folders_are_not_first_read_as_materials(tmp_path, paths):
    tree(tmp_path, *paths.split())
    with pytest.raises(RecordingFileError, match=r"no materials|two things") as caught:
        load(tmp_path)
    assert not caught.value.ways or caught.value.ways[0]["label"] == "folder"


@pytest.mark.parametrize("paths", PUSHES)
def test_folders_of_pushes_are_first_read_as_such(tmp_path, paths):
    tree(tmp_path, *paths.split())
    with pytest.raises(RecordingFileError, match="two things") as caught:
        load(tmp_path)
    data = load(tmp_path, **caught.value.ways[0])
    assert (data.y.tolist(), data.sessions.tolist()) == PUSHES[paths]


def test_labels_of_one_recording_each_are_noted_first(tmp_path):
    tree(tmp_path, "01/rice_1.csv", "02/rice_2.csv", "03/peas_1.csv", "04/peas_2.csv")
    data = load(tmp_path, label="folder")
    note = data.history[-1].notes[0]
    assert note.startswith("4 of 4 labels have one recording only ('01', '02', '03', ...)")
    assert "no materials, pass label='file' (--label file); or" in note
    assert not any("one recording" in note for note in load(tmp_path, label="file").history[-1].notes)
    lines = ["file,label,grain", *(f"{name},{k},{name[3:7]}" for k, name in enumerate(data.names)), ""]
    (tmp_path / "index.csv").write_text("\n".join(lines))
    assert "pass label='meta:grain' (--label meta:grain)" in load(tmp_path).history[-1].notes[0]
    assert load(tmp_path, label="meta:grain").labels == ("peas", "rice")


DOUBTFUL = {
    # two levels, and three: days, persons, runs above or below materials
    "2025-03-04/rice/1.csv 2025-03-05/rice/1.csv": ("folder", "parent"),
    "rice/2025-03-04/1.csv rice/2025-03-05/1.csv": ("parent", "folder"),
    "anna/rice/1.csv bert/rice/1.csv": ("folder", "parent"),
    "rice/run_1/1.csv rice/run_2/1.csv": ("parent", "folder"),
    "rice/fast/1.csv rice/slow/1.csv": ("parent", "folder"),
    "anna/03-11/rice_1.csv anna/03-11/rice_2.csv bert/03-11/peas_1.csv": ("file", "folder"),
    "lab/2025-03-04/rice/1.csv lab/2025-03-05/rice/1.csv": ("folder", "parent"),
    # one level of what is no material
    "2025-03-04/rice_1.csv 2025-03-05/rice_1.csv": ("file", "folder"),
    "monday/rice_1.csv tuesday/rice_1.csv": ("file", "folder"),
    "person1/rice_1.csv person2/rice_1.csv": ("file", "folder"),
    "session_1/rice.csv session_2/rice.csv": ("file", "folder"),
    "run1/rice_1.csv run2/rice_2.csv": ("file", "folder"),
    "train/rice_1.csv test/rice_1.csv": ("file", "folder"),
    "anna/rice_1.csv anna/peas_1.csv bert/rice_1.csv bert/peas_1.csv": ("file", "folder"),
    "1/rice.csv 1/peas.csv 2/rice.csv 2/peas.csv": ("file", "folder"),
    "data/rice_1.csv logs/peas_1.csv": ("file", "folder"),
    "anna/rice_1.csv anna/peas_1.csv bert/rice_1.csv bert/peas_3.csv bert/peas_4.csv": ("file", "folder"),
}


@pytest.mark.parametrize("paths", DOUBTFUL)
def test_folders_of_two_meanings_have_both_ways_out(tmp_path, paths):
    label, session = DOUBTFUL[paths]
    tree(tmp_path, *paths.split())
    with pytest.raises(RecordingFileError, match="label='folder'") as caught:
        load(tmp_path)
    assert f"label='{label}', session='{session}'" in str(caught.value)
    with pytest.raises(RecordingFileError, match="label='folder'"):
        load(tmp_path, on_error="skip")
    data = load(tmp_path, label=label, session=session)
    assert set(data.labels) <= {"rice", "peas"}
    assert len(set(data.sessions)) == 2
    other = load(tmp_path, label="folder")
    assert (other.sessions == None).all()  # noqa: E711 (an array)
    (tmp_path / "index.csv").write_text("file,label\n" + "".join(f"{path},oats\n" for path in paths.split()))
    assert load(tmp_path).labels == ("oats",)


ORDERED = ["2025-03-01", "1", "session_2", "s1", "march_4", "01.03.2025", "2025-03-01_10-11"]
NAMES = ("barley", "fine_salt", "mat01", "marble_1")


@pytest.mark.parametrize("other", ORDERED)
@pytest.mark.parametrize("material", NAMES)
def test_folders_that_count_are_first_read_as_sessions(tmp_path, material, other):
    below = tree(tmp_path / "below", f"{material}/{other}/1.csv")
    above = tree(tmp_path / "above", f"{other}/{material}/1.csv")
    for folder, label, session in ((below, "parent", "folder"), (above, "folder", "parent")):
        with pytest.raises(RecordingFileError) as caught:
            load(folder)
        ways = [(way["label"], way["session"]) for way in caught.value.ways if "session" in way]
        assert ways == [(label, session), (session, label)]


def test_days_of_two_persons_are_two_sessions(tmp_path):
    tree(tmp_path, *(f"{who}/{day}/rice/1.csv" for who in ("anna", "bert") for day in ("d1", "d2")))
    data = load(tmp_path, label="folder", session="parent")
    assert data.sessions.tolist() == ["anna/d1", "anna/d2", "bert/d1", "bert/d2"]
    tree(tmp_path / "other", *(f"{who}/rice/{day}/1.csv" for who in ("anna", "bert") for day in ("d1", "d2")))
    data = load(tmp_path / "other", label="parent", session="folder")
    assert data.sessions.tolist() == ["anna/d1", "anna/d2", "bert/d1", "bert/d2"]


@pytest.mark.parametrize(
    ("label", "session", "expected"),
    [
        ("folder", "file", ("rice", "a/rice/push_1.csv")),
        ("parent", "folder", ("a", "rice")),
        ("file", "parent", ("push_1", "a")),
        ("column:stuff", "column:day", ("oats", "3.0")),
        ("meta:read_as", "folder", ("time=t", "a/rice")),
    ],
)
def test_label_and_session_are_read_where_stated(tmp_path, label, session, expected):
    rows = [f"{i / 10},{row},oats,3.0" for i, row in enumerate(["1,2,3,4,5,6"] * 3)]
    write(tmp_path / "a" / "rice" / "push_1.csv", f"t,{','.join(AXES)},stuff,day", rows)
    data = load(tmp_path, label=label, session=session, time="t", time_unit="s")
    assert (data[0].label, data[0].session) == expected
    assert data.history[-1].notes[0].startswith(f"label: {label} (")


MUESLI = "M\N{LATIN SMALL LETTER U WITH DIAERESIS}sli"


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-8-sig"])
def test_index_is_read_in_the_encodings_of_spreadsheets(tmp_path, encoding):
    tree(tmp_path, "a.csv")
    (tmp_path / "index.csv").write_bytes(
        "file;label\na.csv;Gr\N{LATIN SMALL LETTER U WITH DIAERESIS}nkern\n".encode(encoding)
    )
    data = load(tmp_path)
    assert data.labels == ("Gr\N{LATIN SMALL LETTER U WITH DIAERESIS}nkern",)
    assert ("index.csv is no UTF-8 text: read as cp1252" in data.history[-1].notes) == (encoding == "cp1252")


def test_index_says_it_all(tmp_path):
    write(tmp_path / "a.csv")
    write(tmp_path / "deep" / "er" / "b.csv", rows=["1.6e9,1,2,3,4,5,6", "1600000000.01,1,2,3,4,5,6"])
    tree(tmp_path, "spare.csv", "deep/er/spare.csv")
    (tmp_path / "index.csv").write_text(
        "File,LABEL,session,start_time,rate_hz,trigger_index,meta,operator\n"
        'deep/er/b.csv,"oats, rolled",s2,1.5e9,100,1,"{""depth_mm"": 76}",anna\n'
        "\n"
        "a.csv,,,,,,,\n",
    )
    data = load(tmp_path)
    b, a = data
    known = (b.label, b.session, b.start_time, b.rate_hz, b.trigger_index)
    assert known == ("oats, rolled", "s2", 1.5e9, 100, 1)
    assert b.meta == {"depth_mm": 76, "operator": "anna"}
    assert b.name == "deep/er/b.csv"
    assert (a.label, a.session, a.start_time, a.trigger_index, a.meta) == (None, None, None, None, {})
    assert data.history[-1].notes[2:] == (
        "columns of index.csv read into meta: operator",
        "2 recordings beside index.csv (spare.csv ...) are not listed in it and were not read",
    )
    assert load(tmp_path, session="meta:operator", on_error="skip")[0].session == "anna"
    (note,) = (note for note in load(tmp_path / "spare.csv").history[-1].notes if "index.csv" in note)
    assert note.endswith(
        "/index.csv is not read with a single file: name the folder for label, session and meta"
    )


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("", None, "is empty"),
        ("label\nrice\n", 1, "no column 'file'"),
        ("file,file\na.csv,a.csv\n", 1, "occurs twice"),
        ("file\n", 2, "lists no file"),
        ("file,label\na.csv\n", 2, "1 cells; wanted 2"),
        ("file\n../a.csv\n", 2, "not a file within the folder"),
        ("file\na.csv\na.csv\n", 3, "already listed in line 2"),
        ("file\na.xlsx\n", None, "no known format"),
        ("file\nmissing.csv\n", None, "cannot be read"),
        ("file,rate_hz\na.csv,nan\n", 2, "is no rate"),
        ("file,start_time\na.csv,monday\n", 2, "is no time"),
        ("file,start_time\na.csv,2025-13-04 10:00\n", 2, "is no time"),
        ("file,trigger_index\na.csv,1.5\n", 2, "not a whole number"),
        ("file,trigger_index\na.csv,99\n", None, "outside the 3 samples"),
        ("file,meta\na.csv,[1]\n", 2, "wanted an object"),
        ('file,axes\na.csv,"[1]"\n', 2, "axes"),
        ('file\n"a.csv\n', 2, "not valid CSV"),
        ("file,label\na.csv,ri\x07ce\n", None, "control character"),
    ],
)
def test_bad_index_is_refused_by_line(tmp_path, text, line, problem):
    tree(tmp_path, "a.csv", "b.csv")
    (tmp_path / "a.xlsx").write_bytes(b"")
    (tmp_path / "index.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RecordingFileError, match=problem) as caught:
        load(tmp_path)
    assert caught.value.line == line


@pytest.mark.parametrize("name", ["filename", "File Name", "file_path", "path"])
def test_index_names_its_files_by_usual_words(tmp_path, name):
    tree(tmp_path, "a.csv", "b.csv")
    (tmp_path / "index.csv").write_text(f"{name},class\na.csv,rice\nb.csv,peas\n")
    assert load(tmp_path, label="meta:class").y.tolist() == ["rice", "peas"]


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        *((text, 1581072654.25) for text in ("2020-02-07T10:50:54.25+00:00", "2020-02-07T10:50:54.25Z")),
        *((text, 1581072654.25) for text in ("2020-02-07 11:50:54.250+01:00", "1581072654.25")),
        *(("2020-02-07", 1581033600), ("2020/02/07 10:50:54.25", 1581072654.25)),
    ],
)
def test_start_times_of_the_index_may_be_dates_of_utc(tmp_path, text, seconds):
    write(tmp_path / "a.csv", ",".join(AXES), ["1,2,3,4,5,6"])
    (tmp_path / "index.csv").write_text(f"file,start_time,rate_hz\na.csv,{text},500\n")
    data = load(tmp_path)
    assert data[0].start_time == seconds
    note = f"start_time {text!r} of index.csv states no zone: taken as UTC"
    assert (note in data.history[-1].notes) == (text in ("2020-02-07", "2020/02/07 10:50:54.25"))


def test_a_bag_without_metadata_is_named(tmp_path):
    for name in ("rice/push_1", "rice/push_2"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "push.db3").write_bytes(b"")
    (tmp_path / "rice/push_1/metadata.yaml").write_text("")
    with pytest.raises(RecordingFileError, match=r"push_2/push.db3: lies without a metadata.yaml beside it"):
        load(tmp_path)


def test_index_keeps_even_stamps_where_it_calls_them_irregular(tmp_path):
    tree(tmp_path, "a.csv")
    (tmp_path / "index.csv").write_text("file,rate_hz\na.csv,irregular\n")
    for rate in (None, 100, 7):
        assert load(tmp_path, rate_hz=rate)[0].time_s.tolist() == [0, 0.01, 0.02]
    write(tmp_path / "a.csv", ",".join(AXES), ["1,2,3,4,5,6"])
    with pytest.raises(RecordingFileError, match="has no time column, but is called irregular"):
        load(tmp_path, rate_hz=100)


def test_what_lies_beside_recordings_is_listed(tmp_path):
    tree(tmp_path, "rice/rice_1.csv", "rice/mean_rice.csv", "peas/README.csv", "peas/all_mean_2.csv")
    write(tmp_path / "peas" / "peas_1.csv")
    write(tmp_path / "peas" / "scale.csv", "time,mass", ["0,1", "1,2"])
    (tmp_path / "peas" / "photo.jpg").write_bytes(b"")
    (tmp_path / "peas" / ".hidden_1.csv").write_text("no recording")
    data = load(tmp_path)
    assert data.names == ("peas/peas_1.csv", "rice/rice_1.csv")
    notes = " ".join(data.history[-1].notes)
    assert "not those of recordings: peas/README.csv, peas/all_mean_2.csv, rice/mean_rice.csv" in notes
    assert "hold none of the axes: scale.csv" in notes
    assert "1 file of no known format is not read (.jpg)" in notes


@pytest.mark.parametrize(
    ("paths", "lost"),
    [
        ("rice/push_1.csv rice/push_2.csv peas/push_1.csv", "rice/push_3.csv"),  # by its name
        ("rice_1.csv rice_2.csv peas_1.csv", "rice_3.csv"),
        ("rice.csv peas.csv", "oats.csv"),  # by its columns
    ],
)
def test_recordings_without_axes_are_refused(tmp_path, paths, lost):
    tree(tmp_path, *paths.split(), "notes_1.csv")
    write(tmp_path / "notes_1.csv", "day,note", ["1,dry"])
    write(tmp_path / lost, "t,a,b,c,d,e,f")
    options = {"label": "folder"} if "/" in lost else {}
    with pytest.raises(RecordingFileError, match=f"{lost}, line 1: names none of") as caught:
        load(tmp_path, **options)
    assert caught.value.skippable
    (tmp_path / lost).write_bytes(b"")
    with pytest.raises(RecordingFileError, match=r"is empty \(0 bytes\)"):
        load(tmp_path, **options)
    write(tmp_path / lost, "t,a,b,c,d,e,f")
    report = load(tmp_path, on_error="skip", **options).history[-1]
    assert report.totals["skipped"] == 1
    assert report.notes[0] == "not read, as they hold none of the axes: notes_1.csv"


def test_what_holds_no_recordings_says_what_is_wanted(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere: no such file or folder"):
        load(tmp_path / "nowhere")
    (tmp_path / "a.xlsx").write_bytes(b"PK")
    for path, problem in (
        (tmp_path / "a.xlsx", "no known format; what can be read: text tables .*from_frames"),
        (tmp_path, r"holds no recordings; .*known format \(\.xlsx\); .*from_arrays"),
    ):
        with pytest.raises(RecordingFileError, match=problem):
            load(path)
    write(tmp_path / "scale.csv", "time,mass", ["0,1", "1,2"])
    with pytest.raises(RecordingFileError, match="names none of fx"):
        load(tmp_path)


def test_several_levels_at_once_are_refused(tmp_path):
    tree(tmp_path, "peas/1.csv", "rice_1.csv")
    with pytest.raises(RecordingFileError, match=r"several levels .*\('rice_1.csv' and 'peas/1.csv'\)"):
        load(tmp_path)
    assert set(load(tmp_path, label="file").labels) == {"1", "rice"}


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="needs symbolic links")
def test_links_within_the_folder_are_followed_and_no_others(tmp_path):
    tree(tmp_path / "set", "rice/1.csv")
    write(tmp_path / "outside" / "1.csv")
    (tmp_path / "set" / "rice" / "2.csv").symlink_to("1.csv")
    (tmp_path / "way").symlink_to("set")
    assert load(tmp_path / "way").names == ("rice/1.csv", "rice/2.csv")
    for name, target, problem in (
        ("rice/link.csv", tmp_path / "outside" / "1.csv", "leaves the folder"),
        ("peas", tmp_path / "outside", "leaves the folder"),
        ("rice/lost.csv", "missing.csv", "cannot be read"),
    ):
        (tmp_path / "set" / name).symlink_to(target)
        with pytest.raises(RecordingFileError, match=problem) as caught:
            load(tmp_path / "set")
        assert caught.value.path == str(tmp_path / "set" / name)
        assert load(tmp_path / "set", on_error="skip").names == ("rice/1.csv", "rice/2.csv")
        (tmp_path / "set" / name).unlink()


def test_progress_is_called_for_every_file(tmp_path):
    tree(tmp_path, "a_0.csv", "a_1.csv", "a_2.csv")
    (tmp_path / "a_1.csv").write_text("fx\nbroken")
    calls = []
    load(tmp_path, on_error="skip", progress=lambda done, total, _: calls.append((done, total)))
    assert calls == [(1, 3), (2, 3), (3, 3)]


READ_FIRST = ({"label": "column:mass"}, {"label": "meta:tool.name"})
OPTIONS = [
    *[({"rate_hz": value}, "rate_hz") for value in (0, float("nan"), "1")],
    *[({name: 3}, name) for name in ("progress", "id", "csv", "units")],
    ({"on_error": "ignore"}, "on_error='ignore'"),
    ({"on_time_error": "sort"}, "on_time_error='sort'"),
    ({"time_unit": "min"}, "time_unit"),
    ({"axes": []}, "axes"),
    ({"axes": "fx,fx"}, "axes"),
    ({"rate": 1}, "rate is no option of load; wanted one of rate_hz|unexpected keyword argument 'rate'"),
    # options of other formats
    ({"topic": ""}, "topic"),
    ({"topic": "/ft"}, "topic"),
    ({"array": "X"}, "array"),
    # places that are not there
    ({"label": "material"}, "label='material'; wanted 'folder', .*, 'column:NAME' or 'meta:PATH'"),
    ({"session": "column:"}, "session='column:'; wanted"),
    ({"session": "parent"}, "no folder above its own"),
    *zip(READ_FIRST, ("label='mass' is no column", "no text or number in its metadata"), strict=True),
]


@pytest.mark.parametrize(("options", "problem"), OPTIONS)
def test_option_that_cannot_be_is_refused_by_name(tmp_path, options, problem):
    tree(tmp_path, "rice_1.csv")
    with pytest.raises((TypeError, ValueError), match=problem):
        load(tmp_path, **options)
    with pytest.raises((TypeError, ValueError), match=problem):
        next(load_parts(tmp_path, **options)) if options in READ_FIRST else load_parts(tmp_path, **options)


@pytest.mark.parametrize("kind", ["column", "array", "folder"])
def test_sessions_that_are_not_read_are_named_by_the_check(tmp_path, kind):
    days, rng = ["mon", "mon", "tue", "tue"], np.random.default_rng(0)
    if kind == "folder":
        tree(tmp_path, *(f"{day}/{name}.csv" for day in days[::2] for name in ("rice", "peas")))
        given, rule = {"label": "file"}, "folder"
    elif kind == "column":
        rows = [f"{i},{'ab'[i % 2]},{days[i]},{k / 100},1,2,3,4,5,{k}" for i in range(4) for k in range(3)]
        write(tmp_path / "long.csv", f"trial,material,date,{HEADER}", rows)
        given, rule = {}, "column:date"
    else:
        X = rng.normal(size=(4, 9, 6))
        np.savez(tmp_path / "a.npz", X=X, y=list("abab"), fs=500, day=days)
        given, rule = {}, "column:day"
    way = f"(data convert --session {rule})"
    by_file = load(tmp_path, **given, session="file")
    for data in (load(tmp_path, **given), by_file):
        (finding,) = [
            one for one in data.check() if one.code in ("no-session", "one-session", "own-sessions")
        ]
        assert way in finding.message
    assert sorted(load(tmp_path, **given, session=rule).sessions) == days
    copy = load(save(load(tmp_path, **given), tmp_path / "x.npz"))
    assert any(way in one.message for one in copy.check())
