"""Jobs, devices and event streams, followed as another program would follow them."""

import json
import threading

import numpy as np
import pytest

from rona_core.devices.settings import TOOLS
from rona_core.errors import CancelledError, DeviceError
from rona_core.session.captures import PointerCapture
from rona_ui.server import PREFIX

QUICK = {"duration_s": 2.0}


def events(lines):
    """Yield (kind, number, data) of server-sent events."""
    kind, number = None, None
    for line in lines:
        name, _, value = line.partition(": ")
        if name == "event":
            kind = value
        elif name == "id":
            number = int(value)
        elif name == "data":
            yield kind, number, json.loads(value)
            kind, number = None, None


def finished(web, job):
    return web.hub.get(job["session"]).jobs.wait(job["id"], 120)


def tools(frame):
    return {sample["tool"]: sample for sample in frame["tools"]}


# -- jobs ------------------------------------------------------------------------------------------


def test_a_job_from_start_to_end(at, client, web):
    answer = at("POST", "/jobs/StartPointerCapture", json=QUICK)
    job = answer.json()
    assert answer.status_code == 202
    assert answer.headers["location"] == f"{PREFIX}/jobs/{job['id']}"
    with client.stream("GET", f"/jobs/{job['id']}/events") as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        told = [(number, data) for _, number, data in events(stream.iter_lines())]
    numbers, states = [n for n, _ in told], [data for _, data in told]
    assert numbers == sorted(set(numbers))
    assert [s["progress"] for s in states] == sorted(s["progress"] for s in states)
    assert [s["finished"] for s in states] == [False] * (len(states) - 1) + [True]
    assert (states[-1]["state"], states[-1]["progress"]) == ("done", 1.0)
    assert states[-1]["revision"] == at("GET", "").json()["revision"] == 2
    assert client.get(f"/jobs/{job['id']}").json() == states[-1]
    assert states[-1] in client.get("/jobs").json()
    late = client.delete(f"/jobs/{job['id']}")
    assert (late.status_code, late.json()["code"]) == (409, "job_finished")


def test_a_replay_is_a_job_that_changes_nothing(at, client, web, session, replayed):
    finished(web, at("POST", "/jobs/StartPointerCapture", json=QUICK).json())
    before = {**at("GET", "").json(), "copy": None}  # that may be written meanwhile
    found = replayed(session)
    assert found["same"]
    assert [row["result"] for row in found["results"]] == ["pointer"]
    assert found["results"][0]["stored"] == found["results"][0]["recomputed"]
    assert {**at("GET", "").json(), "copy": None} == before
    started = at("POST", "/jobs/StartReplay").json()
    finished(web, started)
    ended = client.get(f"/jobs/{started['id']}").json()
    assert (ended["result"], ended["revision"]) == (found, before["revision"])
    others = [job for job in client.get("/jobs").json() if job["activity"] != "StartReplay"]
    assert {json.dumps(job["result"]) for job in others} == {"null"}


def test_a_replay_does_not_hold_its_request_up_and_can_be_cancelled(at, client, web, monkeypatch):
    told = threading.Event()

    def endless(session, *, progress, cancel):
        progress(0.25)
        told.set()
        while not cancel():
            threading.Event().wait(0.002)
        raise CancelledError("the replay was cancelled")

    monkeypatch.setattr("rona_core.app.runtime.session_step.replay_report", endless)
    answer = at("POST", "/replay")
    job = answer.json()
    assert (answer.status_code, job["state"], job["result"]) == (202, "running", None)
    assert told.wait(30)
    assert client.get(f"/jobs/{job['id']}").json()["progress"] == 0.25
    assert client.delete(f"/jobs/{job['id']}").status_code == 202
    assert finished(web, job).state == "cancelled"
    assert client.get(f"/jobs/{job['id']}").json()["result"] is None


def test_results_are_thinned_out_evenly(at, web):
    finished(web, at("POST", "/jobs/StartPointerCapture", json=QUICK).json())
    whole = at("GET", "/results/pointer").json()
    few = at("GET", "/results/pointer", params={"max_points": 7}).json()
    times = whole["captures"]["pointer"]["value"]["marker"]["times_s"]
    thin = few["captures"]["pointer"]["value"]["marker"]["times_s"]
    assert len(times) > 100
    assert len(thin) == 7
    index = [times.index(time) for time in thin]
    assert (index[0], index[-1]) == (0, len(times) - 1)
    assert np.ptp(np.diff(index)) <= 1
    held = web.hub.get().session.results.pointer.value
    assert whole["results"]["pointer"]["value"]["tip_pointermarker"] == list(held.tip_pointermarker)
    assert whole["results"]["pointer"]["message"] == "CalibratePointer"


def test_frames_name_their_source_and_grow_stale(at, web):
    finished(web, at("POST", "/jobs/StartPointerCapture", json=QUICK).json())
    frames = {frame["name"]: frame for frame in at("GET", "/frames").json()}
    tip = frames["T_pointermarker_pointertip"]
    held = web.hub.get().session.results.pointer.value
    assert tip["translation_mm"] == list(held.tip_pointermarker)
    assert (tip["wxyz"], tip["source"], tip["stale"]) == ([1.0, 0.0, 0.0, 0.0], "pointer", False)
    assert (tip["stale_reason"], tip["sigma_mm"]) == (None, held.tip_sigma_mm)
    assert tip["time_utc"].startswith("20")
    assert tip["sigma_deg"] is frames["T_flange_tip"]["sigma_mm"] is None
    assert frames.keys() >= {"T_tracker_pointermarker", "T_tracker_basemarker"}  # seen last
    at("POST", "/commands/SetSeed", json={"seed": 4})
    frames = {frame["name"]: frame for frame in at("GET", "/frames").json()}
    assert frames["T_pointermarker_pointertip"]["stale"]
    assert frames["T_pointermarker_pointertip"]["reason"]
    assert frames["T_pointermarker_pointertip"]["stale_reason"]
    assert not frames["T_flange_tip"]["stale"]


class Gate:
    """Holds a capture up at its first frame until it is opened."""

    def __init__(self, monkeypatch, rig):
        self.reached, self.opened = threading.Event(), threading.Event()
        genuine = rig.tracker.frames

        def frames():
            for frame in genuine():
                yield frame
                self.reached.set()
                self.opened.wait(30)

        monkeypatch.setattr(rig.tracker, "frames", frames)


@pytest.fixture
def gate(monkeypatch, web, session):
    gate = Gate(monkeypatch, web.hub.get(session).rig())
    yield gate
    gate.opened.set()


def test_while_devices_are_busy(at, gate, web):
    job = at("POST", "/jobs/StartPointerCapture", json=QUICK).json()
    assert gate.reached.wait(30)
    for path in ("/jobs/StartPointerCapture", "/jobs/StartToolCapture", "/probe/acquire"):
        answer = at("POST", path)
        assert (answer.status_code, answer.json()["code"]) == (409, "device_error"), path
    assert at("GET", "/tracker/frame").json()["number"] == 0  # the one of the capture
    rig = web.hub.get(job["session"]).rig()
    at("POST", "/commands/SetSeed", json={"seed": 5})
    assert web.hub.get(job["session"]).rig() is rig  # devices are not swapped under a capture
    gate.opened.set()
    assert finished(web, job).state == "done"
    assert web.hub.get(job["session"]).rig() is not rig


@pytest.mark.parametrize("how", ["stop", "cancel"])
def test_stop_and_cancel_keep_what_was_measured(at, client, gate, web, how):
    job = at("POST", "/jobs/StartPointerCapture", json={"duration_s": 60.0}).json()
    assert gate.reached.wait(30)
    if how == "stop":
        assert at("POST", "/robot/stop").json() == {"stopped": True}
        assert at("POST", "/robot/stop").json() == {"stopped": True}
    else:
        assert client.delete(f"/jobs/{job['id']}").status_code == 202
    gate.opened.set()
    ended = finished(web, job)
    assert ended.state == "cancelled"
    (capture,) = web.hub.get(job["session"]).session.archive
    assert isinstance(capture, PointerCapture)
    assert capture.partial
    assert capture.marker.n_frames < 60


def test_stop_if_moving_ends_nothing_while_the_robot_rests(at, gate, web):
    job = at("POST", "/jobs/StartPointerCapture", json=QUICK).json()
    assert gate.reached.wait(30)
    assert at("POST", "/robot/stop", params={"if_moving": True}).json() == {"stopped": False}
    gate.opened.set()
    assert finished(web, job).state == "done"


def test_stop_if_moving_ends_what_drives_the_robot(at, gate, web):
    job = at("POST", "/jobs/StartToolCapture").json()
    assert gate.reached.wait(30)
    assert at("POST", "/robot/stop", params={"if_moving": True}).json() == {"stopped": True}
    gate.opened.set()
    assert finished(web, job).state == "cancelled"


def test_stop_is_idempotent_and_changes_no_session(at):
    for _ in range(3):
        assert at("POST", "/robot/stop").json() == {"stopped": True}
    assert at("GET", "").json()["revision"] == 0


# -- devices ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("device", "settings"),
    [
        ("tracker", {"profile": "white035", "rate_hz": 30.0}),
        (
            "tracker",
            {
                "profile": "vega",
                "stereo": False,
                "depth_ratio": 4.0,
                "occlusion": False,
                "phantom_share": 0.1,
                "latency_ms": 20.0,
                "drift_mm": 0.5,
                "minutes_on": 3.0,
                "dropped_share": 0.2,
            },
        ),
        (
            "probe",
            {
                "name": "1MHz",
                "excitation": "pulse",
                "front_snr_db": 40.0,
                "shots": 8,
                "pitch_mm": 2.0,
            },
        ),
        (
            "robot",
            {
                "model": "ur10",
                "errors": False,
                "scan_speed_mm_per_s": 10.0,
                "base_shift_mm": [1.0, 2.0, 3.0],
                "base_turn_deg": 4.0,
            },
        ),
    ],
)
def test_settings_are_read_as_they_were_put(at, device, settings):
    at("PUT", f"/{device}/settings", json=settings)
    assert at("GET", f"/{device}/settings").json().items() >= settings.items()
    assert at("GET", "").json()["revision"] == 1
    at("POST", "/undo")
    assert at("GET", f"/{device}/settings").json() != settings
    refused = at("PUT", f"/{device}/settings", json={**settings, "colour": "red"})
    assert (refused.status_code, refused.json()["errors"][0]["pointer"]) == (422, "/colour")


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/tracker/settings", {"rate_hz": 1.0}),
        ("/tracker/settings", {"profile": "perfect"}),
        ("/tracker/settings", {"latency_ms": -1.0}),
        ("/tracker/settings", {"phantom_share": 0.9}),
        ("/tracker/settings", {"occlusion": "sometimes"}),
        ("/robot/settings", {"model": "c3po"}),
        ("/robot/settings", {"scan_speed_mm_per_s": 1e6}),
        ("/probe/settings", {"pitch_mm": 0.0}),
        ("/tracker/tools/toolmarker/visible", {"visible": "perhaps"}),
        ("/tracker/tools/pointer6d/pose", {"wxyz": [2, 0, 0, 0], "translation_mm": [0, 0, 1]}),
        ("/tracker/tools/pointer6d/pose", {"wxyz": [1, 0, 0], "translation_mm": [0, 0, 1]}),
        ("/tracker/tools/pointer6d/pose", {"wxyz": [1, 0, 0, 0], "translation_mm": [0, 0, 1e9]}),
    ],
)
def test_settings_out_of_range_are_refused(at, path, body):
    answer = at("PUT", path, json=body)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_input")
    assert at("GET", "").json()["revision"] == 0


def test_a_tool_that_is_covered_is_not_seen(at):
    assert tools(at("GET", "/tracker/frame").json())["toolmarker"]["status"] == "ok"
    at("PUT", "/tracker/tools/toolmarker/visible", json={"visible": False})
    sample = tools(at("GET", "/tracker/frame").json())["toolmarker"]
    assert (sample["status"], sample["T_tracker_marker"]) == ("covered", None)
    at("PUT", "/tracker/tools/toolmarker/visible", json={"visible": True})
    assert tools(at("GET", "/tracker/frame").json())["toolmarker"]["status"] == "ok"


@pytest.mark.parametrize("tool", [t for t in TOOLS if t.startswith("pointer")])
def test_a_tracker_without_noise_sees_a_pointer_where_a_hand_put_it(at, tool):
    at("PUT", "/tracker/settings", json={"profile": "ideal"})
    half = np.sqrt(0.5)  # turned about x: markers face the tracker, which looks along +z
    pose = {"wxyz": [0.0, 1.0, 0.0, 0.0], "translation_mm": [30.0, -20.0, 1800.0]}
    if tool == "pointer5d":
        pose["wxyz"] = [half, half, 0.0, 0.0]
    seen = tools(at("PUT", f"/tracker/tools/{tool}/pose", json=pose).json())[tool]
    assert seen["status"] == "ok"
    assert seen["rms_error_mm"] == pytest.approx(0.0, abs=1e-6)
    measured = seen["T_tracker_marker"]
    np.testing.assert_allclose(measured["translation_mm"], pose["translation_mm"], atol=1e-6)
    if tool == "pointer6d":  # the line of the other has no roll
        assert abs(np.dot(measured["wxyz"], pose["wxyz"])) == pytest.approx(1.0, abs=1e-9)
    assert tools(at("GET", "/tracker/frame").json())[tool]["status"] == "ok"
    away = at("DELETE", f"/tracker/tools/{tool}/pose").json()
    assert tools(away)[tool]["status"] == "out_of_view"
    assert at("GET", "").json()["revision"] == 1  # a hand changes no session


def test_a_pointer_beyond_the_volume_is_not_seen(at):
    pose = {"wxyz": [0.0, 1.0, 0.0, 0.0], "translation_mm": [0.0, 0.0, 9000.0]}
    seen = tools(at("PUT", "/tracker/tools/pointer6d/pose", json=pose).json())["pointer6d"]
    assert (seen["status"], seen["T_tracker_marker"]) == ("out_of_volume", None)


def test_the_robot_does_not_let_go_of_its_tool(at):
    pose = {"wxyz": [1.0, 0.0, 0.0, 0.0], "translation_mm": [0.0, 0.0, 1800.0]}
    answer = at("PUT", "/tracker/tools/toolmarker/pose", json=pose)
    assert (answer.status_code, answer.json()["code"]) == (409, "device_error")
    assert at("PUT", "/tracker/tools/basemarker/pose", json=pose).status_code == 409
    for path in ("/tracker/tools/spoon/pose", "/tracker/tools/spoon/visible"):
        assert at("PUT", path, json={**pose, "visible": True}).status_code in (404, 422)
    assert at("PUT", "/tracker/tools/spoon/pose", json=pose).status_code == 404


def test_a_moved_tracker_sees_the_base_marker_elsewhere(at):
    at("PUT", "/tracker/settings", json={"profile": "ideal"})
    before = tools(at("GET", "/tracker/frame").json())["basemarker"]["T_tracker_marker"]
    move = {"shift_mm": [30.0, 0.0, 0.0], "turn_deg": 0.0}
    assert at("POST", "/commands/MoveTracker", json=move).status_code == 200
    assert at("GET", "/tracker/settings").json()["place"] == move
    after = tools(at("GET", "/tracker/frame").json())["basemarker"]["T_tracker_marker"]
    way = np.subtract(after["translation_mm"], before["translation_mm"])
    assert np.linalg.norm(way) == pytest.approx(30.0, abs=1e-6)
    np.testing.assert_allclose(after["wxyz"], before["wxyz"], atol=1e-9)
    refused = at("POST", "/commands/MoveTracker", json={"shift_mm": [900.0, 0.0, 0.0]})
    assert refused.status_code == 422
    assert (
        at("POST", "/commands/SetUseBaseMarker", json={"use_base_marker": False}).status_code == 200
    )


def test_a_tracker_without_a_hand_says_so(at, web, session, monkeypatch):
    monkeypatch.setattr(web.hub.get(session).rig(), "live_tracker", None)
    pose = {"wxyz": [1.0, 0.0, 0.0, 0.0], "translation_mm": [0.0, 0.0, 1800.0]}
    answer = at("PUT", "/tracker/tools/pointer6d/pose", json=pose)
    assert (answer.status_code, answer.json()["code"]) == (409, DeviceError.code)
    assert at("GET", "/tracker/frame").json()["number"] == 0  # what the tracker itself reports


def test_live_tracking_is_switched_off_and_on(at, client, session):
    assert at("POST", "/tracker/stop").json() == {"tracking": False}
    answer = at("GET", "/tracker/frame")
    assert (answer.status_code, answer.json()["code"]) == (409, "device_error")
    assert at("POST", "/tracker/start").json() == {"tracking": True}
    assert at("GET", "/tracker/frame").status_code == 200


def test_following_the_tracker(at, client, session):
    with client.stream("GET", f"/sessions/{session}/tracker/stream") as stream:
        told = events(stream.iter_lines())
        frames = [next(told) for _ in range(4)]
        at("POST", "/tracker/stop")
        rest = list(told)
    numbers = [number for _, number, _ in frames]
    assert numbers == sorted(set(numbers))
    assert {kind for kind, _, _ in frames} == {"frame"}
    assert set(tools(frames[0][2])) == set(TOOLS)
    assert rest[-1][0] == "stopped"


def test_moving_the_robot(at, client, web, session):
    before = at("GET", "/robot/state").json()
    assert len(before["joints_deg"]) == 6
    target = [angle + 3.0 for angle in before["joints_deg"]]
    with client.stream("GET", f"/sessions/{session}/robot/stream") as stream:
        told = events(stream.iter_lines())
        assert next(told)[2]["joints_deg"] == before["joints_deg"]
        answer = at("POST", "/robot/move", json={"joints_deg": target})
        assert answer.status_code == 202
        assert finished(web, answer.json()).state == "done"
        seen = next(data for _, _, data in told if not data["moving"])
    after = at("GET", "/robot/state").json()
    np.testing.assert_allclose(after["joints_deg"], target, atol=1e-6)
    np.testing.assert_allclose(seen["joints_deg"], target, atol=1e-6)
    assert at("GET", "").json()["revision"] == 0


def test_a_move_beyond_the_limits_is_refused_at_once(at):
    for turned_deg, words in ((720.0, "joints_deg must be"), (300.0, "joint 1 must be")):
        answer = at("POST", "/robot/move", json={"joints_deg": [turned_deg, 0, 0, 0, 0, 0]})
        assert (answer.status_code, answer.json()["code"]) == (422, "invalid_input")
        assert words in answer.json()["detail"]


def test_one_a_scan(at):
    scan = at("POST", "/probe/acquire").json()
    assert len(scan["rf"]) > 100
    assert max(map(abs, scan["rf"])) <= 1.0
    assert scan == at("POST", "/probe/acquire").json()  # the noise is a function of the capture
    assert at("GET", "").json()["revision"] == 0


# -- streams ---------------------------------------------------------------------------------------


def test_following_a_session(at, client, session):
    at("POST", "/commands/SetSeed", json={"seed": 1})
    with client.stream("GET", f"/sessions/{session}/events", params={"since": 0}) as stream:
        told = events(stream.iter_lines())
        first = next(told)
        assert first[:2] == ("change", 1)
        assert first[2]["message"] == "SetSeed"
        assert first[2]["arguments"] == {"seed": 1}
        at("POST", "/commands/RenameSession", json={"name": "näher"})
        assert next(told)[2]["arguments"] == {"name": "näher"}
        client.delete(f"/sessions/{session}")
        assert next(told)[0] == "closed"
        assert list(told) == []


def test_a_follower_who_comes_back_goes_on_where_it_was(at, client, session):
    for seed in range(3):
        at("POST", "/commands/SetSeed", json={"seed": seed})
    for how in ({"params": {"since": 2}}, {"headers": {"Last-Event-ID": "2"}}):
        with client.stream("GET", f"/sessions/{session}/events", **how) as stream:
            assert next(events(stream.iter_lines()))[1] == 3


def test_following_the_program(client, session):
    with client.stream("GET", "/status/events") as stream:
        told = events(stream.iter_lines())
        assert next(told)[2]["session"]["id"] == session
        client.post(f"/sessions/{session}/commands/RenameSession", json={"name": "other"})
        assert next(s for _, _, s in told if s["session"]["name"] == "other")
        other = client.post("/sessions").json()["id"]
        assert next(s for _, _, s in told if s["session"]["id"] == other)
        client.delete(f"/sessions/{other}")


def test_who_leaves_a_stream_is_forgotten(at, client, web, session):
    store = web.hub.get(session).store
    before = len(store._notifier._listeners)
    with client.stream("GET", f"/sessions/{session}/events", params={"since": 0}):
        at("POST", "/commands/SetSeed", json={"seed": 1})
    done = threading.Event()
    for _ in range(200):
        if len(store._notifier._listeners) == before:
            done.set()
            break
        done.wait(0.05)
    assert done.is_set()


def test_a_pointer_is_turned_by_hand_while_its_capture_runs(at, web):
    assert at("GET", "/operator/pointer").json() == {"in_hand": False}
    turn = {"wxyz": [1.0, 0.0, 0.0, 0.0]}
    refused = at("PUT", "/operator/pointer", json=turn)
    assert (refused.status_code, refused.json()["code"]) == (409, "device_error")
    body = {"duration_s": 60.0, "by_hand": True}
    job = at("POST", "/jobs/StartPointerCapture", json=body).json()
    bench, recorded = web.hub.get(job["session"]), threading.Event()
    for _ in range(600):
        frame = bench.live.get().frame
        if at("GET", "/operator/pointer").json()["in_hand"] and frame and frame.time_s > 0.5:
            recorded.set()
            break
        recorded.wait(0.05)
    assert recorded.is_set()
    assert at("PUT", "/operator/pointer", json=turn).json() == turn
    for bad in ([2.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0]):
        refused = at("PUT", "/operator/pointer", json={"wxyz": bad})
        assert (refused.status_code, refused.json()["code"]) == (422, "invalid_input")
    assert at("POST", "/operator/pointer/finish").json() == {"in_hand": False}
    ended = finished(web, job)
    assert ended.error_code == "degenerate_geometry"  # it was told to stay as it is
    assert "hardly turned" in ended.error
    assert bench.session.captures.pointer.marker.times_s[-1] < 59.0
    assert at("POST", "/operator/pointer/finish").status_code == 409


# -- calibrations ----------------------------------------------------------------------------------


def test_poses_are_left_out_and_the_view_tells_how_good_it_is(at, web, session, replayed):
    assert at("GET", "/calibration/pointer").json() is None
    assert at("GET", "/calibration/surface").status_code == 422
    body = {"step": "pointer", "indices": [4, 2]}
    assert at("POST", "/commands/ExcludePoses", json=body).status_code == 409
    finished(web, at("POST", "/jobs/StartPointerCapture", json=QUICK).json())
    assert at("POST", "/commands/ExcludePoses", json=body).status_code == 200
    view = at("GET", "/calibration/pointer").json()
    assert view["excluded"] == [2, 4]
    assert (view["marks"][2], view["marks"][4]) == (2, 2)
    assert len(view["residuals_mm"]) == len(view["marks"]) == len(view["swing"]["tilts_deg"])
    assert view["expected"][0]["limit_mm"] == 0.5
    assert view["verdict"] in ("good", "weak", "bad")
    assert view["swing"]["next_words"]
    stored = at("GET", "/results/pointer").json()["results"]["pointer"]
    assert stored["arguments"] == {"method": "ml", "exclude": [2, 4]}
    assert replayed(session)["same"]
    beyond = {"step": "pointer", "indices": [10_000]}
    answer = at("POST", "/commands/ExcludePoses", json=beyond)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_input")
    assert "there is no pose 10000" in answer.json()["detail"]


def test_a_simulated_skull_is_not_registered_to_a_file_that_there_is_not(at):
    answer = at("POST", "/jobs/StartSkullRegistration")
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")
    assert "needs a loaded CT" in answer.json()["detail"]
