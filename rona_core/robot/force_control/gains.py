"""How hard the force loop may pull: gains from delay and stiffness, and the speed that follows.

The contact is a spring K behind a robot that integrates speed after a dead time: F/v = K e^{-sT}/s.
See docs/algorithms/robot/force_control.md.
"""

import math
from dataclasses import dataclass

from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import JR3
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
