"""A scan that is watched is the scan that nobody watches, bit for bit."""

from pathlib import Path

import pytest

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.steps.maps.growing_map import MapGrower
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.devices.live import Live
from rona_core.devices.settings import ContactSettings
from rona_core.session.codec import digest
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.specimen.build_specimen import build_specimen
from tests.app.scan.test_scan_in_contact import session_with

pytestmark = pytest.mark.slow


class Watched(Live):
    """Live slots that somebody grows a map from whenever A-scans have come."""

    def __init__(self, session):
        super().__init__()
        self.grower, self.grown, self.session = None, [], session

    def put(self, **parts):
        super().put(**parts)
        live = self.get()
        if parts.get("recorded") is not None:
            self.grower = self.grower or MapGrower(self.session, "first", live.ordinal)
            self.grown.append(self.grower.grown(live.recorded))


@pytest.fixture(scope="module")
def specimen():
    setup = session_with().setup
    return build_specimen(setup.specimen, setup.seed)


@pytest.mark.parametrize("contact", [None, ContactSettings()])
def test_watching_changes_no_bit_of_the_capture(contact, specimen):
    session = session_with(contact=contact)

    def scanned(live):
        rig = VirtualRig(session.setup.seed, specimen, session.setup.devices)
        context = ActivityContext(
            devices=lambda: rig, live=live, import_skull=lambda *_, **__: None, uploads=Path()
        )
        return capture_scan(session, context)

    watched = Watched(session)
    alone, seen = scanned(Live()), scanned(watched)
    assert digest(alone) == digest(seen)
    assert watched.grown[-1].n_scans >= len(seen.scans) - 1
    assert {one.ordinal for one in watched.grown} == {seen.ordinal}
    assert watched.get().recorded is None  # A-scans are not kept twice
