"""Correction of the front echo for the curvature of the bone, over which the beam averages."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.matched_filter import block_template
from rona_core.ultrasound.probe.beam import probe_beam
from rona_core.ultrasound.probe.materials import GEL
from rona_core.ultrasound.probe.probe_model import ProbeModel


def mean_curvature_per_mm(points_map: Floats) -> float:
    """Return the mean of the two curvatures of the quadric through points (n, 3); > 0: a dome.

    The points are heights over the plane that fits them best, +z out of the bone.
    """
    u, v, z = points_map.T
    design = np.column_stack((np.ones(len(u)), u, v, u * u, u * v, v * v))
    quadric = np.linalg.lstsq(design, z, rcond=None)[0]
    return -float(quadric[3] + quadric[5])


def lateness_mm(probe: ProbeModel, curvature_per_mm: float) -> float:
    """Return by how much the front echo of bone so curved puts the outer boundary too deep.

    The rays of the beam add up with the phase of their longer way; for a small phase that is
    <r^2> / 2R. A beam as wide as the crystal would give a^2 / 4R, the real one is narrower.
    """
    beam, spectrum = probe_beam(probe), block_template(probe, "pulse")
    fall = np.sum(beam.points_mm**2, axis=1) / 2.0 * curvature_per_mm
    k = 2.0 * np.pi * beam.frequencies_mhz / GEL.speed_mm_per_us
    flat = beam.weights.sum(axis=0)
    curved = (beam.weights * np.exp(-2j * np.outer(fall, k))).sum(axis=0)
    power = np.interp(
        beam.frequencies_mhz,
        spectrum.frequencies_mhz,
        spectrum.weights * np.abs(spectrum.spectrum) ** 2,
    )
    late = -np.angle(curved * np.conj(flat)) / (2.0 * k)
    return float(np.sum(power * late) / np.sum(power))
