"""``rona calibrate hand-eye``: files in pairs, one table, times; what it prints and draws."""

import json
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.steps.tool.hand_eye_report import HandEyeOptions, report_hand_eye
from rona_core.errors import InvalidInputError
from rona_ui.cli import main
from tests.core.calibration.hand_eye.test_recorded_hand_eye import SENSOR, made
from tests.helpers.pivot_data import matrices

ROBOT, SEEN = made(30)
IN_HAND = made(31, "eye-in-hand")


def table(poses, digits=6, times=None, metres=False):
    m = matrices(poses)
    m[:, :3, 3] *= 0.001 if metres else 1.0
    rows = m.reshape(-1, 16)
    if times is not None:
        rows = np.column_stack((times, rows))
    return "\n".join(",".join(f"{v:.{digits}f}" for v in row) for row in rows)


@pytest.fixture
def files(tmp_path):
    def write(**texts):
        for name, words in texts.items():
            (tmp_path / f"{name}.csv").write_text(words)
        return [str(tmp_path / f"{name}.csv") for name in texts]

    return write


def asked(capsys, *arguments, status=0):
    assert main(["calibrate", "hand-eye", *arguments, "--json"]) == status
    return json.loads(capsys.readouterr().out)


def test_two_files_with_six_decimals(files, capsys):
    found = asked(capsys, *files(a=table(ROBOT), b=table(SEEN)))
    sensor = np.array(found["sensor"]["matrix"])
    np.testing.assert_allclose(sensor[:3, 3], SENSOR["eye-to-hand"].translation, atol=1.0)
    assert (found["sensor_in"], found["marker_in"], found["verdict"]) == ("base", "tip", "good")
    assert np.shape(found["covariance"]) == (12, 12)
    assert found["left_out_rms_mm"] > found["rms_mm"] > 0.0
    assert len(found["worst"]) == 5
    assert found["next_pose"]["sigma_mm"] < found["sigma_mm"]
    assert found["notes"] == ["Rotations were off by up to 1e-06 and were made orthogonal."]


def test_one_table_of_both_and_a_sensor_on_the_robot(files, capsys):
    robot, seen = IN_HAND
    both = [f"{a},{b}" for a, b in zip(table(robot).split(), table(seen).split(), strict=True)]
    options = "--setup", "eye-in-hand", "--noise", "camera"
    found = asked(capsys, *files(a="\n".join(both)), *options)
    assert (found["sensor_in"], found["noise"]) == ("tip", "camera")
    place = found["sensor"]["translation_mm"]
    np.testing.assert_allclose(place, SENSOR["eye-in-hand"].translation, atol=1.0)
    two = asked(capsys, *files(a=table(robot), b=table(seen)), *options)
    assert two["sensor"] == found["sensor"]


def test_rows_are_paired_by_time_where_the_files_differ_in_length(files, capsys):
    keep = np.array([0, 1, 2, 4, 5, 6, 7, 9, 10, 11, 12, 13, 15, 18, 19, 20, 21, 23])
    t = 10.0 + 2.0 * np.arange(24)
    found = asked(
        capsys, *files(a=table(ROBOT, 9, t), b=table(SEEN.select(keep), 9, t[keep] + 0.01))
    )
    assert found["n_used"] == len(keep)
    assert found["notes"] == ["18 pairs were found by their times."]
    straight = asked(capsys, *files(a=table(ROBOT.select(keep), 9), b=table(SEEN.select(keep), 9)))
    assert found["sensor"] == straight["sensor"]
    given = files(a=table(ROBOT), b=table(SEEN.select(keep)))
    assert main(["calibrate", "hand-eye", *given]) == 2
    assert "24 poses and" in capsys.readouterr().err


def test_units_and_inverses_are_said_and_asked_for(files, capsys):
    given = files(a=table(ROBOT, 9, metres=True), b=table(SEEN, 9))
    assert main(["calibrate", "hand-eye", *given]) == 2
    assert "look like metres" in capsys.readouterr().err
    found = asked(capsys, *given, "--unit", "m,mm")
    assert found["notes"] == ["Positions in m were made mm."]
    inverse = files(a=table(ROBOT.inv(), 9), b=table(SEEN, 9))
    assert main(["calibrate", "hand-eye", *inverse]) == 2
    assert "--inverse robot" in capsys.readouterr().err
    again = asked(capsys, *inverse, "--inverse", "robot")
    np.testing.assert_allclose(
        again["sensor"]["translation_mm"], found["sensor"]["translation_mm"], atol=1e-3
    )
    assert main(["calibrate", "hand-eye", *given, "--unit", "km"]) == 2
    assert "mm, cm or m" in capsys.readouterr().err


@pytest.mark.parametrize(("form", "start"), [("svg", b"<?xml"), ("png", b"\x89PNG")])
def test_the_table_and_the_picture(files, capsys, tmp_path, form, start):
    picture = tmp_path / f"a.{form}"
    given = files(a=table(ROBOT), b=table(SEEN))
    assert main(["calibrate", "hand-eye", *given, "--picture", str(picture)]) == 0
    out = capsys.readouterr().out
    for words in ("Sensor in base", "poses left out", "Worst poses", "Next pose: turn the tool"):
        assert words in out
    assert picture.read_bytes().startswith(start)
    assert main(["calibrate", "hand-eye", *given, "--picture", "a.pdf"]) == 2


def test_a_bad_calibration_has_status_3(files, capsys):
    robot, seen = made(32, turn_rad=0.03, shift_noise=1.0)
    found = asked(capsys, *files(a=table(robot), b=table(seen)), status=3)
    assert found["verdict"] == "bad"
    assert found["reasons"]


def test_files_without_pairs_are_refused(files):
    a, b = files(a=table(ROBOT), b=table(SEEN))
    with pytest.raises(InvalidInputError, match="name a second file"):
        report_hand_eye([a])
    both = [f"{x},{y}" for x, y in zip(table(ROBOT).split(), table(SEEN).split(), strict=True)]
    (c,) = files(c="\n".join(both))
    with pytest.raises(InvalidInputError, match="--robot NAME and --sensor NAME"):
        report_hand_eye([c], [b])
    named = report_hand_eye([c], None, HandEyeOptions(robot="first", sensor="second"))
    assert named.calibration.verdict == "good"


@pytest.mark.ci
def test_over_rest(client):
    made_here = client.post("/sessions", json={"name": "hand-eye"}).json()["id"]
    at = f"/sessions/{made_here}"
    for name, poses in (("a.csv", ROBOT), ("b.csv", SEEN)):
        answer = client.post(f"{at}/uploads?name={name}", content=table(poses).encode())
        assert answer.status_code == 201, answer.text
    body = {"robot_file": "a.csv", "sensor_file": "b.csv"}
    found = client.post(f"{at}/calibrations/hand-eye", json=body)
    assert found.status_code == 200, found.text
    assert found.json()["verdict"] == "good"
    drawn = client.post(f"{at}/calibrations/hand-eye/picture?format=png", json=body)
    assert drawn.content.startswith(b"\x89PNG")
    for wrong, status in (
        ({"robot_file": "none.csv"}, 404),
        ({"robot_file": "a.csv"}, 422),
        ({**body, "setup": "eye"}, 422),
        ({**body, "robot_file": "../a.csv"}, 422),
    ):
        assert client.post(f"{at}/calibrations/hand-eye", json=wrong).status_code == status
    client.delete(at)


def test_a_full_disk_is_named_with_the_picture(files, capsys, tmp_path, monkeypatch):
    def full(path, data):
        raise OSError(28, "No space left on device", str(path))

    given = files(a=table(ROBOT), b=table(SEEN))
    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["calibrate", "hand-eye", *given, "--picture", str(tmp_path / "a.svg")]) == 2
    assert "a.svg: the disk is full" in capsys.readouterr().err
