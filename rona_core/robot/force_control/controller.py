"""The force loop along the tool axis: presses on, keeps the force, and stops when it cannot.

One step a control period, in: what sensor and robot say; out: a speed along the tool axis and a
share of the scan speed. It knows nothing of where the surface really is. See
docs/algorithms/robot/force_control.md.
"""

from dataclasses import dataclass

from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import APPROACH, CONTACT, LOST, STOPPED
from rona_core.geometry.arrays import clamped
from rona_core.robot.force_control.gains import contact_gain, feed_share
from rona_core.robot.force_control.stiffness import StiffnessEstimate

TOUCH_N = 0.3  # from here on something is touched: ten times the noise of the sensor
PRESSED_SHARE = 0.5  # of the set point at which the touch-down ends and control begins
LEARN_S = 0.25  # after that, the stiffness is still learnt from the touch-down
LOST_N, LOST_S = 0.3, 0.1  # less force than this for so long is no contact
SEEK_S = 3.0  # a lost surface is sought so long, at most to the end of the travel
AT_LIMIT_S = 0.25  # at an end of the travel for so long without the force: stop
MONITOR_S = 0.5  # above the monitored force for so long: stop
SETTLED_N, SETTLED_S = 0.4, 0.25  # the scan begins when the force has kept so close for so long
FREE_ERROR_N, HALT_ERROR_N = 1.5, 6.0  # force error from which the scan slows, and where it halts
RISE_PER_S, FALL_PER_S = 1.0, 5.0  # how fast the share of the scan speed may change
SLOWEST_RISE = 0.1  # of that rise
MOST_MM_PER_S = 15.0  # of the correction
WATCHDOG_PERIODS = 4.0  # a reading later than this many periods is a failure
STIFFNESS_N_PER_MM = 2.0  # what is expected before the first touch: that of the delay line


@dataclass(frozen=True, slots=True)
class ContactSample:
    """Inputs of one control step."""

    time_s: float
    force_n: float  # pressing force along the tool axis, weight taken off
    travel_mm: float  # correction reached, positive into the surface, as the robot reports it
    closing_mm_per_s: float = 0.0  # speed of the certified motion along the tool axis, feed 1
    path_mm_per_s: float = 0.0  # speed of the certified motion along the scan path, feed 1
    saturated: bool = False  # the sensor is at the end of its range


@dataclass(frozen=True, slots=True)
class ContactCommand:
    """What one step asks of the robot until the next."""

    state: int  # code as in devices.force.STATES
    velocity_mm_per_s: float  # of the correction, positive into the surface
    feed_share: float  # of the certified speed
    ready: bool  # pressed on and settled: the scan may go on
    reason: str = ""  # why it stopped


class ContactController:
    """Keeps its state between steps; the same samples give the same commands."""

    def __init__(self, settings: ContactSettings, *, travel_mm: float | None = None) -> None:
        """Begin before contact.

        Args:
            settings: Set point, delays and limits.
            travel_mm: Width of the certified band, where it is narrower than the settings allow.
        """
        self.settings = settings
        self.stiffness = StiffnessEstimate(STIFFNESS_N_PER_MM, settings.period_s)
        self._travel_mm = settings.travel_mm if travel_mm is None else travel_mm
        self._state = APPROACH
        self._reason = ""
        self._integral_mm_per_s = 0.0
        self._feed = 1.0
        self._ready = False  # pressed on and settled, since the last time that it was not
        self._place_mm = 0.0  # way of the certified motion along the tool axis so far
        self._last_s: float | None = None
        self._since: dict[str, float] = {}  # conditions that hold, and since when
        self.n_losses = 0

    @property
    def state(self) -> int:
        """Code of the state now."""
        return self._state

    @property
    def reason(self) -> str:
        """Why it stopped, empty while it has not."""
        return self._reason

    def stop(self, reason: str) -> None:
        """Stop for a reason from outside; the first reason stays."""
        if self._state != STOPPED:
            self._state, self._reason = STOPPED, reason

    def step(self, sample: ContactSample) -> ContactCommand:
        """Return what to do until the next sample."""
        if self._last_s is not None:
            self._place_mm += (sample.time_s - self._last_s) * self._feed * sample.closing_mm_per_s
        self._check_limits(sample)
        self._change_state(sample)
        self._last_s = sample.time_s
        if self._state == STOPPED:
            self._feed = 0.0
            away = -self.settings.approach_mm_per_s if sample.force_n > LOST_N else 0.0
            return ContactCommand(STOPPED, away, 0.0, False, self._reason)
        self._ramp_feed(self._wanted_feed(sample))
        velocity = self._velocity(sample)
        return ContactCommand(self._state, velocity, self._feed, self._ready)

    def _check_limits(self, sample: ContactSample) -> None:
        """Stop where a limit of force, travel or time is passed."""
        settings, force = self.settings, sample.force_n
        late = WATCHDOG_PERIODS * settings.period_s
        if self._last_s is not None and not 0.0 < sample.time_s - self._last_s <= late:
            self.stop(f"the force sensor was silent for {sample.time_s - self._last_s:.2g} s")
        if sample.saturated:
            self.stop("the force sensor is at the end of its range")
        if force > settings.stop_n:
            self.stop(f"the force reached {force:.1f} N, {settings.stop_n:g} N stop the robot")
        if self._lasts("heavy", force > settings.monitor_n, sample, MONITOR_S):
            self.stop(f"the force stayed above {settings.monitor_n:g} N, at last {force:.1f} N")
        error_n = settings.force_n - force
        outward = abs(sample.travel_mm) >= self._travel_mm - 0.01 and error_n * sample.travel_mm > 0
        far = outward and abs(error_n) > SETTLED_N
        if self._lasts("far", far, sample, AT_LIMIT_S):
            missing = force < TOUCH_N
            what = "no surface was met" if missing else f"the force is {force:.1f} N"
            before = "contact was lost: " if self._state == LOST else ""
            self.stop(
                f"{before}{what} at the end of the certified travel, {sample.travel_mm:+.1f} mm"
            )

    def _change_state(self, sample: ContactSample) -> None:
        settings, force = self.settings, sample.force_n
        if self._state in (APPROACH, LOST):
            if force >= TOUCH_N:
                self.stiffness.touching(self._place_mm + sample.travel_mm, force)
            if force >= PRESSED_SHARE * settings.force_n:
                self._state = CONTACT
                self._integral_mm_per_s = 0.0
                self._since = {"contact": sample.time_s}
            elif self._state == LOST and self._lasts("seeking", True, sample, SEEK_S):
                self.stop(f"contact was lost: no surface was met within {SEEK_S:g} s")
        elif self._state == CONTACT:
            if sample.time_s - self._since["contact"] < LEARN_S:
                self.stiffness.touching(self._place_mm + sample.travel_mm, force)
            else:
                self.stiffness.watching(sample.travel_mm, force)
            close = abs(settings.force_n - force) < SETTLED_N
            self._ready = self._lasts("settled", close, sample, SETTLED_S) or self._ready
            if self._lasts("loose", force < LOST_N, sample, LOST_S):
                self._state, self._ready = LOST, False
                self.n_losses += 1
                self._since = {}
                self.stiffness.touch_again()

    def _wanted_feed(self, sample: ContactSample) -> float:
        """Return the share of the certified speed that suits the state and the contact."""
        closing = abs(sample.closing_mm_per_s)
        slow = self.settings.approach_mm_per_s
        gentle = 1.0 if closing <= slow else slow / closing  # on the line towards the surface
        if self._state == APPROACH:
            return gentle
        if self._state == LOST or (not self._ready and closing == 0.0):
            return 0.0  # the surface has to keep still until the force does
        error_n = abs(self.settings.force_n - sample.force_n)
        calm = (HALT_ERROR_N - error_n) / (HALT_ERROR_N - FREE_ERROR_N)
        if sample.force_n > self.settings.monitor_n:
            calm = 0.0
        share = feed_share(self.stiffness.n_per_mm, self.settings, sample.path_mm_per_s)
        return min(gentle, share, clamped(calm, 0.0, 1.0))

    def _ramp_feed(self, wanted: float) -> None:
        up, down = RISE_PER_S * self.settings.period_s, FALL_PER_S * self.settings.period_s
        up *= max(wanted, SLOWEST_RISE)  # a contact that has to be slow is set going slowly too
        self._feed += clamped(wanted - self._feed, -down, up)

    def _velocity(self, sample: ContactSample) -> float:
        """Return the speed of the correction, within the travel and without wind-up."""
        settings, period_s = self.settings, self.settings.period_s
        low = max(-MOST_MM_PER_S, (-self._travel_mm - sample.travel_mm) / period_s)
        high = min(MOST_MM_PER_S, (self._travel_mm - sample.travel_mm) / period_s)
        low, high = min(low, 0.0), max(high, 0.0)
        if self._state in (APPROACH, LOST):
            closing = self._feed * sample.closing_mm_per_s
            return clamped(settings.approach_mm_per_s - closing, low, high)
        gain = contact_gain(self.stiffness.n_per_mm, settings)
        error_n = settings.force_n - sample.force_n
        integral = self._integral_mm_per_s + gain.integral * error_n * period_s
        wanted = gain.proportional * error_n + integral
        if low <= wanted <= high or (wanted > high) != (error_n > 0.0):
            self._integral_mm_per_s = integral  # not where it would wind up against a limit
        return clamped(wanted, low, high)

    def _lasts(self, name: str, condition: bool, sample: ContactSample, for_s: float) -> bool:
        """Return whether a condition has held for some time without a break."""
        if not condition:
            self._since.pop(name, None)
            return False
        return sample.time_s - self._since.setdefault(name, sample.time_s) >= for_s
