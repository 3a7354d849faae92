"""Drive a scan with the force loop: press on, follow the path, lift off; every step recorded."""

from bisect import bisect_right

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.devices.live import RecordedSoFar
from rona_core.devices.samples import AScan, JointSample
from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import (
    APPROACH,
    CONTACT,
    FREE,
    RETRACT,
    STOPPED,
    ForceNow,
    ForceTrack,
    LoopRow,
    ToolLoad,
    WrenchSample,
    force_now,
    force_track,
)
from rona_core.geometry.arrays import Floats, clamped, interpolated
from rona_core.robot.force_control.controller import (
    FALL_PER_S,
    MOST_MM_PER_S,
    TOUCH_N,
    ContactController,
    ContactSample,
)
from rona_core.robot.force_control.correction_corridor import CorrectionCorridor
from rona_core.robot.force_control.gravity_compensation import pressing_force_n, probe_axis_sensor
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory

SLOWING_MM = 2.5  # way in which the approach slows down before a surface can be met
LIFTED_MM = 6.0  # from here on the correction may be taken back
RETURN_S, RETURNED_MM = 0.3, 0.005  # how the correction is taken back, and how exactly
BACK_MM_PER_S, BACK_S = 5.0, 2.5  # after a stop the probe is drawn back so fast, for so long
LIFT_SCANS_S = 0.6  # A-scans are fired for so long while lifting off, to compare the clocks
MOST_CLOCK_SCANS = 160
SHOWN_EVERY = 8  # rows of the loop: the force is shown live eight times a second
COLLECT = 32  # A-scans that are fetched from the probe at once


class ContactLoop:
    """One scan in contact; ``run`` carries it out, the lists hold what it recorded.

    Attributes:
        most_clock_scans: A-scans that are fired at most while the probe comes and leaves, to
            compare the clocks; 0 where they are known.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        band: CorrectionCorridor,
        places_s: Floats,
        settings: ContactSettings,
        load: ToolLoad,
        model: RobotModel,
        context: ActivityContext,
    ) -> None:
        """Prepare the scan.

        Args:
            trajectory: The certified motion.
            band: The same with room along the tool axis, certified too.
            places_s: Times of the motion (n,) at which the probe is to fire.
            settings: Of the force loop.
            load: What hangs on the force sensor.
            model: The robot with its tool.
            context: Devices, live slots, cancel and progress.
        """
        self.scans: list[AScan] = []
        self.clock_scans: list[AScan] = []
        self.joints: list[JointSample] = []
        self.partial, self.most_clock_scans = False, MOST_CLOCK_SCANS
        self.near_s: float | None = None  # when the probe came near the bone
        self._rows: list[LoopRow] = []
        self._shown: ForceNow | None = None
        self._fired = self._n_clock = 0  # along the path, and to compare the clocks
        self._destinations: list[list[AScan]] = []  # of A-scans that the probe still keeps
        self._trajectory, self._band, self._places_s = trajectory, band, places_s
        self._settings, self._load, self._model, self._context = settings, load, model, context
        self._controller = ContactController(settings, travel_mm=band.travel_mm)
        self._axis_sensor = probe_axis_sensor(model)
        self._feed = 1.0
        self._stopped_s = np.inf
        self._pressed_on = False  # once: from then on the scan has begun
        times = trajectory.times_s
        self._times, self._way_mm = times.tolist(), trajectory.path_mm.tolist()
        probes = model.forward(trajectory.qs_rad) @ model.T_flange_probe
        steps = np.diff(probes.translations, axis=0)
        spans = np.diff(times)
        on_path = (times[:-1] >= trajectory.scan_start_s - 1e-9) & (
            times[:-1] < trajectory.scan_end_s - 1e-9
        )
        closing = np.einsum("ij,ij->i", steps, probes.rotations[:-1, :, 2]) / spans
        self._closing = np.where(on_path, 0.0, closing)
        self._path_speed = np.diff(trajectory.path_mm) / spans
        guided = np.flatnonzero(band.guided)
        first = int(np.argmin(np.abs(times - trajectory.scan_start_s)))
        last = int(np.argmin(np.abs(times - trajectory.scan_end_s)))
        height = np.linalg.norm(probes.translations - probes.translations[first], axis=1)
        near = guided[(guided <= first) & (height[guided] <= band.travel_mm + SLOWING_MM)]
        self._zone_s = float(times[near[0]])
        self._line_end_s = float(times[guided[-1]])
        self._lift_mm = np.linalg.norm(probes.translations - probes.translations[last], axis=1)

    def run(self) -> None:
        """Carry out the scan; a stop or a cancellation leaves what came so far."""
        rig, clock, period_s = self._context.rig, self._context.rig.clock, self._settings.period_s
        self._motion = rig.robot.guide(
            self._trajectory.times_s, self._band.qs_rad, self._band.travels_mm
        )
        self.joints.append(rig.robot.state())
        start_s, step = clock.now(), 0
        while not self._motion.done():
            if self._context.cancel():
                rig.robot.stop()
                self.partial = True
                break
            now_s = start_s + step * period_s
            clock.wait_until(now_s)
            velocity, feed = self._step(now_s)
            self._motion.correct(velocity, feed)
            self._feed = feed
            self._fire(now_s, feed)
            if self._controller.state == STOPPED and self._drawn_back(now_s):
                rig.robot.stop()
            step += 1
        self._collect()
        self.partial |= self._fired < len(self._places_s)

    def track(self) -> ForceTrack:
        """Return the record of the loop."""
        return force_track(
            self._rows,
            setpoint_n=self._settings.force_n,
            stiffness_n_per_mm=self._controller.stiffness.n_per_mm,
            band_mm=self._band.travel_mm,
            load=self._load,
            reason=self._controller.reason,
        )

    def _step(self, now_s: float) -> tuple[float, float]:
        """Look at the devices; return speed of the correction and share of the motion's speed."""
        reached_s = self._motion.reached_s()
        state = self._context.rig.robot.state()
        self._context.live.put(joints=state)
        if reached_s < self._zone_s or reached_s > self._line_end_s + 1e-9:
            return 0.0, 1.0  # nowhere near the bone
        if self.near_s is None:
            self.near_s = now_s
        if now_s > self.joints[-1].time_s:
            self.joints.append(state)
        sample = self._context.rig.force.read()
        up_sensor = self._model.up_flange(state.q_rad)
        force_n = pressing_force_n(self._load, up_sensor, sample.wrench, self._axis_sensor)
        travel_mm = self._motion.travel_mm()
        lifting = reached_s >= self._trajectory.scan_end_s - 1e-9
        if lifting and self._controller.state != STOPPED:
            code, velocity, feed = self._lift(reached_s, travel_mm)
        else:
            code, velocity, feed = self._press(reached_s, travel_mm, force_n, sample)
        way_mm = interpolated(reached_s, self._times, self._way_mm)
        self._rows.append(LoopRow(sample, force_n, code, travel_mm, feed, way_mm))
        if len(self._rows) % SHOWN_EVERY == 0:
            newest = self._rows[-SHOWN_EVERY:]
            self._shown = force_now(newest, self._settings.force_n, self._shown)
            self._context.live.put(force=self._shown)
        return velocity, feed

    def _press(
        self, reached_s: float, travel_mm: float, force_n: float, sample: WrenchSample
    ) -> tuple[int, float, float]:
        """Let the controller decide, but hold at the start of the path until it is ready."""
        i = self._index(reached_s)
        command = self._controller.step(
            ContactSample(
                time_s=sample.time_s,
                force_n=force_n,
                travel_mm=travel_mm,
                closing_mm_per_s=float(self._closing[i]),
                path_mm_per_s=float(self._path_speed[i]),
                saturated=sample.saturated,
            )
        )
        feed = command.feed_share
        if command.state == STOPPED:
            self._stopped_s = min(self._stopped_s, sample.time_s)
            return command.state, -BACK_MM_PER_S, 0.0
        if command.ready and reached_s >= self._trajectory.scan_start_s - 1e-9:
            self._pressed_on = True
        if not self._pressed_on:
            left_s = self._trajectory.scan_start_s - reached_s
            feed = min(feed, max(left_s, 0.0) / self._settings.period_s)
        touching = command.state in (APPROACH, CONTACT) and force_n > TOUCH_N
        if touching and not self._pressed_on and self._n_clock < self.most_clock_scans // 2:
            self._fire_for(self.clock_scans)
        return command.state, command.velocity_mm_per_s, feed

    def _lift(self, reached_s: float, travel_mm: float) -> tuple[int, float, float]:
        """Leave the bone along the certified line, then take the correction back."""
        period_s = self._settings.period_s
        feed = min(1.0, self._feed + FALL_PER_S * period_s)
        lifted_mm = float(self._lift_mm[self._index(reached_s)])
        early = reached_s < self._trajectory.scan_end_s + LIFT_SCANS_S
        if early and self._n_clock < self.most_clock_scans:
            self._fire_for(self.clock_scans)
        if lifted_mm < min(LIFTED_MM, float(self._lift_mm[self._index(self._line_end_s)]) - 0.1):
            return RETRACT, 0.0, feed
        velocity = clamped(-travel_mm / RETURN_S, -MOST_MM_PER_S, MOST_MM_PER_S)
        if abs(travel_mm) > RETURNED_MM:
            feed = min(feed, max(self._line_end_s - reached_s, 0.0) / period_s)
        return (FREE if abs(travel_mm) <= RETURNED_MM else RETRACT), velocity, feed

    def _fire(self, now_s: float, feed: float) -> None:
        """Fire at the places that are passed before the next step, each at its own instant."""
        rig, reached_s = self._context.rig, self._motion.reached_s()
        while self._pressed_on and feed > 0.0 and self._fired < len(self._places_s):
            ahead_s = float(self._places_s[self._fired]) - reached_s
            if ahead_s >= feed * self._settings.period_s:
                return
            rig.clock.wait_until(now_s + max(ahead_s, 0.0) / feed)
            self._fired += 1
            self._fire_for(self.scans)
            self._context.progress(self._fired / len(self._places_s))

    def _fire_for(self, scans: list[AScan]) -> None:
        """Fire now; the A-scan goes to ``scans`` when some have come together."""
        self._context.rig.probe.fire()
        self._destinations.append(scans)
        self._n_clock += scans is self.clock_scans
        if len(self._destinations) >= COLLECT:
            self._collect()

    def _collect(self) -> None:
        """Fetch the A-scans that the probe keeps."""
        for scans, scan in zip(self._destinations, self._context.rig.probe.collect(), strict=True):
            scans.append(scan)
        self._destinations = []
        if self.scans:
            so_far = RecordedSoFar(tuple(self.scans), tuple(self.joints))
            self._context.live.put(ascan=self.scans[-1], n_scans=self._fired, recorded=so_far)

    def _drawn_back(self, now_s: float) -> bool:
        """Return whether the probe has been drawn back far enough after a stop."""
        far = self._motion.travel_mm() <= -self._band.travel_mm + 0.05
        return far or now_s - self._stopped_s > BACK_S

    def _index(self, reached_s: float) -> int:
        i = bisect_right(self._times, reached_s + 1e-9) - 1
        return min(max(i, 0), len(self._times) - 2)
