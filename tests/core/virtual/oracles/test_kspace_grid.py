"""The grid that shows what became of the boundaries of the stored k-Wave fields."""

import numpy as np
import pytest

from rona_core.virtual.acoustics.layered_reflection import step
from tests.oracles import kwave_cases
from tests.oracles.kspace_grid import BEHIND_MM, on_grid, record, rendered, tilted_front
from tests.oracles.kwave_cases import stored_strip
from tests.oracles.kwave_cells import LAYERS, WATER

HALF = (WATER, LAYERS[1])


def lost_in_cells(cell_mm, step_us, samples):
    """Return the share of a bone echo at 1 MHz that a column of cells loses; bone at 3.05 mm."""
    t = np.arange(samples) * step_us
    sent = np.exp(-((t - 2.0) ** 2) / (2 * 0.4**2)) * np.cos(2 * np.pi * (t - 2.0))
    cells = rendered(cell_mm, np.full((1, 1), 3.05), 8.0, 1, HALF)
    heard = record(cells, step_us, sent)
    tone = np.exp(-2j * np.pi * t)
    late = t > 4.0  # the pulse is over, its echo is to come
    bone = step(*(np.array([m.density_g_per_cm3 * m.speed_mm_per_us]) for m in HALF)).near[0]
    return 1.0 - float(abs(np.sum((heard * tone)[late])) / abs(np.sum(sent * tone)) / bone)


@pytest.mark.ci
def test_a_cut_cell_costs_an_echo_by_the_square_of_its_size():
    """A third into a cell of a tenth of a wave, then a third into one of a quarter of that size."""
    coarse, fine = (lost_in_cells(0.15 / n, 0.0079 / n, 1300 * n) for n in (1, 4))
    assert coarse > 0.01
    assert coarse / fine == pytest.approx(16.0, rel=0.1)


@pytest.mark.slow
def test_the_grid_gives_back_a_stored_field():
    """The same cells, the same steps: all there is up to the front echo, and that echo."""
    case = stored_strip("1mhz_flat")
    if case is None:
        pytest.skip(f"no reference fields in {kwave_cases.SHARED}")
    found = on_grid(case, 1, case.reach_mm + BEHIND_MM, case.front_us[1])
    wave = case.heard[: len(found)]
    assert np.linalg.norm(found - wave) < 5e-4 * np.linalg.norm(wave)
    front = slice(round(case.front_us[0] / case.step_us), None)
    assert np.linalg.norm((found - wave)[front]) < 1e-3 * np.linalg.norm(wave[front])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most_db"), [("1mhz_flat", 0.3), ("2.25mhz_flat", 0.2)])
def test_bone_tilted_as_in_the_further_passes_echoes_as_in_the_wave_equation(name, most_db):
    """At five degrees the front echo has lost 14 dB; the model loses as much within a fraction."""
    found = tilted_front(name, 5.0)
    if found is None:
        pytest.skip(f"no reference fields in {kwave_cases.SHARED}")
    assert abs(found.front_db) < most_db
    assert abs(found.front_ns) < 4.0
