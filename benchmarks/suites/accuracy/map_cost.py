"""Cost of a map of 60 x 60 mm in rows 2.5 mm apart: time, growth with the samples, memory.

Draws are those of the demo, 48 x 47 mm, whose causes of error are known by then.
"""

import tracemalloc
from collections.abc import Iterator

import numpy as np

from benchmarks.cases.growth import exponent
from benchmarks.metric import Metric, cpu_ms
from rona_core.app.steps.maps.inputs import drawn_maps
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.coarse_map import coarse_map
from rona_core.mapping.fitting.plate_field import PlateField, fit_field
from rona_core.session.files import load_session
from rona_ui.resources import demo_session

SIDE_MM, PITCH_MM = 60.0, 2.5
ALONG_MM = (0.3, 0.6, 1.2, 2.4)  # between A-scans of a row
RADIUS_MM, NOISE_MM = 80.0, 0.03
DRAWS = 100


def metrics() -> Iterator[Metric]:
    """Yield the figures of one outer map on a dome."""
    sizes, times = [], []
    for along_mm in ALONG_MM:
        samples = survey(along_mm)
        sizes.append(float(len(samples)))
        times.append(cpu_ms(lambda samples=samples: made(samples)))
    yield Metric(f"map of {sizes[0]:.0f} samples, heights and sigmas", times[0], "ms", "lower", 3e3)
    yield Metric("the same while the robot scans, an update", live_ms(), "ms", "lower", 100.0)
    yield Metric("growth with the samples, exponent", exponent(sizes, times), "1", "lower", 1.3)
    session = load_session(demo_session())
    drawn = cpu_ms(lambda: drawn_maps(session, DRAWS))
    yield Metric(f"{DRAWS} draws of both boundaries, demo", drawn, "ms", "lower", 1e3)
    tracemalloc.start()
    made(survey(ALONG_MM[0]))
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    yield Metric("memory while it is made", peak, "MB", "lower", 500.0)


def survey(along_mm: float) -> Floats:
    """Return samples (n, 3) of a dome, row by row."""
    u, v = np.meshgrid(
        np.arange(0.0, SIDE_MM, PITCH_MM), np.arange(0.0, SIDE_MM, along_mm), indexing="ij"
    )
    off = np.hypot(u - SIDE_MM / 2.0, v - SIDE_MM / 2.0)
    noise = np.random.default_rng(1).normal(0.0, NOISE_MM, u.shape)
    height = np.sqrt(RADIUS_MM**2 - off**2) - RADIUS_MM + 0.3 * np.sin(u / 5.0) + noise
    return np.column_stack((u.ravel(), v.ravel(), height.ravel()))


def cells() -> Floats:
    """Return the cells (k, 2) of 1 mm."""
    axis = np.arange(0.0, SIDE_MM + 0.5)
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


def made(samples: Floats) -> PlateField:
    """Return the map of samples, with heights and standard deviations of all cells."""
    plate = fit_field(samples[:, :2], samples[:, 2])
    plate.heights(cells())
    plate.sigmas_mm(cells())
    return plate


def live_ms() -> float:
    """Return what an update of the map takes that grows while the robot scans."""
    samples = survey(ALONG_MM[0])
    return cpu_ms(lambda: coarse_map(Pose.from_translation((0.0, 0.0, 0.0)), samples))
