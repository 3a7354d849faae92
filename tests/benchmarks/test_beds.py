import numpy as np
import pytest

from benchmarks.suites.implant.beds import reliability, searched, share_interval
from benchmarks.suites.implant.patient_beds import Search, Trial
from benchmarks.suites.implant.placement import interval


def trials(promised, kept_with, seed=0, patients=30, beds=12):
    """Return beds of promised probabilities that are kept with others, limit and residual 1 mm."""
    generator = np.random.default_rng(seed)
    made = []
    for patient in range(patients):
        for promise in generator.permutation(promised)[:beds]:
            kept = generator.uniform() < kept_with(promise)
            made.append(Trial(patient, float(promise), 1.5, 1.2 if kept else 0.8, 1.0))
    return made


def value(metrics, end):
    found = [one for one in metrics if one.name.endswith(end)]
    assert len(found) == 1
    return found[0]


PROMISED = np.linspace(0.05, 0.999, 40)


def test_beds_that_keep_what_is_promised_hold_in_every_bin():
    metrics = list(reliability(trials(PROMISED, lambda promise: promise)))
    assert value(metrics, "bins whose interval holds").holds is True


def test_beds_that_are_promised_too_much_do_not_hold():
    metrics = list(reliability(trials(PROMISED, lambda promise: promise**3)))
    assert value(metrics, "bins whose interval holds").holds is False


def test_beds_that_hang_together_tell_less_than_as_many_that_do_not():
    patients = np.repeat(np.arange(10), 10)
    together, alone = patients < 5, np.arange(100) % 2 == 0
    narrow, wide = share_interval(alone, patients), share_interval(together, patients)
    assert narrow == pytest.approx(interval(50, 100))  # all patients are alike
    assert wide[0] < narrow[0] - 0.05
    assert wide[1] > narrow[1] + 0.05


def test_violations_are_those_of_accepted_beds_alone():
    kept, broken = Trial(0, 0.995, 2.0, 1.5, 1.0), Trial(1, 0.995, 2.0, 0.5, 1.0)
    refused = Trial(1, 0.9, 1.2, 1.1, 1.0)
    searches = [Search(0, "BCI 602", True, kept)] * 3 + [Search(1, "BCI 602", True, broken)]
    searches += [Search(1, "BCI 602", False, refused), Search(1, "CI receiver", False, None)]
    metrics = list(searched(searches))
    assert value(metrics, "4: violations").value == pytest.approx(0.25)
    assert value(metrics, "4: violations").holds is False
    assert value(metrics, "patients with a bed").value == 2.0
    assert value(metrics, "nowhere laid").value == 1.0
    assert value(metrics, "would have kept the limit").value == 1.0
    assert value(metrics, "accepted beds: true less predicted residual, mean").value == (
        pytest.approx((3 * -0.5 - 1.5) / 4)
    )


def test_no_accepted_bed_is_no_figure():
    metrics = list(searched([Search(0, "BCI 602", False, None)]))
    assert value(metrics, "0: violations").holds is None
