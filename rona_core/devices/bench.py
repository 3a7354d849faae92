"""Measurements beside the robot: thickness by caliper, A-scans on a reference block."""

from typing import Protocol

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats


class Bench(Protocol):
    """What is measured beside the robot, by hand."""

    def measure_thickness(self, places_base: Floats, axes_base: Floats) -> tuple[Floats, float]:
        """Measure the bone with a caliper at places (n, 3) along inward axes (n, 3).

        Returns:
            Thicknesses (n,) and the standard deviation of the caliper, in mm.

        Raises:
            DeviceError: there is nothing to grip, or no caliper.
        """
        ...

    def record_reference_block(
        self, settings: ProbeSettings, temperature_c: float, n: int
    ) -> AScanTrack:
        """Hold the probe on a flat block of steel and fire ``n`` times, its line this warm."""
        ...

    def taught_landmarks(self) -> tuple[tuple[str, ...], Floats]:
        """Return the landmarks near the head that the robot's tip has touched.

        Returns:
            Their names (n), and the joint angles (n, 6) that the robot's controller kept when its
            tip, led by hand, sat in each.

        Raises:
            DeviceError: the robot reaches too few of them where it stands.
        """
        ...

    def record_gauge_plate(
        self, settings: ProbeSettings, depth_mm: float, n: int
    ) -> tuple[AScanTrack, float]:
        """Press a gauge plate at the robot's holder onto its probe and fire ``n`` times.

        Args:
            settings: Of the probe.
            depth_mm: By which the plate presses the line in, where the probe sits at its place.
            n: A-scans.

        Returns:
            The A-scans, and the standard deviation of the depth in mm that the maker states.
        """
        ...
