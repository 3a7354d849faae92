"""Captures leave as files and come back; clouds, paths and motions of others become captures."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import session_obstacles, stale_reason
from rona_core.app.overview.exports import tfm_bytes
from rona_core.app.overview.frame_graph import frame_rows
from rona_core.app.steps.acoustics.messages import CalibrateSoundSpeed
from rona_core.app.steps.imports.messages import StartImport
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.compose import new_workbench
from rona_core.devices.files.arrays import read_hdf5_tree
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import DeviceError, InvalidInputError, NotFoundError, StepBlockedError
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.formats import read_motion
from rona_core.robot.verification.foreign_motion import verify_foreign
from rona_core.session.captures import is_imported
from rona_core.session.codec import digest
from rona_core.session.document import Session
from tests.helpers.result_differences import assert_alike
from tests.helpers.session_file import reopened

FILE = "captures.h5"


@pytest.fixture(scope="module")
def captures(demo):
    return REGISTRY.export(demo, FILE)


@pytest.fixture
def bench(demo, captures, tmp_path):
    """An empty session with the set-up of the demo session, whose uploads hold its captures."""
    (tmp_path / FILE).write_bytes(captures)
    made = new_workbench(Session(setup=demo.setup), tmp_path)
    yield made
    made.close()


def put(bench, name, data):
    Path(bench.uploads, name).write_bytes(data)
    return name


def without_names(capture):
    """Return a capture without what an import gives anew."""
    return digest(replace(capture, ordinal=0, setup_digest=""))


def test_the_file_is_read_by_others_with_units_and_frames(demo, captures):
    with h5py.File(io.BytesIO(captures)) as file:
        assert file.attrs["robot"] == demo.setup.devices.robot.model
        scan = demo.captures.scan
        rf, poses = file["scan/scans/rf"], file["computed/scan/Ts_base_probe"]
        np.testing.assert_array_equal(rf, scan.scans.rf)
        assert file["scan/scans"].attrs["sampling_mhz"] == scan.scans.sampling_mhz
        np.testing.assert_array_equal(file["scan/joints/qs_rad"], scan.joints.qs_rad)
        assert file["scan/joints/qs_rad"].attrs["unit"] == "rad"
        assert file["scan/forces/force_n"].attrs["unit"] == "N"
        assert file["scan/scans/times_s"].attrs["unit"] == "s"
        assert poses.shape == (len(scan.scans), 4, 4)
        assert dict(poses.attrs) == {"parent": "base", "child": "probe", "unit": "mm"}
        marker = file["tool/marker/Ts_tracker_marker"]
        own = demo.captures.tool.marker.Ts_tracker_marker
        np.testing.assert_array_equal(marker[:, :3, :3], own.rotations)
        np.testing.assert_array_equal(marker[:, :3, 3], own.translations)
    with pytest.raises(StepBlockedError, match="nothing was recorded"):
        REGISTRY.export(Session(), FILE)


@pytest.mark.slow
def test_every_capture_comes_back_as_it_was_and_is_marked(demo, bench):
    bench.run(StartImport(FILE, only=("tool", "pointer", "surface", "path", "references")))
    session = bench.session
    assert all(map(is_imported, session.archive))
    assert [one.ordinal for one in session.archive] == [1, 2, 3, 4, 5]
    for name in ("tool", "pointer", "path", "references"):
        came, was = session.captures.get(name), demo.captures.get(name)
        assert without_names(came) == without_names(was)
    for name in ("tool", "pointer", "surface", "path"):
        assert_alike(session.results.get(name).value, demo.results.get(name).value, name)
        assert stale_reason(f"capture {name}", session) is None
    again = reopened(session)
    assert again.captures.tool.setup_digest == session.captures.tool.setup_digest
    bench.dispatch(SetRobot(model="ur10"))
    assert "robot" in stale_reason("capture tool", bench.session)
    assert stale_reason("capture pointer", bench.session) is None


@pytest.mark.slow
def test_a_scan_that_was_imported_gives_the_same_maps(demo, bench):
    bench.run(StartImport(FILE))
    bench.run(StartMapping())
    original = new_workbench(demo)
    for one in (bench, original):
        one.dispatch(CalibrateSoundSpeed())
        one.run(StartMapping())
    for name in ("detection", "second_detection", "mounting", "burr"):
        came, was = bench.session.results.get(name), original.session.results.get(name)
        assert_alike(came.value, was.value, name)
    came, was = bench.session.results.maps.value, original.session.results.maps.value
    for name in ("outer", "inner", "fused"):
        maps = getattr(came, name), getattr(was, name)
        np.testing.assert_array_equal(maps[0].ok, maps[1].ok)
        np.testing.assert_allclose(maps[0].height_mm, maps[1].height_mm, atol=1e-5)
    judged = original.figures()
    assert judged["outer_rms_mm"] is not None
    assert bench.figures()["outer_rms_mm"] is None
    with pytest.raises(DeviceError, match="imported"):
        bench.map_errors()
    original.close()


@pytest.mark.slow
def test_captures_of_other_devices_and_damaged_files_are_refused(bench, captures):
    bench.dispatch(SetRobot(model="ur10"))
    with pytest.raises(InvalidInputError, match="the robot rx90, the set-up has ur10"):
        bench.run(StartImport(FILE))
    assert not bench.session.archive
    bench.dispatch(SetRobot(model="rx90"))
    with pytest.raises(InvalidInputError, match="has no sono_scan; it has"):
        bench.run(StartImport(FILE, only=("sono_scan",)))
    with pytest.raises(NotFoundError, match="upload it first"):
        bench.run(StartImport("other.h5"))
    put(bench, "cut.h5", captures[: len(captures) // 2])
    with pytest.raises(InvalidInputError, match="damaged"):
        bench.run(StartImport("cut.h5"))
    put(bench, "text.h5", b"rf")
    with pytest.raises(InvalidInputError, match="no HDF5"):
        bench.run(StartImport("text.h5"))


def changed_file(captures, change):
    file = io.BytesIO(captures)
    with h5py.File(file, "r+") as held:
        change(held)
    return file.getvalue()


def without(held):
    del held["scan/scans/times_s"]


def short(held):
    del held["scan/joints/qs_rad"]
    held["scan/joints/qs_rad"] = np.zeros((3, 6))


def not_finite(held):
    held["scan/joints/qs_rad"][7] = np.nan


def mirrored(held):
    held["tool/marker/Ts_tracker_marker"][:, 0, :3] *= -1.0


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without, "times_s"),
        (short, "scan/joints/qs_rad: expected an array of shape"),
        (not_finite, "scan/joints/qs_rad is not finite in row 7"),
        (mirrored, "tool/marker/Ts_tracker_marker"),
    ],
)
def test_what_is_missing_or_cannot_be_meant_is_named(bench, captures, change, words):
    put(bench, "a.h5", changed_file(captures, change))
    with pytest.raises(InvalidInputError, match=words):
        bench.run(StartImport("a.h5"))
    assert not bench.session.archive


def test_a_file_of_others_needs_no_more_than_what_was_measured(demo, bench):
    scan = demo.captures.scan
    file = io.BytesIO()
    with h5py.File(file, "w") as made:
        made["scan/scans/rf"], made["scan/scans/times_s"] = scan.scans.rf, scan.scans.times_s
        made["scan/scans/clipped"] = scan.scans.clipped
        made["scan/scans"].attrs["sampling_mhz"] = scan.scans.sampling_mhz
        made["scan/scans"].attrs["start_us"] = scan.scans.start_us
        made["scan/joints/times_s"], made["scan/joints/qs_rad"] = (
            scan.joints.times_s,
            scan.joints.qs_rad,
        )
    put(bench, "mine.h5", file.getvalue())
    with pytest.raises(InvalidInputError, match="name those that are meant"):
        bench.run(StartImport("mine.h5"))
    bench.run(StartImport("mine.h5", only=("scan",)))
    held = bench.session.captures.scan
    assert (held.forces, held.head, held.partial) == (None, None, False)
    np.testing.assert_array_equal(held.scans.rf, scan.scans.rf)


@pytest.mark.slow
def test_a_cloud_and_a_path_of_others_lead_to_a_certified_motion(demo, bench):
    cloud, path = demo.results.surface.value.points_base, demo.results.path.value.points_base
    rows = "\n".join(",".join(map(repr, one)) for one in cloud.tolist())
    put(bench, "cloud.csv", f"x_mm,y_mm,z_mm\n{rows}\n".encode())
    points = [{"position": [-x, -y, z]} for x, y, z in path[::20].tolist()]
    markup = {"coordinateSystem": "RAS", "coordinateUnits": "mm", "controlPoints": points}
    put(bench, "path.mrk.json", json.dumps({"markups": [markup]}).encode())
    bench.run(StartImport("cloud.csv", "cloud"))
    bench.run(StartImport("path.mrk.json", "path"))
    session = bench.session
    np.testing.assert_array_equal(session.results.surface.value.points_base, cloud)
    np.testing.assert_allclose(session.results.path.value.points_base, path[::20], atol=1e-12)
    assert is_imported(session.captures.get("cloud"))
    states = {one.name: one.state for one in step_states(session)}
    assert (states["surface"], states["path"]) == ("done", "done")
    bench.dispatch(SmoothScanPath())
    known, found = demo.results.smoothing.value.path, bench.session.results.smoothing.value.path
    assert found.axes_base.mean(axis=0) @ known.axes_base.mean(axis=0) > 0.95  # into the bone
    assert "under the touched patch" in session_obstacles(bench.session).sentence
    bench.run(StartRollSearch(n_rolls=12))
    assert bench.session.results.roll.value.may_move
    assert bench.figures()["surface_points"] == len(cloud)


@pytest.mark.slow
def test_a_motion_of_others_is_the_plan_once_it_is_certified(demo, bench, tmp_path):
    other = new_workbench(demo.with_result("roll", None), tmp_path)
    put(other, "scan.json", REGISTRY.export(demo, "scan_motion.json"))
    other.run(StartImport("scan.json", "motion"))
    plan, known = other.session.results.roll.value, demo.results.roll.value
    assert plan.may_move
    np.testing.assert_array_equal(plan.trajectory.qs_rad, known.trajectory.qs_rad)
    np.testing.assert_allclose(plan.trajectory.path_mm, known.trajectory.path_mm, atol=0.3)
    np.testing.assert_allclose(plan.search.rolls_rad, known.search.rolls_rad, atol=1e-3)
    reasons = {one.name: one.reason for one in step_states(other.session)}
    assert "imported motion" in reasons["roll"]
    rows = REGISTRY.export(demo, "scan_motion.csv").decode().splitlines()
    head, table = rows[:7], [row.split(",") for row in rows[7:]]
    fast = [",".join((repr(float(row[0]) / 3.0), *row[1:])) for row in table]
    put(other, "fast.csv", "\n".join((*head, *fast)).encode())
    other.run(StartImport("fast.csv", "motion"))
    refused = other.session.results.roll.value
    assert not refused.may_move
    assert "scan speed" in {one.name for one in refused.certificate.failures()}
    other.close()
    put(bench, "scan.csv", REGISTRY.export(demo, "scan_motion.csv"))
    with pytest.raises(StepBlockedError, match="smooth"):
        bench.run(StartImport("scan.csv", "motion"))


@pytest.mark.sweep(1)
@pytest.mark.parametrize("ending", ["csv", "json", "yaml"])
def test_motions_leave_with_digests_and_are_certified_again(demo, ending):
    data = REGISTRY.export(demo, f"scan_motion.{ending}")
    plan, model = demo.results.roll.value, robot_model(demo.setup.devices.robot.model)
    assert plan.certificate.digest.encode() in data
    found = read_motion(NamedFile(f"a.{ending}", data), model)
    verdict = verify_foreign(model, found, obstacles=session_obstacles(demo))
    assert verdict.certificate.certified
    again = verdict.certificate.obstacles == plan.certificate.obstacles
    assert again
    if ending == "csv":
        np.testing.assert_array_equal(found.times_s, plan.trajectory.times_s)


def test_transforms_leave_as_json_and_for_slicer(demo):
    rows = {row.name: row for row in frame_rows(demo)}
    told = json.loads(REGISTRY.export(demo, "transforms.json"))["transforms"]
    assert {one["name"] for one in told} == set(rows)
    for one in told:
        np.testing.assert_array_equal(one["matrix"], rows[one["name"]].pose.matrix())
    with zipfile.ZipFile(io.BytesIO(REGISTRY.export(demo, "transforms.zip"))) as archive:
        text = archive.read("T_base_tracker.tfm").decode()
        assert "T_flange_tip.tfm" in archive.namelist()
    np.testing.assert_allclose(
        from_tfm(text), rows["T_base_tracker"].pose.inv().matrix(), atol=1e-12
    )


def from_tfm(text):
    (line,) = [line for line in text.splitlines() if line.startswith("Parameters: ")]
    numbers = np.array(line.split()[1:], dtype=float)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = numbers[:9].reshape(3, 3), numbers[9:]
    return matrix


def test_a_transform_into_a_ct_takes_places_to_its_axes():
    """A place of the frame, seen in the CT in LPS, is led back by the transform."""
    rng = np.random.default_rng(0)
    T_skull_tip = Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3))
    turned = np.diag((-1.0, -1.0, 1.0))
    place = rng.normal(size=3)
    in_lps = turned @ (T_skull_tip @ place[None])[0]
    back = from_tfm(tfm_bytes(T_skull_tip, turned).decode())
    np.testing.assert_allclose(back[:3, :3] @ in_lps + back[:3, 3], place, atol=1e-12)


def test_simpleitk_reads_the_transforms(demo, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="make viewers")
    with zipfile.ZipFile(io.BytesIO(REGISTRY.export(demo, "transforms.zip"))) as archive:
        archive.extractall(tmp_path)
    pose = next(row.pose for row in frame_rows(demo) if row.name == "T_base_tracker")
    read = sitk.ReadTransform(str(tmp_path / "T_base_tracker.tfm"))
    place = (10.0, -20.0, 30.0)
    there = (pose @ np.array([place]))[0]
    np.testing.assert_allclose(read.TransformPoint(tuple(there.tolist())), place, atol=1e-9)


def test_a_tree_of_hdf5_follows_no_links(tmp_path):
    (tmp_path / "secret.h5").write_bytes(b"")
    file = io.BytesIO()
    with h5py.File(file, "w") as made:
        made["scan/away"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "/rf")
        made["scan/soft"] = h5py.SoftLink("/scan")
        made["scan/here"] = np.arange(3)
    found = read_hdf5_tree(NamedFile("a.h5", file.getvalue()))
    assert set(found) == {"scan/here"}
