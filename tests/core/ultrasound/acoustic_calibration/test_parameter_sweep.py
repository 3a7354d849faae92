"""The sweep over virtual plates: every cell, repeatable, cancellable; it tells probes apart."""

import numpy as np
import pytest

from rona_core.errors import CancelledError
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIfGrid, sweep
from rona_core.virtual.acoustics.plates import record_plate

GRID = WhatIfGrid(
    probes=("2.25MHz", "1MHz"),
    excitations=("chirp",),
    snr_db=(20.0, 50.0),
    thickness_mm=(5.0, 11.0),
    n=16,
)


@pytest.fixture(scope="module")
def found():
    return sweep(GRID, record_plate, seed=4)


def at(found, probe, snr_db, thickness_mm):
    rows = zip(found.probes, found.snr_db, found.thickness_mm, strict=True)
    return [*rows].index((probe, snr_db, thickness_mm))


def test_every_combination_has_a_cell(found):
    assert len(GRID.cells) == len(found.probes) == len(found.sd_mm) == 8
    assert len(set(GRID.cells)) == 8
    assert (found.n_right <= found.n).all()
    np.testing.assert_array_less(-1e-12, found.failures)
    assert (found.n_right[found.failures == 1.0] == 0).all()


def test_in_little_noise_five_millimetres_are_found_and_right(found):
    # the shots of a cell share one texture: a beam of 13 mm makes one error of it for all of them
    for probe, sd_mm, bias_mm in (("2.25MHz", 0.06, 0.06), ("1MHz", 0.15, 0.1)):
        i = at(found, probe, 50.0, 5.0)
        assert found.coverage[i] > 0.9
        assert found.failures[i] == 0.0
        assert 0.0 < found.sd_mm[i] < sd_mm
        assert abs(found.bias_mm[i]) < bias_mm


@pytest.mark.slow
def test_over_several_textures_there_is_no_bias():
    small = WhatIfGrid(("2.25MHz", "1MHz"), ("chirp",), (50.0,), (5.0,), n=16)
    biases_mm = np.array([sweep(small, record_plate, seed=seed).bias_mm for seed in range(8)])
    np.testing.assert_array_less(np.abs(biases_mm.mean(axis=0)), 0.03)


def test_more_noise_costs_coverage_and_deep_bone_wants_the_slower_probe(found):
    for probe in ("2.25MHz", "1MHz"):
        quiet, loud = (at(found, probe, snr, 5.0) for snr in (50.0, 20.0))
        assert found.coverage[loud] < found.coverage[quiet]
    fast, slow = (at(found, probe, 50.0, 11.0) for probe in ("2.25MHz", "1MHz"))
    assert found.failures[slow] <= found.failures[fast]


def test_the_same_seed_gives_the_same_and_another_one_does_not(found):
    small = WhatIfGrid(("2.25MHz",), ("chirp",), (50.0,), (5.0,), n=16)
    first, again, other = (
        sweep(small, record_plate, seed=4),
        sweep(small, record_plate, seed=4),
        sweep(small, record_plate, seed=5),
    )
    assert (first.sd_mm, first.bias_mm) == (again.sd_mm, again.bias_mm)
    assert first.failures[0] == found.failures[at(found, "2.25MHz", 50.0, 5.0)]
    assert (first.bias_mm, first.coverage) != (other.bias_mm, other.coverage)


def test_it_tells_its_progress_and_can_be_cancelled():
    told = []
    with pytest.raises(CancelledError, match="after 2 of 8"):
        sweep(GRID, record_plate, progress=told.append, cancel=lambda: len(told) >= 2)
    assert told == [1 / 8, 2 / 8]
