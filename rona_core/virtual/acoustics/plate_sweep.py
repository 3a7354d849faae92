"""Try probes, excitations and noise levels on virtual plates of bone, cell by cell.

The bone is a layered plate as in a skull, made anew for every cell; it is nobody's specimen, and
the detection learns nothing of it. Errors are of the time of flight, stated as thickness at the
nominal speed, so that the unknown speed of sound does not hide what the probe can do.
"""

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScan, AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.ultrasound.acoustic_calibration.parameter_sweep import WhatIf, WhatIfGrid
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import FULL_SCALE_SHARE, probe_model
from rona_core.virtual.acoustics.echo_model import EchoModel
from rona_core.virtual.acoustics.layer_stack import LayerProfile
from rona_core.virtual.acoustics.medium import MEDIA

WRONG_MM = 1.0
SHARES = (0.29, 0.42, 0.29)  # of table, diploe and table
LEAN_RAD = 0.01  # rms of the probe against the bone
LIFT_MM = 0.2
RELIEF_MM, RELIEF_LENGTH_MM = 0.06, 12.0  # of the inner table, along the row of shots
PITCH_MM = 1.0
STREAM = 0x5EEE
PERIOD_S = 0.02


def sweep(
    grid: WhatIfGrid, seed: int = 0, *, progress: Progress = silent, cancel: Cancel = never
) -> WhatIf:
    """Return how the recommended detection does in every cell of the grid.

    Raises:
        CancelledError: somebody cancelled.
    """
    cells = grid.cells
    rows: list[tuple[float, ...]] = []
    for number, (name, excitation, snr_db, thickness_mm) in enumerate(cells):
        if cancel():
            raise CancelledError(f"the sweep was cancelled after {number} of {len(cells)} cells")
        settings = ProbeSettings(name=name, excitation=excitation, front_snr_db=snr_db)
        rows.append(_cell(settings, thickness_mm, grid, (seed, STREAM, number)))
        progress((number + 1) / len(cells))
    table = np.array(rows).reshape(len(cells), 6)
    return WhatIf(
        probes=tuple(cell[0] for cell in cells),
        excitations=tuple(cell[1] for cell in cells),
        snr_db=readonly(np.array([cell[2] for cell in cells])),
        thickness_mm=readonly(np.array([cell[3] for cell in cells])),
        failures=readonly(table[:, 0].copy()),
        unflagged=readonly(table[:, 1].copy()),
        coverage=readonly(table[:, 2].copy()),
        sd_mm=readonly(table[:, 3].copy()),
        bias_mm=readonly(table[:, 4].copy()),
        n_right=readonly(table[:, 5].astype(np.int64)),
        kind=grid.kind,
        n=grid.n,
    )


def _cell(
    settings: ProbeSettings, thickness_mm: float, grid: WhatIfGrid, key: tuple[int, ...]
) -> tuple[float, ...]:
    """Return failures, unflagged ones, coverage, sd, bias and how many count for these."""
    random = np.random.default_rng(key)
    track, bone_us, places = _record(settings, thickness_mm, grid, random)
    found = detect(track, probe_model(settings), settings.excitation, positions_mm=places)
    error = found.thickness_mm - bone_us * found.sound_speed_mm_per_us / 2.0
    wrong, ok = np.abs(error) > WRONG_MM, np.asarray(found.inner_ok)
    right = error[ok & ~wrong]
    enough = len(right) > 1
    return (
        float(wrong.mean()),
        float(wrong[ok].mean()) if ok.any() else 0.0,
        float(ok.mean()),
        float(right.std()) if enough else 0.0,
        float(right.mean()) if enough else 0.0,
        float(len(right)),
    )


def _record(
    settings: ProbeSettings, thickness_mm: float, grid: WhatIfGrid, random: np.random.Generator
) -> tuple[AScanTrack, Floats, Floats]:
    """Return A-scans of a plate, the two-way time through it (n,) and the places (n, 3)."""
    probe, medium = probe_model(settings), MEDIA[grid.kind]
    texture = int(random.integers(2**31))
    echo = EchoModel(probe, settings.excitation, medium, texture)
    side = int(np.ceil(np.sqrt(grid.n)))
    row, column = np.divmod(np.arange(grid.n), side)
    column = np.where(row % 2 == 0, column, side - 1 - column)
    places = PITCH_MM * np.column_stack((column, row, np.zeros(grid.n)))
    waves = 2.0 * np.pi / RELIEF_LENGTH_MM * random.normal(0.0, 1.0, (2, 8))
    phases = random.uniform(0.0, 2.0 * np.pi, 8)
    band = probe.bandwidth * probe.centre_mhz / (probe.sampling_mhz / 2.0)
    noise = FULL_SCALE_SHARE * 10.0 ** (-settings.front_snr_db / 20.0) / np.sqrt(band)
    leans = random.normal(0.0, LEAN_RAD / np.sqrt(2.0), (grid.n, 2))
    lifts = random.normal(0.0, LIFT_MM, grid.n)
    scans, bone_us = [], np.zeros(grid.n)
    for i in range(grid.n):
        rays = echo.ray_points_mm
        relief, tilt = _relief(places[i, :2] + np.vstack((np.zeros((1, 2)), rays)), waves, phases)
        total = thickness_mm + relief
        table, diploe, inner = (share * total for share in SHARES)
        slow = 1.0 / medium.table.speed_mm_per_us, 1.0 / medium.diploe.speed_mm_per_us
        bone_us[i] = 2.0 * float((table[0] + inner[0]) * slow[0] + diploe[0] * slow[1])
        lean = float(np.hypot(*leans[i]))
        angle = np.full(len(rays), lean)
        bent = medium.table.speed_mm_per_us / medium.gel.speed_mm_per_us * leans[i]
        profile = LayerProfile(
            outer_mm=lifts[i] + rays @ leans[i],
            table_mm=table[1:],
            diploe_mm=diploe[1:],
            inner_table_mm=inner[1:],
            hit=np.ones(len(rays), dtype=np.bool_),
            entries_skull=np.column_stack((places[i, :2] + rays, np.zeros(len(rays)))),
            outer_angle_rad=angle,
            inner_angle_rad=np.hypot(*(tilt[1:] + bent).T),
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
