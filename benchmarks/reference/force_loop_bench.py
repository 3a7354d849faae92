"""A bench for the force loop: one axis over a surface whose true height is given.

No robot and no skull: the certified motion runs along a line, the surface lies off it by a known
offset along the tool axis. What the controller is told is what sensor and robot would tell it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import CONTACT, JR3, LOST
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.robot.force_control.controller import ContactController, ContactSample
from rona_core.virtual.robot.contact_dynamics import INNER_S, ContactSpring, LaggingAxis

START_MM = 4.0  # height of the face above the certified contact at the beginning
NOISE_N = 0.03
LONGEST_S = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class BenchRun:
    """What happened, one row for each step of the loop (n,)."""

    times_s: Floats
    way_mm: Floats  # along the path
    force_n: Floats  # true force of the spring
    travel_mm: Floats
    feed_share: Floats
    states: Ints
    setpoint_n: float
    stiffness_n_per_mm: float  # as estimated at the end
    reason: str  # why it stopped, empty if it came to the end
    n_losses: int

    @property
    def scanning(self) -> np.typing.NDArray[np.bool_]:
        """Return which steps (n,) moved along the path in contact."""
        return ((self.states == CONTACT) | (self.states == LOST)) & (self.way_mm > 0.0)

    @property
    def rms_n(self) -> float:
        """RMS deviation from the set point while scanning."""
        return float(np.sqrt(((self.force_n - self.setpoint_n)[self.scanning] ** 2).mean()))

    @property
    def peak_n(self) -> float:
        """Largest force of the whole run."""
        return float(self.force_n.max())

    @property
    def duration_s(self) -> float:
        """Time on the path."""
        return float(self.times_s[-1] - self.times_s[self.scanning][0])


def wave_mm(amplitude_mm: float = 2.0, length_mm: float = 60.0) -> Callable[[float], float]:
    """Return a surface (offset against the way) that swings by the amplitude about the map."""

    def offset_mm(way_mm: float) -> float:
        return amplitude_mm * float(np.sin(2.0 * np.pi * way_mm / length_mm))

    return offset_mm


def run_bench(
    settings: ContactSettings,
    *,
    offset_mm: Callable[[float], float],
    stiffness_n_per_mm: float | Callable[[float], float] = 2.0,
    speed_mm_per_s: float = 20.0,
    length_mm: float = 180.0,
    seed: int = 0,
    start_mm: float = START_MM,
    limit_feed: bool = True,
) -> BenchRun:
    """Press on, scan a line of some length, and return what happened.

    Args:
        settings: Of the control loop; the robot delays and lags exactly as they say.
        offset_mm: Depth of the true surface under the certified one at a way in mm.
        stiffness_n_per_mm: Of the contact, everywhere or at a way in mm.
        speed_mm_per_s: Scan speed of the certified motion.
        length_mm: Of the path.
        seed: Of the sensor's noise.
        start_mm: Height of the face above the certified surface at the beginning.
        limit_feed: False keeps the scan speed whatever the contact (to show what that does).
    """
    controller = ContactController(settings)
    axis = LaggingAxis(settings.delay_ms / 1000.0, settings.lag_ms / 1000.0, settings.travel_mm)
    given = stiffness_n_per_mm

    def stiffness(way_mm: float) -> float:
        return given(way_mm) if callable(given) else given

    spring = ContactSpring(stiffness(0.0))
    noise = np.random.default_rng((seed, 0xF0))
    step_n = JR3.force_range_n / JR3.steps
    period_s = settings.period_s
    looks = max(1, round(period_s / INNER_S))
    shares = np.arange(1, looks + 1) / looks
    rows: list[tuple[float, ...]] = []
    way, height, feed, scanning = 0.0, start_mm, 0.0, False
    for k in range(int(LONGEST_S / period_s)):
        time_s = k * period_s
        shown = spring.shown_n + noise.normal(0.0, NOISE_N)
        shown = round(shown / step_n) * step_n
        closing = 15.0 if height > 0.0 else 0.0
        on_path = speed_mm_per_s if scanning else 0.0
        travel = axis.travel_mm(time_s)
        command = controller.step(ContactSample(time_s, shown, travel, closing, on_path))
        rows.append((time_s, way, spring.force_n, travel, command.feed_share, command.state))
        if command.reason or way >= length_mm:
            break
        axis.command(time_s, command.velocity_mm_per_s)
        feed = command.feed_share
        if scanning and not limit_feed and command.ready:
            feed = 1.0
        scanning = scanning or (height <= 0.0 and command.ready)
        ways = way + shares * period_s * (feed * speed_mm_per_s if scanning else 0.0)
        heights = np.maximum(height - shares * period_s * feed * closing, 0.0)
        travels = np.array([axis.travel_mm(t) for t in time_s + shares * period_s])
        spring.stiffness_n_per_mm = stiffness(way)
        spring.advance(travels - heights - np.array([offset_mm(float(w)) for w in ways]))
        way, height = float(ways[-1]), float(heights[-1])
    table = np.array(rows)
    return BenchRun(
        times_s=readonly(table[:, 0]),
        way_mm=readonly(table[:, 1]),
        force_n=readonly(table[:, 2]),
        travel_mm=readonly(table[:, 3]),
        feed_share=readonly(table[:, 4]),
        states=readonly(table[:, 5].astype(np.int64)),
        setpoint_n=settings.force_n,
        stiffness_n_per_mm=controller.stiffness.n_per_mm,
        reason=controller.reason,
        n_losses=controller.n_losses,
    )
