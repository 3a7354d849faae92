"""The ultrasound probe: settings, and one A-scan where the robot holds it now."""

from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Body

from rona_core.app.steps.setup.messages import SetProbe
from rona_core.devices.samples import AScan
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import CancelledError, DeviceError
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import EXACT, Bench, idle_rig
from rona_ui.api.json_response import FastJson, described, plain
from rona_ui.api.routes.commands import Changed, changed

router = APIRouter(route_class=BodyRoute, prefix="/sessions/{session_id}/probe", tags=["probe"])
TIMEOUT_S = 20.0


@dataclass(frozen=True, slots=True)
class ProbeAcquire:
    """Fire the probe once; reserves the devices like any job."""


@router.get("/settings")
def get_probe_settings(bench: Bench) -> ProbeSettings:
    """Return probe, excitation, signal-to-noise ratio and scan pitch."""
    return bench.session.setup.devices.probe


@router.put("/settings")
def put_probe_settings(bench: Bench, settings: Annotated[SetProbe, EXACT, Body()]) -> Changed:
    """Set probe, excitation, signal-to-noise ratio and scan pitch; the command `SetProbe`."""
    return changed(bench, settings)


@router.post("/acquire", response_class=FastJson, responses=described("object"))
def acquire(bench: Bench) -> FastJson:
    """Fire once where the robot holds the probe now and return the trace; changes no session."""
    rig = idle_rig(bench)
    taken: list[AScan] = []

    def work(progress: Any, cancel: Any) -> int:
        session = bench.session
        rig.begin(session.setup.devices, len(session.archive) + 1)
        taken.append(rig.probe.acquire())
        bench.live.put(ascan=taken[-1])
        return bench.store.revision

    status = bench.jobs.start(ProbeAcquire(), work, device=True)
    status = bench.jobs.wait(status.id, TIMEOUT_S)
    if not taken:
        if status.state == "cancelled":
            raise CancelledError("the probe was stopped before it fired")
        raise DeviceError(status.error or "the probe did not answer in time")
    return FastJson(plain(taken[0]))
