"""A workbench: what needs devices, what does without them, and what its end means for its jobs."""

import threading

import numpy as np
import pytest

from rona_core.app.runtime import workbench
from rona_core.app.runtime.workbench import Services, Workbench
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.setup.messages import SetRegion, StartSkullImport
from rona_core.app.steps.tool import step
from rona_core.app.steps.tool.messages import StartRobotMove, StartToolCapture
from rona_core.compose import build_registry, new_workbench, virtual_services
from rona_core.errors import CancelledError, DeviceError, InvalidInputError, StepBlockedError
from rona_core.session import members
from rona_core.session.document import RegionChoice, Session
from rona_ui.resources import demo_session


def test_another_skull_is_read_although_the_present_set_up_cannot_be_built(tmp_path):
    held = Session().with_setup(region=RegionChoice((9e4, 0.0, 0.0)))  # as an older file may
    bench = new_workbench(held, tmp_path)
    with pytest.raises(InvalidInputError, match="centre"):
        bench.rig()
    with pytest.raises(InvalidInputError, match="centre"):
        bench.dispatch(SetRegion((8e4, 0.0, 0.0)))
    assert bench.session is held
    (tmp_path / "bone.stl").write_bytes(b"no mesh")
    with pytest.raises(InvalidInputError, match=r"bone\.stl"):
        bench.run(StartSkullImport("bone.stl"))
    bench.close()


def test_closing_a_session_ends_its_computations_too(tmp_path):
    entered = threading.Event()

    def compute(function, *args, progress, cancel):
        entered.set()
        return function(*args, progress=progress, cancel=cancel)

    hub = build_registry(tmp_path, processes=False)
    session = hub.open_upload(demo_session(), "demo").session
    hub.close_all()

    def build(setup):
        raise AssertionError("computing needs no devices")

    bench = Workbench(session, Services(build, None, None, compute), tmp_path)
    job = bench.start(StartRollSearch(n_rolls=720))
    assert entered.wait(20)
    bench.close()
    assert bench.jobs.wait(job.id, 20).state == "cancelled"


def test_what_was_computed_from_a_session_is_forgotten_with_it(tmp_path, monkeypatch):
    forgotten = []
    monkeypatch.setattr(workbench, "forget_all", lambda: forgotten.append(True))
    new_workbench(Session(), tmp_path).close()
    assert forgotten


def test_a_closed_session_builds_no_devices_any_more(tmp_path):
    bench = new_workbench(Session(), tmp_path)
    bench.close()
    with pytest.raises(DeviceError, match="closed"):
        bench.rig()
    with pytest.raises(DeviceError, match="closed"):
        bench.run(StartPointerCapture())


@pytest.mark.parametrize("activity", [StartToolCapture(), StartRobotMove((0.0,) * 6)])
def test_stop_if_moving_stops_what_drives_the_robot_between_its_moves_too(tmp_path, activity):
    bench, begun, go_on = new_workbench(Session(), tmp_path), threading.Event(), threading.Event()

    def work(progress, cancel):
        begun.set()
        go_on.wait(20)
        return 1 if cancel() else 0

    job = bench.jobs.start(activity, work, device=True)
    assert begun.wait(20)
    assert bench.stop_if_moving()  # no devices have been built: it is about to move
    go_on.set()
    assert bench.jobs.wait(job.id, 20).state == "cancelled"
    bench.close()


def test_stop_if_moving_leaves_alone_what_the_hand_and_the_computer_do(tmp_path):
    bench, go_on = new_workbench(Session(), tmp_path), threading.Event()
    robot = bench.rig().robot

    def work(progress, cancel):
        go_on.wait(20)
        return 1 if cancel() else 0

    hand = bench.jobs.start(StartPointerCapture(), work, device=True)
    search = bench.jobs.start(StartRollSearch(), work, device=False)
    assert not robot.state().moving
    assert not bench.stop_if_moving()
    go_on.set()
    for job in (hand, search):
        assert bench.jobs.wait(job.id, 20).state == "done"
    bench.close()


def test_stop_if_moving_stops_a_robot_that_moves_without_a_job(tmp_path):
    hub = build_registry(tmp_path, processes=False, pace=1.0)
    bench = hub.create()
    robot = bench.rig().robot
    robot.begin(bench.session.setup.devices.robot, 0)
    home = robot.state().q_rad
    robot.move([0.0, 60.0], [home, home + 0.1])
    assert robot.state().moving
    assert bench.stop_if_moving()
    assert not robot.state().moving
    assert not bench.stop_if_moving()
    hub.close_all()


def test_closing_does_not_wait_for_devices_that_are_being_built(tmp_path):
    building, built, closed, refused = (threading.Event() for _ in range(4))

    class Rig:
        def close(self):
            closed.set()

    def build(setup):
        building.set()
        built.wait(60)
        return Rig()

    def ask():
        with pytest.raises(DeviceError, match="closed"):
            bench.rig()
        refused.set()

    bench = Workbench(Session(), Services(build, None, None), tmp_path)
    threading.Thread(target=ask, daemon=True).start()
    assert building.wait(20)
    closing = threading.Thread(target=bench.close, daemon=True)
    closing.start()
    closing.join(20)
    assert not closing.is_alive()
    assert not closed.is_set()
    built.set()
    assert refused.wait(20)
    assert closed.is_set(), "who built them closes them"


def test_what_is_cancelled_while_the_copy_is_written_does_not_begin(tmp_path):
    writing, written = threading.Event(), threading.Event()

    def keep(session):
        writing.set()
        written.wait(60)

    held = Workbench(Session(), virtual_services(), tmp_path, keep)
    job = held.start(StartPointerCapture())
    assert writing.wait(20)
    held.jobs.cancel(job.id)
    written.set()
    ended = held.jobs.wait(job.id, 20)
    assert (ended.state, ended.error) == ("cancelled", "cancelled before it began")
    assert held.session.archive == ()
    held.close()


def test_what_is_cancelled_while_it_is_planned_does_not_move_the_robot(tmp_path, monkeypatch):
    planned = threading.Event()
    genuine = step.plan_tool_motion

    def plan(*args, **rest):
        planned.set()  # and Cancel is pressed
        return genuine(*args, **rest)

    monkeypatch.setattr(step, "plan_tool_motion", plan)
    bench = new_workbench(Session(), tmp_path)
    with pytest.raises(CancelledError, match="nothing was recorded"):
        bench.run(StartToolCapture(n_pivot=5, n_translate=3), cancel=planned.is_set)
    assert bench.session.archive == ()
    bench.close()


def test_a_capture_that_the_session_file_might_not_hold_is_refused_before_it_is_measured(
    tmp_path, monkeypatch
):
    bench = new_workbench(Session(), tmp_path)
    bench.run(StartPointerCapture(duration_s=5.0))
    monkeypatch.setattr(members, "MAX_STORED_BYTES", members.MAX_CAPTURE_BYTES + 1000)
    for begin in (bench.run, bench.start):
        with pytest.raises(StepBlockedError, match=r"holds 0 MB.*begin another session"):
            begin(StartPointerCapture())
    bench.run(StartRobotMove(tuple(np.rad2deg(bench.rig().robot.state().q_rad))))
    assert len(bench.session.archive) == 1
    bench.close()
