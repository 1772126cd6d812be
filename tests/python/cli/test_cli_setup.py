"""``granular-id setup`` and the steps of ``data convert`` that bring recordings into another set-up."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import granular_id as gid
from cli_cases import ended_well, refused, run, written
from granular_id.io import load, save
from granular_id.recording import Dataset, Payload, Recording
from granular_id.synthetic import simulate_rests

TRUE = Payload(0.306, (0.002, -0.003, 0.05), bias=(5, 42, 3, 0.78, -0.16, 0.11), frame="flange")
POSES = Rotation.random(6, random_state=4)
DOWN = POSES.inv().apply([0, 0, -1])


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("setup")


@pytest.fixture(scope="module")
def rests(place):
    """Six rests, whose metadata say where gravity points."""
    path = place / "rests.npz"
    save(simulate_rests(TRUE, DOWN, duration_s=1.0, rate_hz=100), path)
    return path


@pytest.fixture(scope="module")
def silent(rests, place):
    """The same rests, which do not say it."""
    path = place / "silent.npz"
    save(Dataset([replace(one, meta={"frame": "flange"}) for one in load(rests)]), path)
    return path


@pytest.fixture(scope="module")
def tool(rests, place):
    path = place / "tool.json"
    ended_well("setup", "payload", rests, "-o", path)
    return path


@pytest.fixture(scope="module")
def pushes(place):
    path = place / "pushes.npz"
    save(gid.synthesize(["rice", "fine sugar"], n_per_class=2, duration_s=0.6), path)
    return path


def table_of(path, columns, rows, names=None):
    with path.open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["name", *columns])
        lines.writerows([name, *row] for name, row in zip(names or RESTS, rows, strict=True))
    return path


RESTS = [f"rest_{i:02d}" for i in range(6)]
GRAVITY = ("gx", "gy", "gz")


# The tool's weight.


def test_a_payload_is_identified_from_what_metadata_say(rests, tool):
    assert Payload.load(tool) == Payload.fit(load(rests), gravity=DOWN)


def test_a_table_of_directions_states_the_same(silent, tool, tmp_path):
    poses = table_of(tmp_path / "poses.csv", GRAVITY, DOWN)
    ended_well("setup", "payload", silent, "-o", tmp_path / "t.json", "--gravity", poses)
    found, known = Payload.load(tmp_path / "t.json"), Payload.load(tool)
    np.testing.assert_allclose(found.bias, known.bias, rtol=1e-9)
    assert found.mass_kg == pytest.approx(known.mass_kg, rel=1e-9)


def test_payload_table_has_residual_and_condition_number(rests, tmp_path):
    out = ended_well("setup", "payload", rests, "-o", tmp_path / "t.json")
    assert re.search(r"mass +0\.30\d\d kg", out)
    assert re.search(r"centre of mass z +\d\d\.\d+ mm", out)
    assert re.search(r"zero of tz +0\.1\d* N m +[\d.e-]+ N m", out)
    assert "condition number" in out
    assert f"--compensate {tmp_path / 't.json'}" in out


def test_one_pose_is_refused_with_the_way_out(silent, tmp_path):
    line = refused("setup", "payload", silent, "-o", tmp_path / "t.json", "--gravity", "0,0,-1")
    assert "mass and bias cannot be told apart" in line
    assert "only a tare is possible" in line
    assert not (tmp_path / "t.json").exists()


@pytest.mark.parametrize(
    ("columns", "rows", "names", "told"),
    [
        (GRAVITY, DOWN[:5], RESTS[:5], "--gravity has no line for the recording 'rest_05'"),
        (GRAVITY, DOWN, [*RESTS[:5], "rest_00"], "names 'rest_00' twice"),
        (("roll", "pitch", "yaw"), DOWN, RESTS, "must be x,y,z, or a CSV file with the columns"),
        (GRAVITY, 0 * DOWN, RESTS, "gravity holds a direction without length"),
        (GRAVITY, [["", 0, 1]] * 6, RESTS, "gravity of 'rest_00' must be three numbers"),
    ],
)
def test_poses_that_cannot_be_are_refused(silent, tmp_path, columns, rows, names, told):
    poses = table_of(tmp_path / "poses.csv", columns, rows, names)
    assert told in refused("setup", "payload", silent, "-o", tmp_path / "t.json", "--gravity", poses)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "recording 'rest_00' does not say where gravity points: add --gravity"),
        (("--gravity", "nowhere.csv"), "--gravity nowhere.csv: no such file"),
    ],
)
def test_what_states_no_pose_is_refused(silent, tmp_path, words, told):
    assert told in refused("setup", "payload", silent, "-o", tmp_path / "t.json", *words)


# Into another set-up.


def test_convert_takes_a_payload_off_and_turns(pushes, tool, tmp_path):
    words = ("--compensate", tool, "--gravity", "0,0,1", "--rotate", "0,0,90", "--translate", "0,0,0.1")
    ended_well("data", "convert", pushes, tmp_path / "there.npz", "--frame", "flange")
    ended_well("data", "convert", tmp_path / "there.npz", tmp_path / "new.npz", *words, "--frame", "tool")
    data, new = load(pushes), load(tmp_path / "new.npz")
    expected = data.transform(frame="flange").compensate(Payload.load(tool), [0, 0, 1])
    expected = expected.transform([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0, 0, 0.1], frame="tool")
    assert (new.X == expected.X).all()
    assert new[0].meta == expected[0].meta


def test_right_angles_there_and_back_change_no_bit(pushes, tmp_path):
    there, back = tmp_path / "there.npz", tmp_path / "back.npz"
    ended_well("data", "convert", pushes, there, "--rotate", "0,-90,0", "--frame", "turned")
    ended_well("data", "convert", there, back, "--rotate", "0,90,0", "--frame", "flange")
    assert (load(back).X == load(pushes).X).all()
    assert not (load(there).X == load(pushes).X).all()


def test_convert_changes_signs_and_names_them(pushes, tmp_path):
    words = ("--flip", "fx,fy,fz,tx,ty,tz", "--sign", "of the robot on the tool", "--rotate", "0,0,0,1")
    ended_well("data", "convert", pushes, tmp_path / "new.npz", *words, "--frame", "flange")
    new = load(tmp_path / "new.npz")
    assert (new.X == -load(pushes).X).all()
    assert (new[0].meta["sign"], new[0].meta["frame"]) == ("of the robot on the tool", "flange")


def test_convert_flips_the_axes_of_a_mirrored_driver(pushes, tmp_path):
    ended_well("data", "convert", pushes, tmp_path / "new.npz", "--flip", "fx,tx")
    assert load(tmp_path / "new.npz").X.tobytes() == load(pushes).transform(flip=("fx", "tx")).X.tobytes()


@pytest.mark.parametrize(
    "refused_in", [("evaluate", "{log}"), ("data", "convert", "{log}", "{new}", "--rate-hz", "50")]
)
def test_a_log_with_pauses_is_split_as_its_refusal_says(tmp_path, refused_in):
    log, new = tmp_path / "log.npz", tmp_path / "new.npz"
    times = np.concatenate([start + np.arange(60) / 100 for start in (0.0, 9.0, 20.0)])
    rng = np.random.default_rng(0)
    made = [Recording(rng.normal(size=(180, 6)), time_s=times, label=label, name=label) for label in "ab"]
    save(Dataset(made), log)
    line = refused(*(word.format(log=log, new=new) for word in refused_in))
    found = re.search(r"granular-id data convert (--split-gap-s) ([\d.]+)", line)
    ended_well("data", "convert", log, new, *found.groups())
    assert load(new).names == tuple(f"{label} @ {start} s" for label in "ab" for start in (0, 9, 20))
    assert load(new).rate_hz == 100


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--gravity", "0,0,1"), "add --compensate"),
        (("--rotate", "0,0,90"), "--rotate makes another frame: add --frame"),
        (("--flip", "fx,fw"), "wanted a sequence of axes"),
        (("--flip", "fx,fy,fz,tx,ty,tz"), "sign"),
        (("--sign", "robot"), "sign"),
        (("--rotate", "90", "--frame", "f"), "--rotate must be roll,pitch,yaw in degrees or a quaternion"),
        (("--rotate", "0,0,0,2", "--frame", "f"), "quaternion of length 2"),
        (("--translate", "0,1", "--frame", "f"), "--translate must be x,y,z in m"),
        (("--translate", "0,0,50", "--frame", "f"), "--translate must be x,y,z in m, less than 10"),
        (("--compensate", "nowhere.json"), "nowhere.json: no such file"),
        (("--compensate", "PUSHES", "--gravity", "0,0,1"), "pushes.npz: no payload"),
        (("--compensate", "TOOL", "--gravity", "down"), "--gravity must be x,y,z, or a CSV file"),
        (("--compensate", "TOOL"), "does not say where gravity points"),
        (("--compensate", "TOOL", "--gravity", "0,0,1"), "the payload of 'flange'"),
    ],
)
def test_convert_refuses_what_says_too_little(pushes, tool, tmp_path, words, told):
    words = [{"TOOL": tool, "PUSHES": pushes}.get(word, word) for word in words]
    assert told in refused("data", "convert", pushes, tmp_path / "new.npz", *words)
    assert not (tmp_path / "new.npz").exists()


def test_a_payload_is_not_taken_off_recordings_of_another_sign(pushes, tool, tmp_path):
    reversed_ = tmp_path / "reversed.npz"
    ended_well(
        "data",
        "convert",
        pushes,
        reversed_,
        "--flip",
        "fx,fy,fz,tx,ty,tz",
        "--sign",
        "robot on tool",
        "--frame",
        "flange",
    )
    words = (
        "--compensate",
        tool,
        "--gravity",
        "0,0,1",
        "--flip",
        "fx,fy,fz,tx,ty,tz",
        "--sign",
        "load",
        "--frame",
        "flange",
    )
    line = refused("data", "convert", reversed_, tmp_path / "new.npz", *words)
    assert "is of the sign 'robot on tool', the payload of 'load of the tool" in line
    assert not (tmp_path / "new.npz").exists()


def test_what_is_turned_already_is_not_turned_again(pushes, tmp_path):
    flange = tmp_path / "flange.npz"
    ended_well("data", "convert", pushes, flange, "--frame", "flange")
    words = ("data", "convert", flange, tmp_path / "new.npz", "--frame", "flange")
    assert "frame is 'flange' already" in refused(*words, "--rotate", "0,0,-90")
    assert "sign is 'load of the tool" in refused(
        *words, "--flip", "fx,fy,fz,tx,ty,tz", "--sign", load(pushes)[0].meta["sign"]
    )


def test_a_missing_onset_is_said_in_options(tmp_path):
    silent = [Recording(np.zeros((500, 6)), rate_hz=500, name=f"r{i}") for i in range(2)]
    save(Dataset(silent), tmp_path / "silent.npz")
    words = ("setup", "tare", tmp_path / "silent.npz", "-o", tmp_path / "t.npz", "--begin-at", "onset")
    line = refused(*words)
    assert "no onset in 2 of 2 recordings" in line
    assert "--begin-at" not in line


# The zero.


def test_tare_writes_what_the_step_makes(pushes, tmp_path):
    out = ended_well("setup", "tare", pushes, "-o", tmp_path / "tared.npz", "--lead-s", 0.1)
    assert load(tmp_path / "tared.npz") == load(pushes).tare(lead_s=0.1)
    assert "Zeros taken off" in out


def test_a_rest_may_end_at_the_onset(pushes, tmp_path):
    path = tmp_path / "untriggered.npz"
    save(Dataset([replace(one, trigger_index=None) for one in load(pushes)]), path)
    line = refused("setup", "tare", path, "-o", tmp_path / "t.npz")
    assert "add --begin-at onset" in line
    ended_well("setup", "tare", path, "-o", tmp_path / "t.npz", "--begin-at", "onset", "--lead-s", 0.05)
    assert load(tmp_path / "t.npz")[0].meta["tare"] == "rest"


def test_recordings_without_rest_may_be_left_out(pushes, tmp_path):
    first, *others = load(pushes)
    save(Dataset([replace(first, trigger_index=20), *others]), tmp_path / "one_short.npz")
    words = ("setup", "tare", tmp_path / "one_short.npz", "--lead-s", 0.1, "--on-short", "skip", "-o")
    out = ended_well(*words, tmp_path / "t.npz")
    assert f"left out 1 recording without 0.1 s of rest before the motion, the first is {first.name!r}" in out
    assert list(load(tmp_path / "t.npz").names) == [one.name for one in others]
    assert "none of 4 recordings has 9 s of rest" in refused(*words, tmp_path / "u.npz", "--lead-s", 9)


def test_a_rest_of_a_quarter_second_is_the_default(tmp_path):
    noise = np.random.default_rng(0).normal(0, 1, (300, 6))
    data = Dataset([Recording(noise, rate_hz=500, trigger_index=200)])
    save(data, tmp_path / "d.npz")
    ended_well("setup", "tare", tmp_path / "d.npz", "-o", tmp_path / "t.npz")
    assert (load(tmp_path / "t.npz").X == data.tare().X).all()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--lead-s", 0), "--lead-s must be positive"),
        (("--lead-s", 9), "9 s are wanted"),
        (("--onset-at", "rice_00=0.1"), "add --begin-at onset"),
        (("--to", "xls"), "--to xls; wanted one of csv"),
    ],
)
def test_tare_refuses(pushes, tmp_path, words, told):
    assert told in refused("setup", "tare", pushes, "-o", tmp_path / "t.npz", *words)


# What is compared.


def with_meta(path, target, **meta):
    save(Dataset([replace(one, meta=meta) for one in load(path)]), target)
    return target


@pytest.fixture(scope="module")
def trained(pushes, place):
    data = with_meta(pushes, place / "plain.npz", frame="flange", tool="cylinder")
    path = place / "m.safetensors"
    gid.Identifier.fit(load(data).align(n_samples=200), "hfmh", estimate=False).save(path)
    return path


def lines_of(*words):
    """Thing -> what is said of it."""
    out = ended_well("setup", "show", *words)
    return dict(re.findall(r"^(\w+) {2,}(.*?) *$", out, re.M)), out


def test_show_says_all_of_recordings_and_where_they_differ(pushes, tmp_path):
    data = load(pushes)
    tools = [replace(one, meta={"tool": "spoon" if k else "fork"}) for k, one in enumerate(data)]
    save(Dataset(tools), tmp_path / "two.npz")
    told, _ = lines_of(tmp_path / "two.npz")
    assert told["tool"] == "spoon (3), fork (1)"
    assert told["rate"] == "500 Hz"
    assert told["tare"] == "not stated"
    assert len(told) == 17


def test_show_reads_models(trained):
    told, out = lines_of(trained)
    assert (told["frame"], told["tool"], told["sign"]) == ("flange", "cylinder", "not stated")
    assert told["axes"] == "fx fy fz (N), tx ty tz (N m)"
    assert "model of 2 materials" in out


@pytest.mark.parametrize("swapped", [False, True])
def test_show_says_what_follows(trained, pushes, tmp_path, swapped):
    now = with_meta(pushes, tmp_path / "now.npz", frame="table", tool="cylinder", tare="rest")
    told, out = lines_of(*((now, trained) if swapped else (trained, now)))
    assert told["frame"].split() == ["refused", "flange", "table"]
    assert told["tool"].split() == ["fine", "cylinder", "the", "same"]
    assert told["tare"].split() == ["warning", "not", "stated", "rest"]
    assert "refused: frame" in out
    assert "--accept frame" in out
    assert "tare: take the rest before the motion off both" in out


@pytest.mark.parametrize("name", ["frame", "tool"])
def test_show_says_what_identify_does(trained, pushes, tmp_path, name):
    now = with_meta(pushes, tmp_path / "now.npz", **{"frame": "flange", "tool": "cylinder", name: "another"})
    told, _ = lines_of(trained, now)
    ran = run("identify", trained, now, "--begin-at", "first")
    assert (ran.exit_code == 2) is told[name].startswith("refused")
    assert f"{name} 'another'" in " ".join(ran.output.split())


def test_show_compares_rates_and_axes(trained, pushes, tmp_path):
    slower = load(pushes).resample(100).select(axes=["tx", "ty", "tz", "fx", "fy", "fz"])
    save(slower, tmp_path / "slow.npz")
    told, out = lines_of(trained, tmp_path / "slow.npz", "--axes", "tx,ty,tz,fx,fy,fz")
    assert told["rate"].startswith("refused")
    assert told["axes"].startswith("refused")
    assert "rate: resample with --rate-hz" in out


def test_data_check_says_where_recordings_differ(pushes, tmp_path):
    data = load(pushes)
    save(Dataset([*data[:2], *data[2:].tare(lead_s=0.1)]), tmp_path / "half.npz")
    out = ended_well("data", "check", tmp_path / "half.npz", "--json", tmp_path / "c.json")
    told = "warning: recordings differ in their tare: 'rest', not stated"
    assert told in out
    assert told in written(tmp_path / "c.json")["setup"][0]
    assert run("data", "check", tmp_path / "half.npz", "--strict").exit_code == 3
