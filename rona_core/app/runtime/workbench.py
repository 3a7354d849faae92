"""One open session with its devices and jobs: the service that browser, REST and scripts share."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from rona_core.app.declarations.declarations import (
    ActivityContext,
    Compute,
    ImportSkull,
    Message,
    Rehearse,
    Sweep,
    compute_here,
)
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import require_for
from rona_core.app.messages.message import Answer, require_exact
from rona_core.app.runtime.jobs import Ended, Jobs, JobStatus
from rona_core.app.runtime.process_pool import release_memory, use_one_thread
from rona_core.app.runtime.store import Change, Store
from rona_core.devices.live import Live
from rona_core.devices.protocols import Cancel, Operator, Progress, Rig, never, silent
from rona_core.errors import CancelledError, DeviceError, InvalidInputError
from rona_core.mapping.comparison.map_errors import MapErrors
from rona_core.session.captures import is_imported
from rona_core.session.codec import digest
from rona_core.session.document import Session, Setup
from rona_core.session.members import require_room_for_capture
from rona_core.session.memo import Memo, forget_all

Figures = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Services:
    """What ``compose`` supplies: how to build devices, to read skulls and to judge results."""

    build_rig: Callable[[Setup], Rig]
    import_skull: ImportSkull
    evaluate: Callable[[Session, Rig], Figures] | None  # None where no ground truth exists
    compute: Compute = compute_here
    sweep: Sweep | None = None  # over virtual plates
    rehearse: Rehearse | None = None  # a milling, on virtual bone
    predict: Callable[[Session], Figures] = lambda session: {}  # where no ground truth exists
    map_errors: Callable[[Session, Rig], MapErrors] | None = None  # None as with ``evaluate``
    check_bone: Callable[[Setup], None] | None = None  # raises where no devices can be built


def _keep_nothing(session: Session) -> None:
    """Keep no copy: the session lives in this program alone."""


class Workbench:
    """Holds the store, the live slots, the devices and the jobs of one session."""

    def __init__(
        self,
        session: Session,
        services: Services,
        uploads: Path,
        keep: Callable[[Session], None] = _keep_nothing,
    ) -> None:
        """Open ``session``; ``keep`` makes sure that a copy holds it, before a change counts."""
        use_one_thread()
        self.store = Store(session, self._accept)
        self.live = Live()
        self.jobs = Jobs()
        self.uploads = uploads
        self._services = services
        self._keep = keep
        self._rig_lock = threading.Lock()
        self._rig: tuple[str, Rig] | None = None
        self._judged: Memo[Figures] = Memo(1)
        self._closed = False

    @property
    def closed(self) -> bool:
        """Whether the session has been closed."""
        return self._closed

    @property
    def session(self) -> Session:
        """The session now."""
        return self.store.session

    def rig(self) -> Rig:
        """Return the devices that fit the set-up; they are built anew where it has changed.

        While a job uses the devices they stay as they are.
        """
        held = self._rig
        if held is not None and self.jobs.devices_busy:
            return held[1]
        return self._fitting_rig()

    def _fitting_rig(self) -> Rig:
        setup = self.session.setup
        robot = setup.devices.robot
        place = setup.devices.tracker.place
        where = [robot.model, robot.base_shift_mm, robot.base_turn_deg, digest(place)]
        bone = [digest(part) for part in (setup.specimen, setup.region, setup.bone, setup.world)]
        key = digest([setup.seed, *bone, *where])
        with self._rig_lock:
            if self._closed:
                raise DeviceError("the session is closed, and its devices with it")
            if self._rig is None or self._rig[0] != key:
                rig = self._services.build_rig(setup)
                if self._rig is not None:
                    self._rig[1].close()
                    self.live.clear()  # the new ones stand at rest
                self._rig = (key, rig)
            held = self._rig[1]
        if self._closed:  # in the meantime: closing does not wait for devices that are being built
            self._release()
            raise DeviceError("the session is closed, and its devices with it")
        return held

    def _accept(self, before: Session, after: Session) -> None:
        """Refuse a region that is off the bone now, not when the devices are built for a step."""
        check, old, new = self._services.check_bone, before.setup, after.setup
        same = old.specimen is new.specimen and old.seed == new.seed and old.region == new.region
        if check is not None and not same:
            check(new)

    def dispatch(self, command: Message) -> Change:
        """Change the session by a public command, and keep that; errors as in `Store.dispatch`."""
        if type(command).__name__ not in REGISTRY.commands:
            raise InvalidInputError(f"{type(command).__name__} is not a command")
        require_exact(command)
        change = self.store.dispatch(command)
        self._keep(change.session)
        return change

    def run(
        self, activity: Message, progress: Progress = silent, cancel: Cancel = never
    ) -> Session:
        """Carry out an activity here and now, and store what it produced."""
        require_exact(activity)
        self._require_room_for(activity)
        self._carry_out(activity, progress, cancel)
        return self.session

    def start(self, activity: Message) -> JobStatus:
        """Start an activity as a job and return at once.

        Raises:
            StepBlockedError: an earlier step is missing or stale, or the session is full.
            DeviceError: the devices are busy with another job.
            InvalidInputError: a field has a value of another type.
        """
        require_exact(activity)
        require_for(activity, self.session)
        self._require_room_for(activity)

        def work(progress: Progress, cancel: Cancel) -> Ended:
            self._keep(self.session)
            if cancel():  # writing the copy takes a moment
                raise CancelledError("cancelled before it began")
            return self._carry_out(activity, progress, cancel)

        return self.jobs.start(activity, work, device=REGISTRY.activity(activity).uses_devices)

    def _require_room_for(self, activity: Message) -> None:
        if REGISTRY.activity(activity).makes:
            require_room_for_capture(self.session.archive)

    def _carry_out(self, activity: Message, progress: Progress, cancel: Cancel) -> Ended:
        session = self.session
        require_for(activity, session)
        devices = self.rig
        declared = REGISTRY.activity(activity)
        if declared.uses_devices:
            rig = self._fitting_rig()  # stays the same until the activity ends

            def devices() -> Rig:
                return rig

        context = ActivityContext(
            devices=devices,
            live=self.live,
            import_skull=self._services.import_skull,
            uploads=self.uploads,
            compute=self._services.compute,
            sweep=self._services.sweep,
            rehearse=self._services.rehearse,
            progress=progress,
            cancel=cancel,
        )
        found = None
        try:
            for message in declared.perform(activity, session, context):
                if isinstance(message, Answer):
                    found = message.value
                else:
                    self.store.dispatch(message)
        finally:  # what was stored before another message was refused is kept too
            self._keep(self.session)
        return Ended(self.store.revision, found)

    def stop(self) -> None:
        """Stop the robot and end what uses the devices; always allowed, wins over everything.

        It waits for no lock, so that a rig that is being built does not delay it.
        """
        self.jobs.cancel_device_job()
        held = self._rig
        if held is not None:
            held[1].robot.stop()

    def stop_if_moving(self) -> bool:
        """Stop like ``stop`` if the robot moves or is about to; return whether it was so.

        What the hand does alone is left to go on: it ends by ``Jobs.cancel``.
        """
        running = REGISTRY.activities.get(self.jobs.device_activity or "")
        if running is None or not running.drives_robot:
            held = self._rig
            if held is None or not held[1].robot.state().moving:
                return False
        self.stop()
        return True

    def turn_pointer(self, wxyz: ArrayLike) -> None:
        """Turn the pointer about its tip while it is pivoted by hand; live, not a command.

        Args:
            wxyz: Unit quaternion (4,) relative to the start, along the axes of ``base``.

        Raises:
            InvalidInputError: no unit quaternion.
            DeviceError: no capture by hand is under way.
        """
        self._hand().turn(wxyz)

    def finish_pointer(self) -> None:
        """End the pivoting by hand; what was recorded is calibrated.

        Raises:
            DeviceError: no capture by hand is under way.
        """
        self._hand().finish()

    def pointer_in_hand(self) -> bool:
        """Return whether the pointer is pivoted by hand now."""
        held = self._rig
        return held is not None and held[1].operator.in_hand()

    def _hand(self) -> Operator:
        held = self._rig
        if held is None or not held[1].operator.in_hand():
            raise DeviceError("no pivot by hand is under way: start the capture by hand first")
        return held[1].operator

    def map_errors(self) -> MapErrors:
        """Return the errors of the robot's maps against ground truth.

        Raises:
            DeviceError: the devices are real, or the scan was imported: there is no ground truth.
            StepBlockedError: nothing was mapped.
        """
        judge = self._services.map_errors
        if judge is None:
            raise DeviceError("the true bone is known with virtual devices alone: give a reference")
        if is_imported(self.session.captures.scan):
            raise DeviceError("the scan was imported, its true bone is not known: give a reference")
        return judge(self.session, self.rig())

    def figures(self) -> Figures:
        """Return the figures against ground truth; where there is none, only predicted ones."""
        evaluate = self._services.evaluate
        if evaluate is None:
            return dict(self._services.predict(self.session))
        session = self.session
        seen = (session.setup, session.captures, session.results)

        def judge() -> Figures:
            release_memory()
            return evaluate(session, self.rig())

        # while devices are busy they may be those of an earlier set-up
        figures = judge() if self.jobs.devices_busy else self._judged.get(seen, judge)
        return dict(figures)

    def close(self) -> None:
        """Stop, and release devices and threads; a second call does nothing."""
        self._closed = True
        self.jobs.cancel_all()
        self.stop()
        self.store.close()
        self._release()
        forget_all()

    def _release(self) -> None:
        """Close the devices; where they are being built, the builder closes them."""
        if self._rig_lock.acquire(blocking=False):
            held, self._rig = self._rig, None
            self._rig_lock.release()
            if held is not None:
                held[1].close()
