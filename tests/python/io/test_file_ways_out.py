"""Each refusal of a text table names what reads it: what is printed is followed, and gives the samples."""

import shlex

import numpy as np
import pandas as pd
import pytest

from granular_id.io import RecordingFileError, load
from layouts_written import WRITERS, written
from remedies import lines_of, options_of, refusal, run

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
W = np.round(np.random.default_rng(11).normal(size=(60, 6)), 4)
POUND, INCH_POUND = 4.4482216152605, 0.1129848290276167
RATE = 500


def table(wrench=W, names=("time", *AXES), scale=1.0, **columns):
    frame = pd.DataFrame(
        {names[0]: np.arange(len(wrench)) / RATE, **dict(zip(names[1:], (wrench * scale).T, strict=True))}
    )
    return frame.assign(**columns)


def lines(frame):
    return frame.to_csv(index=False, float_format="%.10f").splitlines()


def named(time, force, torque):
    return [time, *(kind.format(axis) for kind in (force, torque) for axis in "xyz")]


def with_cell(row, column, value, scale=1.0, wrench=W):
    frame = table(wrench, scale=scale).astype(object)
    frame.loc[row, column] = value
    return lines(frame)


def write_lines(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*text, ""]))


def with_line_2(line, text):
    return [text[0], line, *text[1:]]


def labview(comma="."):
    rows = [
        "\t".join(f"{value:.4f}".replace(".", comma) for value in (i / RATE, *row)) for i, row in enumerate(W)
    ]
    head = ["LabVIEW Measurement", "Separator\tTab", "***End_of_Header***", ""]
    return [*head, "Channels\t6", "***End_of_Header***", "X_Value\tFx\tFy\tFz\tTx\tTy\tTz\tComment", *rows]


def labview_again():
    whole = labview()
    return [*whole[:30], *whole[3:7], *whole[30:]]


def maker(torques="in-lb", scale=1 / INCH_POUND):
    above = ["Start Time: 3/4/25 2:03 PM", "Force Units: N", f"Torque Units: {torques}"]
    readings = np.round(W * [1, 1, 1, *[scale] * 3], 8)
    times = [f"Mar 4, 2025 2:03:1{i // 60} PM" for i in range(len(W))]
    rows = [
        ",".join(f'"{cell}"' for cell in ("0x0", *row, time))
        for row, time in zip(readings, times, strict=True)
    ]
    return [*above, "Status, Fx, Fy, Fz, Tx, Ty, Tz, Time", *rows]


def with_points(i, row):
    cells = [f"{value:,.6f}".translate(str.maketrans(",.", ".,")) for value in row]
    return ";".join([f"{i / RATE}".replace(".", ","), *cells])


def in_tabs(text):
    return [line.replace(",", "\t") for line in text]


def in_semicolons(text):
    return [line.replace(",", ";").replace(".", ",") for line in text]


NAMES = ["time", *AXES]
IN_MILLI = ["time", *(f"{axis} [mN{' m' * (axis[0] == 't')}]" for axis in AXES)]
IN_POINTS = [f"1.{stamp - 1000:03d}" if stamp > 999 else stamp for stamp in range(960, 1080, 2)]
ROWS = [line.partition(";")[2] for line in in_semicolons(lines(table()))[1:]]
IN_NMM = lines(table(scale=[1, 1, 1, 1e3, 1e3, 1e3]))
IN_MN = ["Y_Unit_Label", *["mN"] * 3, *["N mm"] * 3]
IN_POUNDS = [1 / POUND] * 3 + [1 / INCH_POUND] * 3
STATED = {"UNITS": "lbf,in-lb"}
CASES = {
    # what is in the file, samples that are lost, what a placeholder stands for
    "LabVIEW": (labview(), [], {}),
    "LabVIEW with commas": (labview(","), [], {}),
    "LabVIEW with headers in the middle": (labview_again(), [], {}),
    "units of LabVIEW and a cell of text": (["\t".join(IN_MN), *in_tabs(with_cell(7, "fz", "OVER", 1000))], [7], {}),
    "a cell of text among decimal commas": (in_semicolons(with_cell(7, "fz", "OVER")), [7], {}),
    "a maker's export": (maker(), [], {}),
    "German titles with units": (["Einheit Kraft;N", "Einheit Drehmoment;Nmm", "", *in_semicolons(IN_NMM)], [], {}),
    "names again in the middle": ([*lines(table())[:30], ",".join(["time", *AXES]), *lines(table())[30:]], [], {}),
    "a title above": (["Rig 3, gain 2", *lines(table())], [], {}),
    "a cell of text": (with_cell(7, "fz", "OVERLOAD"), [7], {}),
    "a cell that is empty": (with_cell(7, "fz", np.nan), [7], {}),
    "a cell of inf": (with_cell(7, "fz", "inf"), [7], {}),
    "rows of a text": (with_cell(7, AXES, "ERR"), [7], {}),
    "pounds below the names": (with_line_2("s,lb,lb,lb,in-lb,in-lb,in-lb", lines(table(scale=IN_POUNDS))), [], STATED),
    "pounds in the names": (lines(table(names=named("t [s]", "F{} [lb]", "M{} [in-lb]"), scale=IN_POUNDS)), [], STATED),
    "names of another language": (lines(table(names=named("Zeit [s]", "Kraft {} [N]", "Dreh {} [N m]"))), [], {}),
    "words for forces only": (lines(table(names=named("Cas", "Sila {}", "Moment {}"))), [], {}),
    "no names": (lines(table())[1:], [], {}),
    "packets of four": (lines(table(time=np.arange(60) // 4 * 4 / RATE)), [], {}),
    "no clock": (lines(table()[AXES]), [], {}),
    "points between thousands": ([";".join(IN_MILLI), *map(with_points, range(60), 1000 * W)], [], {}),
    "points between thousands of stamps": (
        ["time [ms];" + ";".join(AXES), *(f"{stamp};{row}" for stamp, row in zip(IN_POINTS, ROWS, strict=True))],
        [],
        {},
    ),
    "a unit in a name behind a word": (
        lines(table(names=[*NAMES[:4], *(f"{axis} [Nmm] raw" for axis in NAMES[4:])], scale=[1, 1, 1, *[1e3] * 3])),
        [],
        {"UNITS": "N,N mm"},
    ),
    "a sentence about units": (["# torques in Nmm", *IN_NMM], [], {"UNITS": "N,N mm"}),
    "a unit below the rows": ([*IN_NMM, "Torque Unit;Nmm"], [], {"UNITS": "N,N mm"}),
    "a column of units": (lines(table(scale=[1, 1, 1, *[1e3] * 3], torque_unit="Nmm")), [], {}),
    "a weight above": (["# tool weight: 2 lb", *lines(table())], [], {}),
    "a mean below": ([*lines(table()), ",,,,,,", ",1,2,3,4,5,6"], [], {}),
    "a reading a row": (lines(table().melt("time", var_name="kind")), [], {}),
    "ticks of .NET": (lines(table(time=638766801400000000 + np.arange(60) * 20000)), [], {}),
    "days of Excel": (lines(table(time=45600 + np.arange(60) / RATE / 86400)), [], {}),
    "more cells than names": ([lines(table())[0], *(f"{line},5,pm" for line in lines(table())[1:])], [], {}),
}  # fmt: skip


def ways(path, placeholders):
    """Yield what each way out gives, followed until nothing is refused, and how often something was."""
    waiting = [({}, 1)]
    for options, n in waiting:
        problem = refusal(path, **options)
        yield from ((run(line, RATE), n) for line in lines_of(problem) if line)
        for way in options_of(path, RATE, **options):
            csv = {**options.get("csv", {}), **way.get("csv", {})}
            more = {name: placeholders.get(str(value), value) for name, value in way.items()}
            merged = {**options, **more, **({"csv": csv} if csv else {})}
            try:
                yield load(path, **merged), n
            except ValueError:
                waiting.append((merged, n + 1))


@pytest.mark.parametrize("case", CASES)
def test_what_a_refusal_prints_reads_the_file(tmp_path, case):
    text, lost, placeholders = CASES[case]
    write_lines(tmp_path / "rice" / "push_1.txt", text)
    for data, n in ways(tmp_path, placeholders):
        wanted = np.delete(W, lost, axis=0)
        if [one.label for one in data] == ["rice"] and data[0].wrench.shape == wanted.shape:
            np.testing.assert_allclose(data[0].wrench, wanted, atol=1e-6)
            assert n == 1
            return
    pytest.fail("no way out reads the file")


MATERIALS = ["rice", "peas"] * 2


def long_table(**columns):
    """Four pushes below each other, each column a function of the number and the material of a push."""
    parts = [
        table(W + i).assign(**{key: value(i, name) for key, value in columns.items()})
        for i, name in enumerate(MATERIALS)
    ]
    return pd.concat(parts, ignore_index=True)


def number(i, _):
    return i


def material(_, name):
    return name


def first_or_later_day(i, _):
    return f"2025-03-0{1 + i // 2}"


def time_of_day(i, _):
    return [f"09:1{9 - i}:00.{2 * k:03d}" for k in range(60)]


def with_pauses(i, _):
    return 10 * i + np.arange(60) / RATE


def test_commas_of_both_kinds_have_no_way_that_reads_other_columns(tmp_path):
    write_lines(
        tmp_path / "a.csv", [",".join(NAMES), *(line.replace(".", ",") for line in lines(table())[1:])]
    )
    with pytest.raises(RecordingFileError, match="wanted another separator") as caught:
        load(tmp_path / "a.csv")
    assert not caught.value.ways


@pytest.mark.parametrize("name", ["push", "trial_no", "Versuch"])
def test_runs_that_a_column_counts_are_not_one_recording(tmp_path, name):
    for label in ("rice", "peas"):
        runs = table(np.tile(W, (3, 1))).assign(**{name: np.repeat([1, 2, 3], 60)})
        write_lines(tmp_path / f"{label}.csv", lines(runs))
    of_runs, of_files = (load(tmp_path, **way) for way in options_of(tmp_path))
    assert of_runs.y.tolist() == ["peas"] * 3 + ["rice"] * 3
    assert of_files.y.tolist() == ["peas", "rice"]


@pytest.mark.parametrize("values", [[0, 1, 0], [0, 1, 1], [True, False, True], ["idle", "run", "idle"]])
def test_flags_are_no_runs(tmp_path, values):
    write_lines(tmp_path / "rice.csv", lines(table().assign(run=np.repeat(values, 20))))
    assert len(load(tmp_path)) == 1


def test_clocks_of_commas_that_begin_anew_have_no_points(tmp_path):
    stamps = np.r_[np.arange(2, 999, 2), np.arange(1, 61, 2)]
    rows = [f"{stamp},0;{';'.join(map(str, range(6)))}" for stamp in stamps]
    write_lines(tmp_path / "a.csv", [";".join(["time [ms]", *AXES]), *rows])
    with pytest.raises(RecordingFileError, match="time runs back") as caught:
        load(tmp_path / "a.csv", csv={"decimal": ","})
    assert all("csv" not in way for way in caught.value.ways)


def test_runs_of_a_material_in_a_column_are_read_as_one_where_stated(tmp_path):
    write_lines(tmp_path / "a.csv", lines(table().assign(run=np.repeat([1, 2], 30), material="rice")))
    of_runs, whole = (load(tmp_path / "a.csv", **way) for way in options_of(tmp_path / "a.csv"))
    assert (of_runs.y.tolist(), whole.y.tolist()) == (["rice"] * 2, ["rice"])


def test_files_in_an_encoding_of_their_own_are_read_in_it(tmp_path):
    text = "\n".join(lines(table(material="M\N{LATIN SMALL LETTER U WITH DIAERESIS}sli")))
    for name, encoding in (("a", "cp1252"), ("b", "utf-8")):
        (tmp_path / f"{name}.csv").write_bytes(text.encode(encoding))
    data = load(tmp_path, csv={"encoding": "cp1252"})
    assert data.labels == ("M\N{LATIN SMALL LETTER U WITH DIAERESIS}sli",)
    assert "is utf-8 text, and read as such, not as cp1252" in data.history[-1].notes


@pytest.mark.parametrize(
    "line", ["Sample Rate: 500", "Abtastrate;0.5 kHz", '"sampling_frequency","500","Hz"']
)
def test_a_rate_above_the_names_is_in_the_way_out(tmp_path, line):
    write_lines(tmp_path / "a.csv", [line, *lines(table()[AXES])])
    assert options_of(tmp_path / "a.csv") == [{"csv": {"skiprows": 1}, "rate_hz": 500}]


@pytest.mark.parametrize("line", ["Abtastrate: 1.000 Hz", "Filter frequency: 23 Hz", "frequency: 23"])
def test_rates_that_may_be_others_are_not_in_the_way_out(tmp_path, line):
    write_lines(tmp_path / "a.csv", [line, *lines(table()[AXES])])
    with pytest.raises(RecordingFileError, match="rate_hz=RATE"):
        load(tmp_path / "a.csv", csv={"skiprows": 1})


def test_names_again_ahead_of_each_recording_have_a_line(tmp_path):
    one = lines(table())
    write_lines(tmp_path / "rice.csv", [*one, *one])
    write_lines(tmp_path / "peas.csv", [*one, *one])
    data = run(lines_of(refusal(tmp_path))[0])
    assert (data.y.tolist(), {one.n_samples for one in data}) == (["peas"] * 2 + ["rice"] * 2, {60})


def test_rows_counted_anew_are_several_recordings(tmp_path):
    parts = [table()[AXES].assign(N=np.arange(1, 61)) for _ in range(3)]
    pd.concat(parts).to_csv(tmp_path / "rice.csv", index=False)
    table()[AXES].assign(N=np.arange(1, 61)).to_csv(tmp_path / "peas.csv", index=False)
    data = run(lines_of(refusal(tmp_path, rate_hz=RATE))[0])
    assert data.y.tolist() == ["peas", "rice", "rice", "rice"]


def test_counters_that_overflow_count_one_recording(tmp_path):
    rows = table(np.tile(W, (10, 1)))[AXES].assign(status_count=np.arange(600) % 256)
    write_lines(tmp_path / "a.csv", lines(rows))
    assert load(tmp_path / "a.csv", rate_hz=RATE)[0].n_samples == 600


def test_texts_of_a_long_table_are_the_labels_in_its_line(tmp_path):
    parts = [table(aine=name) for name in ("riisi", "kaura", "riisi")]
    pd.concat(parts).to_csv(tmp_path / "a.csv", index=False)
    data = run(lines_of(refusal(tmp_path / "a.csv"))[0])
    assert data.y.tolist() == ["riisi", "kaura", "riisi"]


LONG = {
    "push number and material": {"push": number, "stuff": material},
    "runs counted anew": {"run": lambda i, _: i // 2, "material": material},
    "nothing but the material": {"material": material},
    "names of files": {"file": lambda i, name: f"{name}_{i}.csv"},
    "trial and material": {"trial": number, "powder": material},
    "trials counted anew each day": {"day": first_or_later_day, "material": material, "trial": lambda *_: 1},
    "one clock": {"Versuch": number, "Stoff": material, "time": with_pauses},
    "nothing but the material and a clock": {"material": material, "time": with_pauses},
    "times of the day": {"Versuch": number, "Stoff": material, "time": time_of_day},
    "days of several pushes": {"date": lambda i, _: "ab"[i // 2], "material": lambda *_: "rice"},
    "trials of names": {"trial": lambda i, name: f"{name}_{i}"},
    "person and material": {
        "no": number,
        "operator": lambda i, _: ("anna", "bert")[i // 2],
        "powder": material,
    },
    "trials counted anew of each material": {
        "trial": lambda *_: 1,
        "quality": lambda *_: "ok",
        "material": material,
    },
    "ids of two words counted anew": {"Recording ID": lambda *_: 1, "material": material},
    "trials counted anew and one clock": {
        "trial": lambda *_: 1,
        "material": material,
        "time": with_pauses,
    },
    "material as a number": {"trial": number, "class_id": lambda _, name: ("rice", "peas").index(name)},
}


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("case", LONG)
def test_what_a_long_table_prints_gives_recordings_and_labels(tmp_path, case, ending, alone):
    whole, path = long_table(**LONG[case]), tmp_path / f"all.{ending}"
    whole.to_csv(path, index=False) if ending == "csv" else whole.to_parquet(path)
    data, n = next(ways(path if alone else tmp_path, {}))
    known = {"material as a number": ["0", "1"] * 2, "days of several pushes": ["rice"] * 4}.get(
        case, MATERIALS
    )
    assert (data.y.tolist(), n) == (known, 1)
    np.testing.assert_allclose(data.X, [W + i for i in range(4)], atol=1e-9)


def test_a_file_with_five_faults_names_the_label_too(tmp_path):
    names = {"rice": "Grieß", "peas": "Reis"}
    whole = long_table(Versuch=number, Schüttgut=lambda _, name: names[name]).rename(columns={"time": "Zeit"})
    rows = in_semicolons(whole.to_csv(index=False).splitlines())
    (tmp_path / "all.csv").write_text("\n".join(["Versuchsreihe;A", *rows, ""]), encoding="cp1252")
    data, n = next(ways(tmp_path, {}))
    assert (data.y.tolist(), n) == (["Grieß", "Reis"] * 2, 1)


def test_a_stated_label_needs_the_id_that_is_named(tmp_path):
    path, labels = tmp_path / "all.csv", ["rice", "rice", "oats", "rice"]
    long_table(Versuch=number, Stoff=lambda i, _: labels[i], time=with_pauses).to_csv(path, index=False)
    (way,) = options_of(path, label="column:Stoff")
    assert load(path, label="column:Stoff", **way).y.tolist() == labels


def test_several_columns_that_may_be_labels_are_all_offered(tmp_path):
    columns = {"trial": number, "day": first_or_later_day, "powder": material}
    long_table(**columns).to_csv(tmp_path / "all.csv", index=False)
    assert [way["label"] for way in options_of(tmp_path)] == ["column:powder", "column:day", "file"]
    assert load(tmp_path, label="file").labels == ("all",)


@pytest.mark.parametrize(("column", "first"), [("rig", "file"), ("powder", "column:powder"), ("label", None)])
def test_a_column_against_names_of_files_has_both_ways(tmp_path, column, first):
    texts = ["oats", "salt", "barley"] if column in ("powder", "label") else ["a", "b"]
    for name in ("rice", "peas"):
        whole = pd.concat([table(W + i).assign(trial=i, **{column: texts[i % len(texts)]}) for i in range(6)])
        whole.to_csv(tmp_path / f"{name}.csv", index=False)
    if first is None:
        assert load(tmp_path).labels == ("barley", "oats", "salt")
        return
    ways = [way["label"] for way in options_of(tmp_path)]
    assert (ways[0], set(ways)) == (first, {"file", f"column:{column}"})
    assert load(tmp_path, label="file").y.tolist() == ["peas"] * 6 + ["rice"] * 6


@pytest.mark.parametrize("name", ["rec_{i}", "push_a{i}", "day1/{i}", "a/b/{i}"])
def test_a_column_of_labels_wins_over_places_when_mended(tmp_path, name):
    for i, material in enumerate(MATERIALS):
        head, *rows = with_cell(7, "fz", "OVERLOAD")
        write_lines(
            tmp_path / f"{name.format(i=i)}.csv", [f"{head},material", *(f"{row},{material}" for row in rows)]
        )
    assert run(*lines_of(refusal(tmp_path))).y.tolist() == MATERIALS


@pytest.mark.parametrize("form", ["csv", *WRITERS])
def test_a_text_beside_each_recording_may_be_its_label(tmp_path, form):
    for i, powder in enumerate(MATERIALS):
        if form == "csv":
            table().assign(powder=powder, sensor="ATI").to_csv(tmp_path / f"rec_{i}.csv", index=False)
        else:
            written({"wrench": W, "powder": powder, "sensor": "ATI", "fs": RATE}, form, tmp_path, f"rec_{i}")
    assert [way["label"] for way in options_of(tmp_path)] == ["column:powder", "file"]
    assert load(tmp_path, label="column:powder").y.tolist() == MATERIALS


PARTS = {
    "axes first": lambda w: {"ft": w.T},
    "forces and torques": lambda w: {"force": w[:, :3], "torque": w[:, 3:]},
    "vectors": lambda w: dict(zip(AXES, w.T, strict=True)),
    "a cell without a number": lambda w: {"X": np.where(np.arange(360).reshape(60, 6) == 8, np.nan, w)},
}
LAYOUTS = ["{name}_{i}", "{name}_run0{i}", "{name}/{i}", "{name}/2025-03-0{i}/1", "2025-03-0{i}/{name}/1"]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(
    ("form", "part"), [("csv", "a cell of text"), *((form, part) for form in WRITERS for part in PARTS)]
)
def test_one_file_a_recording_is_read_with_all_like_it(tmp_path, form, part, layout):
    wanted = {}
    for k, (name, i) in enumerate((name, i) for name in ("peas", "rice") for i in (1, 2)):
        place = layout.format(name=name, i=i)
        if form == "csv":
            write_lines(tmp_path / f"{place}.csv", with_cell(7, "fz", "OVERLOAD", wrench=W + k))
        else:
            written({**PARTS[part](W + k), "fs": RATE}, form, tmp_path, place)
        wanted[W[20, 0] + k] = name
    data = run(lines_of(refusal(tmp_path))[0])
    at = 19 if "cell" in part else 20  # the sample that is left out stands before
    assert {one.wrench[at, 0]: one.label for one in data} == wanted
    assert len(set(data.sessions)) == (2 if "2025" in layout else 1)


def test_all_that_an_export_wants_is_named_at_once(tmp_path):
    for name in ("rice", "peas"):
        write_lines(tmp_path / name / "day 1" / "push_1.csv", maker("N-mm", 1000))
    problem = refusal(tmp_path)
    in_all = [
        clause.partition("(")[2].rstrip(")")
        for clause in problem.partition("; in all pass ")[2].split(" or ")
    ]
    assert [shlex.split(one) for one in in_all] == [
        ["--csv", "skiprows=3", "--recorded-hz", "RATE", "--label", label, "--session", session]
        for label, session in (("parent", "folder"), ("folder", "parent"))
    ]
    data = load(tmp_path, csv={"skiprows": 3}, rate_hz=RATE, label="parent", session="folder")
    assert (data.labels, data.X.shape) == (("peas", "rice"), (2, 60, 6))


@pytest.mark.parametrize("names", ["rice/1 rice/2 peas/wet/1", "lab/rice/a/1 lab/peas/b/1"])
def test_index_is_written_of_first_folders(tmp_path, names):
    for name in names.split():
        write_lines(tmp_path / f"{name}.csv", lines(table()))
    data = run(*lines_of(refusal(tmp_path)))
    assert sorted(data.y) == sorted(name.partition("/")[0] for name in names.split())


def test_workbooks_have_the_line_of_pandas(tmp_path, monkeypatch):
    monkeypatch.setattr(pd, "read_excel", pd.read_csv)
    for name in ("rice", "peas"):
        write_lines(tmp_path / name / "1.xlsx", lines(table()))
    data = run(*lines_of(refusal(tmp_path)))
    assert (data.labels, data.rate_hz) == (("peas", "rice"), RATE)


def test_recordings_beside_each_other_are_taken_apart(tmp_path):
    parts = [table(W + i).set_index("time").add_prefix(f"{name}_{i}_") for i, name in enumerate(MATERIALS)]
    pd.concat(parts, axis=1).to_csv(tmp_path / "all.csv")
    data = run(lines_of(refusal(tmp_path / "all.csv"))[0])
    assert data.y.tolist() == MATERIALS
    np.testing.assert_allclose(data.X, [W + i for i in range(4)], atol=1e-9)


LISTS = {
    "another name": ("labels.csv", "recording,material", "{day}/{i}.csv,{name}"),
    "names without ending": ("metadata.csv", "name,material,day", "{day}/{i},{name},{day}"),
}


@pytest.mark.parametrize("case", LISTS)
def test_a_list_of_files_under_another_name_is_used(tmp_path, case):
    name, head, line = LISTS[case]
    rows = []
    for i, material_ in enumerate(MATERIALS):
        write_lines(tmp_path / f"2025-03-0{1 + i % 2}" / f"{i}.csv", lines(table(W + i)))
        rows.append(line.format(day=f"2025-03-0{1 + i % 2}", i=i, name=material_))
    write_lines(tmp_path / name, [head, *rows])
    data = run(lines_of(refusal(tmp_path))[0])
    assert {r.name[-5]: r.label for r in data} == dict(zip("0123", MATERIALS, strict=True))
    assert load(tmp_path).labels == ("peas", "rice")


def test_units_in_the_metadata_of_parquet_are_refused(tmp_path):
    frame = table(W, scale=[1, 1, 1, *[1e3] * 3])
    frame.attrs = {"torque_unit": "N mm"}
    frame.to_parquet(tmp_path / "rice.parquet")
    with pytest.raises(RecordingFileError, match="'torque_unit' states units"):
        load(tmp_path / "rice.parquet")
    (way,) = options_of(tmp_path / "rice.parquet")
    np.testing.assert_allclose(load(tmp_path / "rice.parquet", **way)[0].wrench, W, atol=1e-9)


@pytest.mark.parametrize("columns", ["force_unit,torque_unit", "units"])
def test_units_in_an_index_are_refused(tmp_path, columns):
    write_lines(tmp_path / "1.csv", lines(table(W, scale=1000)))
    cells = "mN,mN m" if columns != "units" else '"mN,mN m"'
    write_lines(tmp_path / "index.csv", [f"file,label,{columns}", f"1.csv,rice,{cells}"])
    (way,) = options_of(tmp_path)
    np.testing.assert_allclose(load(tmp_path, **way)[0].wrench, W, atol=1e-9)
