"""Further passes made of the one that a session has."""

from dataclasses import replace

from rona_core.app.dependencies.staleness import input_digests
from rona_core.app.messages.message import serialize_arguments
from rona_core.app.runtime.handling import derive_all
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.devices.samples import AScanTrack
from rona_core.geometry.arrays import readonly
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Derived, Session


def half_of(capture: ScanCapture) -> ScanCapture:
    """Return a scan that was stopped half way."""
    track = capture.scans
    n = len(track) // 2
    kept = AScanTrack(
        track.times_s[:n], track.rf[:n], track.sampling_mhz, track.start_us, track.clipped[:n]
    )
    return replace(capture, scans=kept)


def mapped_again(session: Session) -> Session:
    """Return the session with its boundaries detected and mapped once more."""
    values = derive_all(session, StartMapping())
    for name, value in values.items():
        made = Derived(
            value,
            StartMapping.__name__,
            serialize_arguments(StartMapping()),
            input_digests(name, session),
        )
        session = session.with_result(name, made)
    return session


def covering(session, share):
    """Return the session whose inner map has this share of the cells of its outer map."""
    held = session.results.maps
    maps = held.value
    left = maps.outer.ok & maps.inner.ok
    rows = maps.outer.ok.cumsum().reshape(maps.outer.ok.shape)
    left &= rows <= share * maps.outer.ok.sum()
    inner = replace(maps.inner, ok=readonly(left))
    return session.with_result("maps", replace(held, value=replace(maps, inner=inner)))
