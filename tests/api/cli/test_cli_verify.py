"""``rona verify`` and ``rona export`` by kinds: what they print, write, and their exit status."""

import json
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.overview.motion_report import VerifySettings, report_motion
from rona_core.app.steps.roll.certificate_view import NO_CLEARANCE
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.universal_robots import urdf_path
from rona_ui.cli import main
from rona_ui.resources import demo_session
from tests.helpers.foreign_motions import planned

HEADER = "time_s," + ",".join(f"q{k}_rad" for k in range(1, 7))


def written(path, times, qs, header=HEADER):
    rows = [",".join(map(repr, row)) for row in np.column_stack((times, qs)).tolist()]
    path.write_text("\n".join((header, *rows)) + "\n")
    return str(path)


@pytest.fixture
def motion():
    at, duration_s = planned("ur5", 1)
    times = np.arange(0.0, duration_s + 0.008, 0.008)
    return times, at(np.minimum(times, duration_s)).q


def asked(capsys, *arguments, status):
    assert main(["verify", *map(str, arguments)]) == status
    return capsys.readouterr()


def test_a_good_motion_is_certified_for_robot_and_description(capsys, tmp_path, motion):
    file = written(tmp_path / "a.csv", *motion)
    out = asked(capsys, file, "--robot", "ur5", status=0).out
    assert "certificate" in out
    assert "around it: nothing" in out
    urdf = tmp_path / "mine.urdf"
    urdf.write_text(urdf_path("ur5").read_text())
    out = asked(capsys, file, "--robot", urdf, status=0).out
    assert "states no accelerations" in out
    found = json.loads(asked(capsys, file, "--robot", "ur5", "--json", status=0).out)
    assert (found["certified"], found["interpolation"]) == (True, "linear")
    assert NO_CLEARANCE not in found["remarks"]
    assert set(found["digests"]) == {"motion", "certificate", "robot", "tolerances", "obstacles"}


def test_a_refused_one_says_where_and_draws_it(capsys, tmp_path, motion):
    times, qs = motion
    qs[200:, 3] += np.deg2rad(15.0)
    file, picture = written(tmp_path / "a.csv", times, qs), tmp_path / "a.svg"
    arguments = (file, "--robot", "ur5", "--picture", picture)
    out = asked(capsys, *arguments, status=3).out
    assert "joint step fails: joint 4" in out
    assert "at sample 200 (1.600 s)" in out
    assert "J4 (°)" in picture.read_text()
    found = json.loads(asked(capsys, *arguments, "--json", status=3).out)
    assert NO_CLEARANCE in found["remarks"]
    assert found["least_clearance_mm"] is None
    (step,) = [one for one in found["checks"] if one["name"] == "joint step"]
    assert (step["holds"], step["sample"], step["joint"], len(step["q_deg"])) == (False, 200, 4, 6)


@pytest.mark.parametrize(
    ("header", "robot", "words"),
    [
        (HEADER.replace("_rad", ""), "ur5", "no joint angles with their unit"),
        (HEADER, "ur7", "there is no robot 'ur7'"),
        (HEADER.replace("q3", "elbow"), "ur5", "one column for each joint"),
    ],
)
def test_what_cannot_be_read_is_bad_input(capsys, tmp_path, motion, header, robot, words):
    file = written(tmp_path / "a.csv", *motion, header)
    assert words in asked(capsys, file, "--robot", robot, status=2).err


def test_speed_of_the_tool_and_straight_wrists_are_asked_for(capsys, tmp_path, motion):
    file = written(tmp_path / "a.csv", *motion)
    out = asked(capsys, file, "--robot", "ur5", "--tool-speed", 20, status=3).out
    assert "speed of the tool fails" in out
    with pytest.raises(InvalidInputError, match="tool_speed_mm_per_s"):
        VerifySettings(tool_speed_mm_per_s=0.0)
    asked(capsys, file, "--robot", "ur5", "--picture", tmp_path / "a.jpg", status=2)


@pytest.mark.slow
def test_the_motions_of_a_session_have_the_certificates_that_they_had(demo, tmp_path):
    for name, result, tool in (("scan", "roll", "probe"), ("milling", "milling", "burr")):
        data = REGISTRY.export(demo, f"{name}_motion.csv")
        report = report_motion(
            NamedFile("a.csv", data), "rx90", VerifySettings(tool=tool), session=demo
        )
        known = demo.results.get(result).value.certificate
        assert report.certified, [one.sentence for one in report.verdict.refused()]
        assert report.verdict.certificate.robot == known.robot
        assert report.verdict.certificate.obstacles == known.obstacles
        if name == "scan":  # of a milling the tolerances are those of cutting
            assert report.figures()["digests"]["certificate"] == known.digest


@pytest.mark.ci
def test_files_are_exported_by_kind_and_what_cannot_be_made_is_said(capsys, tmp_path):
    out = tmp_path / "out"
    assert main(["export", str(demo_session()), str(out), "--motion"]) == 0
    said = capsys.readouterr().out
    assert "scan_motion.script is not written: URScript is for arms of Universal Robots" in said
    names = {path.name for path in out.iterdir()}
    assert {"scan_motion.csv", "scan_motion.yaml", "milling_motion.json"} <= names
    assert not any(name.endswith((".script", ".stl")) for name in names)


def test_a_full_disk_is_named_with_the_picture(capsys, tmp_path, motion, monkeypatch):
    def full(path, data):
        raise OSError(28, "No space left on device", str(path))

    file = written(tmp_path / "a.csv", *motion)
    monkeypatch.setattr(Path, "write_bytes", full)
    arguments = (file, "--robot", "ur5", "--picture", tmp_path / "a.svg")
    said = asked(capsys, *arguments, status=2).err
    assert "a.svg: the disk is full" in said
