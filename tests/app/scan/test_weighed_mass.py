"""The mass that a scan weighed is held against that of the tool, wherever a scan is judged."""

from dataclasses import replace

import pytest

from rona_core.app.report.sections import motion_section
from rona_core.app.steps.scan.view import contact_report
from rona_ui.api.answers import plain
from rona_ui.panels.scan.scan import contact_note


def weighing(session, mass_kg):
    """Return the session with another mass on the flange in its scan."""
    scan = session.captures.scan
    load = replace(scan.forces.load, mass_kg=mass_kg)
    scan = replace(scan, forces=replace(scan.forces, load=load))
    return replace(session, captures=replace(session.captures, scan=scan))


def test_the_tool_of_a_scan_weighs_what_it_should(demo):
    assert contact_report(demo).mass is None
    assert "r-note warn" not in contact_note(demo)


@pytest.mark.parametrize("mass_kg", [0.08, 0.32])
def test_another_tool_is_reported_on_the_page_in_the_report_and_over_rest(demo, mass_kg):
    other = weighing(demo, mass_kg)
    found = contact_report(other).mass
    assert f"weighs {1000 * mass_kg:.0f} ± " in found
    assert "states 200 ± 15 g" in found
    assert plain(contact_report(other))["mass"] == found
    assert 'r-note warn">The tool on the flange weighs' in contact_note(other)
    assert "The tool on the flange weighs" in str(motion_section(other))


def test_a_scan_driven_by_position_weighs_nothing(demo):
    scan = replace(demo.captures.scan, forces=None)
    blind = replace(demo, captures=replace(demo.captures, scan=scan))
    assert contact_report(blind).mass is None
