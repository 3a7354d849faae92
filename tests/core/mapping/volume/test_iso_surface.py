"""Iso-surfaces of an echo volume lie where the echoes of a plate do."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.mapping.volume.echo_volume import iso_surface
from rona_core.mapping.volume.inner_ridge import GAIN_DB_PER_MM
from rona_core.mapping.volume.reconstruction import reconstruct_volume
from tests.scenes.volume_lines import INNER, PROBE, plate


def test_the_surface_of_a_plate_has_the_faces_of_both_echoes():
    volume = reconstruct_volume(*plate(6.0), PROBE)
    found = iso_surface(volume, -32.0, GAIN_DB_PER_MM)
    heights = (volume.T_base_map.inv() @ found.points_base)[:, 2]
    np.testing.assert_allclose(found.depths_mm, -heights, atol=1e-9)
    # a bell of amplitude a passes the level l at sqrt(2 ln(a / l)) standard deviations
    inner = heights[heights < -4.0]
    wide = 0.5 * np.sqrt(2.0 * np.log(INNER / 10.0 ** (-32.0 / 20.0)))
    off = np.abs(inner + 6.0) - wide
    np.testing.assert_allclose(off, 0.0, atol=0.08)


@pytest.mark.parametrize("level_db", [0.1, -80.1, float("nan")])
def test_a_level_out_of_range_is_refused(level_db):
    volume = reconstruct_volume(*plate(6.0), PROBE)
    with pytest.raises(InvalidInputError, match="-80 to 0 dB"):
        iso_surface(volume, level_db)
