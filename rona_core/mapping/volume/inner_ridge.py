"""Inner ridge: thickness read from an echo volume, without what detection said of each A-scan.

In each column it is the largest echo behind the front echo once the loss on the way through the
bone is made up for; columns that their neighbours contradict do not count.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.fitting.hampel_filter import agreeing
from rona_core.mapping.volume.echo_volume import SILENCE, EchoVolume

GAIN_DB_PER_MM = 2.0  # makes up for about the loss of skull bone, there and back
ABOVE_NOISE_DB = 9.0  # a ridge below it is noise that the gain has raised


@dataclass(frozen=True, slots=True, eq=False)
class InnerRidge:
    """The second ridge of an echo volume, column by column."""

    thickness_mm: Floats  # (nu, nv) outer boundary to the ridge, along z of the map
    ok: Bools  # (nu, nv) there is one, and it agrees with those around


@dataclass(frozen=True, slots=True)
class RidgeAgreement:
    """How a ridge lies beside the inner map, over the columns where both are sure."""

    columns: int
    share: float  # of the columns that both maps cover
    median_mm: float  # ridge below the inner map: positive
    median_abs_mm: float
    p95_abs_mm: float


def inner_ridge(volume: EchoVolume) -> InnerRidge:
    """Return the thickness between the outer boundary and the ridge behind it, in each column."""
    depths = volume.depths_mm()
    gain = 10.0 ** (GAIN_DB_PER_MM / 20.0 * np.clip(depths, 0.0, volume.deepest_mm))
    level = volume.amplitude * gain
    below, middle, above = level[:, :, :-2], level[:, :, 1:-1], level[:, :, 2:]
    threshold = volume.noise() * 10.0 ** (ABOVE_NOISE_DB / 20.0)
    known = volume.known
    peak = known[:, :, :-2] & known[:, :, 1:-1] & known[:, :, 2:]
    peak &= (middle > below) & (middle >= above)
    peak &= depths[:, :, 1:-1] > volume.blind_mm
    at = np.argmax(np.where(peak, middle, 0.0), axis=2)
    low, top, high = (
        np.take_along_axis(level, at[:, :, None] + k, axis=2)[:, :, 0] for k in range(3)
    )
    amplitude = np.take_along_axis(volume.amplitude, at[:, :, None] + 1, axis=2)[:, :, 0]
    found: Bools = peak.any(axis=2) & (amplitude > threshold) & volume.outer.ok
    logs = [np.log(np.maximum(part, SILENCE)) for part in (low, top, high)]
    bend = logs[0] - 2.0 * logs[1] + logs[2]
    offset = np.divide(0.5 * (logs[0] - logs[2]), bend, out=np.zeros(bend.shape), where=bend < 0.0)
    ridge_mm = volume.z_mm[at + 1] + offset * volume.steps_mm[2]
    thickness = volume.outer.height_mm - ridge_mm
    i, j = np.nonzero(found)
    if len(i):
        places = np.column_stack((volume.outer.u_mm[i], volume.outer.v_mm[j]))
        found[i, j] = agreeing(places, thickness[i, j])
    return InnerRidge(readonly(thickness), readonly(found))


def ridge_agreement(volume: EchoVolume, maps: Maps) -> RidgeAgreement | None:
    """Return how the ridge of a volume lies beside the inner map; None where both are nowhere sure.

    Args:
        volume: Made of the same A-scans as the maps.
        maps: On whose columns it is.
    """
    ridge, both = inner_ridge(volume), maps.outer.ok & maps.inner.ok
    sure = ridge.ok & both
    if not sure.any():
        return None
    apart = ridge.thickness_mm[sure] - maps.thickness_mm()[sure]
    return RidgeAgreement(
        columns=int(sure.sum()),
        share=float(sure.sum() / both.sum()),
        median_mm=float(np.median(apart)),
        median_abs_mm=float(np.median(np.abs(apart))),
        p95_abs_mm=float(np.percentile(np.abs(apart), 95.0)),
    )
