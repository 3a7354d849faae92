"""Which probe a quick look advises: by what its lines show, and only where that is clear."""

import numpy as np
import pytest

from rona_core.devices.settings import ProbeSettings
from rona_core.errors import InvalidInputError
from rona_core.ultrasound.detection import probe_choice
from rona_core.ultrasound.detection.detect import NO_INNER, OK, TOO_THIN, UNSURE
from rona_core.ultrasound.detection.probe_choice import (
    CLEAR,
    ExpectedCoverage,
    QuickLook,
    advise,
    compare,
    expected_coverage,
)
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.scenes.bone_scenes import parallel_bone

LINES, SHOTS = 4, 3


class Found:
    """A detection of which only flags count."""

    probe = "1MHz"

    def __init__(self, flag):
        self.flag = np.asarray(flag).ravel()


class Look:
    """A survey of so many A-scans."""

    def __init__(self, n=LINES * SHOTS):
        self.track = range(n)


def expected(monkeypatch, *flags):
    """Return what looks with these flags (lines, shots) promise."""
    found = iter([Found(one) for one in flags])
    monkeypatch.setattr(probe_choice, "detect", lambda look, **known: next(found))
    return expected_coverage([Look() for _ in flags], LINES, 1.0)


def flags(*lines):
    return np.array([[code] * SHOTS for code in lines])


def test_a_line_counts_where_any_look_is_sure_at_any_of_its_places(monkeypatch):
    upright = flags(OK, NO_INNER, UNSURE, NO_INNER)
    tilted = flags(NO_INNER, NO_INNER, UNSURE, NO_INNER)
    tilted[1, 2] = OK
    found = expected(monkeypatch, upright, tilted)
    assert (found.coverage, found.sure, found.thin) == (0.5, 0.5, 0.0)


def test_places_that_most_looks_find_too_thin_do_not_count_though_their_line_does(monkeypatch):
    upright, tilted = flags(OK, OK, OK, OK), flags(OK, OK, OK, OK)
    upright[0] = tilted[0] = (OK, TOO_THIN, TOO_THIN)
    tilted[1] = (TOO_THIN, OK, OK)  # half of the looks, not most
    found = expected(monkeypatch, upright, tilted)
    assert found.sure == 1.0
    assert found.thin == pytest.approx(2.0 / 12.0)
    assert found.coverage == pytest.approx(10.0 / 12.0)


def test_looks_without_an_inner_echo_do_not_say_that_the_bone_is_thick(monkeypatch):
    upright, tilted = flags(OK, OK, OK, OK), flags(*[NO_INNER] * 4)
    upright[2] = (TOO_THIN, OK, OK)  # the only look that measured there
    assert expected(monkeypatch, upright, tilted).thin == pytest.approx(1.0 / 12.0)


def test_looks_that_do_not_fit_together_are_refused():
    for looks, lines in (([], 4), ([Look(), Look(9)], 4), ([Look()], 5), ([Look()], 0)):
        with pytest.raises(InvalidInputError):
            expected_coverage(looks, lines, 1.0)


def look(fine, coarse):
    return QuickLook(
        12,
        (
            ExpectedCoverage("2.25MHz", fine, fine, 0.0),
            ExpectedCoverage("1MHz", coarse, coarse, 0.25),
        ),
    )


@pytest.mark.parametrize("used", ["2.25MHz", "1MHz"])
@pytest.mark.parametrize(("fine", "coarse"), [(1.0, 0.5), (0.5, 1.0), (0.9, 0.8), (0.0, 0.0)])
def test_another_probe_is_advised_where_it_is_clearly_better_and_only_there(used, fine, coarse):
    advice = advise(look(fine, coarse), used)
    values = {"2.25MHz": fine, "1MHz": coarse}
    gain = max(values.values()) - values[used]
    assert advice.another == (gain >= CLEAR)
    assert values[advice.advised] == max(values.values()) or not advice.another
    assert ("Better: " in advice.sentence) == advice.another
    assert f"{100 * fine:.0f} % with 2.25 MHz" in advice.sentence
    assert f"{100 * coarse:.0f} % with 1 MHz (25 % is too thin for it)" in advice.sentence


def test_a_probe_that_took_no_look_gets_no_advice():
    with pytest.raises(InvalidInputError, match="no quick look with '5MHz'"):
        advise(look(1.0, 1.0), "5MHz")


def plates(thickness_mm, name):
    """Return two looks at four lines of three places on bone so thick."""
    found = []
    for scene in parallel_bone(thickness_mm, name=name, side=7):
        rows = np.arange(12)
        found.append(
            ProbeSurvey(
                scene.track.part(np.isin(np.arange(len(scene)), rows)),
                probe_model(ProbeSettings(name=name)),
                scene.settings.excitation,
                positions_mm=scene.points_skull[rows],
            )
        )
    return found


def test_thin_bone_is_left_to_the_higher_frequency():
    found = compare([plates(3.0, name) for name in ("2.25MHz", "1MHz")], LINES)
    fine, coarse = found.probes
    assert (fine.probe, coarse.probe) == ("2.25MHz", "1MHz")
    assert fine.coverage - coarse.coverage >= CLEAR
    assert advise(found, "1MHz").advised == "2.25MHz"
    assert not advise(found, "2.25MHz").another
