"""The force loop along the tool axis: presses on, keeps the force, and stops when it cannot.

One step a control period, in: what sensor and robot say; out: a speed along the tool axis and a
share of the scan speed. It knows nothing of where the surface really is. See
docs/algorithms/robot/force_control.md.

How hard the force loop may pull: gains from delay and stiffness, and the speed that follows. The
contact is a spring K behind a robot that integrates speed after a dead time: F/v = K e^{-sT}/s. See
docs/algorithms/robot/force_control.md.
"""

import math
from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require
from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import APPROACH, CONTACT, JR3, LOST, STOPPED
from rona_core.geometry.arrays import clamped

GAIN_SHARE = 0.3  # of the gain at which the loop oscillates undamped
RESET_DELAYS = 5.0  # integration time over the dead time
ERROR_MM, ERROR_LENGTH_MM = 2.0, 60.0  # misplaced surface that is reckoned with: a wave
ALLOWED_RMS_N = 0.7  # of the force over such a surface; a stiffer contact is scanned slower
LEAST_SHARE = 0.02  # of the scan speed


def dead_time_s(settings: ContactSettings) -> float:
    """Return the dead time of the loop: transport, half a period, the robot and the filter."""
    own_ms = settings.delay_ms + settings.period_ms / 2.0 + settings.lag_ms
    return own_ms / 1000.0 + 1.0 / (2.0 * math.pi * JR3.cutoff_hz)


@dataclass(frozen=True, slots=True)
class ContactGain:
    """Proportional (mm/s/N) and integral (mm/s^2/N) gain, and the gain at which it would ring."""

    proportional: float
    integral: float
    critical: float


def contact_gain(stiffness_n_per_mm: float, settings: ContactSettings) -> ContactGain:
    """Return the gains for a contact of this stiffness: k_crit = pi / (2 K T)."""
    delay_s = dead_time_s(settings)
    critical = math.pi / (2.0 * stiffness_n_per_mm * delay_s)
    proportional = GAIN_SHARE * critical
    return ContactGain(proportional, proportional / (RESET_DELAYS * delay_s), critical)


def speed_limit_mm_per_s(stiffness_n_per_mm: float, settings: ContactSettings) -> float:
    """Return the scan speed at which the wavy surface costs the RMS force error that is allowed.

    The loop answers a surface moving as w(s) with the force error K s^2 w / (s^2 + c s + c / T_i),
    c = K k_p; the dead time is left out, as it matters only far above the wave's frequency. A
    contact so soft that the error is never reached has no limit: infinity.
    """
    gain = contact_gain(stiffness_n_per_mm, settings)
    c = stiffness_n_per_mm * gain.proportional
    b = stiffness_n_per_mm * gain.integral
    allowed2 = 2.0 * ALLOWED_RMS_N**2
    # |e|^2 = allowed2 is a quadratic in omega^2
    a2 = (stiffness_n_per_mm * ERROR_MM) ** 2 - allowed2
    a1 = -allowed2 * (c**2 - 2.0 * b)
    a0 = -allowed2 * b**2
    if a2 <= 0.0:
        return float("inf")  # such a soft contact never reaches it
    root = (-a1 + math.sqrt(a1**2 - 4.0 * a2 * a0)) / (2.0 * a2)
    return math.sqrt(root) * ERROR_LENGTH_MM / (2.0 * math.pi)


def feed_share(
    stiffness_n_per_mm: float, settings: ContactSettings, speed_mm_per_s: float
) -> float:
    """Return the share of the scan speed at which this contact can be kept, LEAST_SHARE to 1."""
    if speed_mm_per_s <= 0.0:
        return 1.0
    limit = speed_limit_mm_per_s(stiffness_n_per_mm, settings)
    return clamped(limit / speed_mm_per_s, LEAST_SHARE, 1.0)


LOWEST, HIGHEST = 0.1, 400.0  # N/mm that are believed
HIGH_PASS_S = 0.15  # slower motion follows the surface and says nothing of the spring
MEMORY_S = 0.5
LEAST_MOTION_MM = 0.02  # rms, below which only noise is compared
LEAST_CORRELATION = 0.8  # between force and travel; following a surface they are out of step
RISE_S = 0.1  # a stiffer contact is believed at once; a softer one after the next touch-down
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0)  # n, z, F, zz, zF of a touch-down that has not begun


class StiffnessEstimate:
    """Stiffness in N/mm from pressing force and place of the probe along the tool axis.

    Touching down on a surface that keeps still, force over place is a line: its slope counts.
    Afterwards travel and force are compared above 1 Hz. Where the robot follows a surface, force
    and travel are a quarter of a period apart and tell nothing; where the loop begins to ring,
    they go together, and their ratio is the stiffness. What they say can only be too low, because
    part of the travel follows the surface: so it raises the estimate and never lowers it.
    """

    def __init__(self, expected_n_per_mm: float, period_s: float) -> None:
        """Start from what is expected before anything is known."""
        require(LOWEST <= expected_n_per_mm <= HIGHEST, "stiffness must be 0.1 to 400 N/mm")
        self.n_per_mm = expected_n_per_mm
        self._keep = float(np.exp(-period_s / HIGH_PASS_S))
        self._fade = float(np.exp(-period_s / MEMORY_S))
        self._rise = 1.0 - float(np.exp(-period_s / RISE_S))
        self._sums = NOTHING
        self._last: tuple[float, float] | None = None
        self._high = (0.0, 0.0)
        self._moments = (0.0, 0.0, 0.0)

    def touching(self, place_mm: float, force_n: float) -> None:
        """Learn from one step of the touch-down; ``place_mm`` grows into the surface."""
        z, f = place_mm, force_n
        n, sz, sf, szz, szf = self._sums
        n, sz, sf, szz, szf = n + 1.0, sz + z, sf + f, szz + z * z, szf + z * f
        self._sums = n, sz, sf, szz, szf
        spread = n * szz - sz**2
        if n >= 3 and spread > (n * LEAST_MOTION_MM) ** 2:
            self._believe((n * szf - sz * sf) / spread)

    def touch_again(self) -> None:
        """Forget the line of the last touch-down, not what it taught."""
        self._sums = NOTHING
        self._last = None

    def watching(self, travel_mm: float, force_n: float) -> None:
        """Learn from one step of the scan."""
        if self._last is not None:
            high_z = self._keep * (self._high[0] + travel_mm - self._last[0])
            high_f = self._keep * (self._high[1] + force_n - self._last[1])
            self._high = high_z, high_f
            zz, zf, ff = self._moments
            self._moments = (
                self._fade * zz + high_z * high_z,
                self._fade * zf + high_z * high_f,
                self._fade * ff + high_f * high_f,
            )
            self._judge()
        self._last = travel_mm, force_n

    def _judge(self) -> None:
        zz, zf, ff = self._moments
        weight = 1.0 / (1.0 - self._fade)
        if zz < weight * LEAST_MOTION_MM**2 or zf < LEAST_CORRELATION * math.sqrt(zz * ff):
            return
        seen = zf / zz
        if seen > self.n_per_mm:
            self._believe(self.n_per_mm + self._rise * (seen - self.n_per_mm))

    def _believe(self, n_per_mm: float) -> None:
        self.n_per_mm = clamped(n_per_mm, LOWEST, HIGHEST)


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
