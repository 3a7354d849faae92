"""Virtual plates of bone, to try probes on: a layered plate as in a skull, nobody's specimen."""

import numpy as np

from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, probe_model
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import LayerProfile
from rona_core.virtual.acoustics.medium import MEDIA

SHARES = (0.29, 0.42, 0.29)  # of table, diploe and table
TILT_RAD = 0.01  # rms of the probe against the bone
LIFT_MM = 0.2
RELIEF_MM, RELIEF_LENGTH_MM = 0.06, 12.0  # of the inner table, along the row of shots
PITCH_MM = 1.0
PERIOD_S = 0.02


def record_plate(
    settings: ProbeSettings, thickness_mm: float, kind: str, n: int, random: np.random.Generator
) -> tuple[AScanTrack, Floats, Floats]:
    """Return A-scans of a plate, the two-way time through it (n,) and the places (n, 3).

    Args:
        settings: Of the probe.
        thickness_mm: Mean of the plate.
        kind: Of the bone, one of ``MEDIA``.
        n: A-scans, in rows to and fro over a square.
        random: For texture, relief, tilts, lifts and noise.
    """
    probe, medium = probe_model(settings), MEDIA[kind]
    texture = int(random.integers(2**31))
    echo = EchoModel(probe, settings.excitation, medium, texture)
    side = int(np.ceil(np.sqrt(n)))
    row, column = np.divmod(np.arange(n), side)
    column = np.where(row % 2 == 0, column, side - 1 - column)
    places = PITCH_MM * np.column_stack((column, row, np.zeros(n)))
    waves = 2.0 * np.pi / RELIEF_LENGTH_MM * random.normal(0.0, 1.0, (2, 8))
    phases = random.uniform(0.0, 2.0 * np.pi, 8)
    band = probe.bandwidth * probe.centre_mhz / (probe.sampling_mhz / 2.0)
    noise = FULL_SCALE_SHARE * 10.0 ** (-settings.front_snr_db / 20.0) / np.sqrt(band)
    tilts = random.normal(0.0, TILT_RAD / np.sqrt(2.0), (n, 2))
    lifts = random.normal(0.0, LIFT_MM, n)
    scans, bone_us = [], np.zeros(n)
    for i in range(n):
        rays = echo.ray_points_mm
        relief, slope = _relief(places[i, :2] + np.vstack((np.zeros((1, 2)), rays)), waves, phases)
        total = thickness_mm + relief
        table, diploe, inner = (share * total for share in SHARES)
        slow = 1.0 / medium.table.speed_mm_per_us, 1.0 / medium.diploe.speed_mm_per_us
        bone_us[i] = 2.0 * float((table[0] + inner[0]) * slow[0] + diploe[0] * slow[1])
        angle = np.full(len(rays), float(np.hypot(*tilts[i])))
        bent = medium.table.speed_mm_per_us / medium.gel.speed_mm_per_us * tilts[i]
        profile = LayerProfile(
            outer_mm=lifts[i] + rays @ tilts[i],
            table_mm=table[1:],
            diploe_mm=diploe[1:],
            inner_table_mm=inner[1:],
            hit=np.ones(len(rays), dtype=np.bool_),
            entries_skull=np.column_stack((places[i, :2] + rays, np.zeros(len(rays)))),
            outer_angle_rad=angle,
            inner_angle_rad=np.hypot(*(slope[1:] + bent).T),
        )
        rf = echo.trace(profile)
        rf = rf + random.normal(0.0, noise, len(rf))
        steps = 2.0 ** (probe.adc_bits - 1)
        kept = np.clip(np.rint(rf * steps) / steps, -1.0, 1.0 - 1.0 / steps)
        clipped = bool(np.abs(rf).max() >= 1.0)
        when = PERIOD_S * (i + 1)
        scans.append(AScan(when, readonly(kept), probe.sampling_mhz, probe.start_us, clipped))
    return AScanTrack.from_scans(scans), bone_us, places


def _relief(xy: Floats, waves: Floats, phases: Floats) -> tuple[Floats, Floats]:
    """Return height (n,) and slopes (n, 2) of the inner table's relief at places (n, 2)."""
    height = RELIEF_MM * np.sqrt(2.0 / len(phases))
    phase = xy @ waves + phases
    return height * np.sin(phase).sum(axis=1), height * np.cos(phase) @ waves.T
