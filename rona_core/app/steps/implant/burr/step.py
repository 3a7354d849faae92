"""Burr: the tip of the spindle registered in a seat, before a bed is laid and milled."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import Remedy
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.steps.implant.burr.capture import capture_burr
from rona_core.app.steps.implant.burr.derivation import register_burr
from rona_core.app.steps.implant.burr.inputs import BURR_CAPTURE
from rona_core.app.steps.implant.burr.messages import RegisterBurr, StartBurrCapture
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.session.captures import ToolCapture

STEP = declare.Step(
    "burr",
    part_of="implant",
    commands=(declare.Command(RegisterBurr, compute_result, needs=(BURR_CAPTURE, TOOL)),),
    activities=(
        declare.Activity(
            StartBurrCapture,
            record("burr", capture_burr, RegisterBurr),
            "Turning the burr in its seat",
            needs=(TOOL,),
            drives_robot=True,
            makes=("burr",),
        ),
    ),
    captures=(
        declare.Capture(
            "burr",
            "turn the burr in its seat (step 10)",
            (parts.tracker, parts.robot, parts.robot_errors, parts.SPINDLE),
            types=(ToolCapture,),
            done="the turning of the burr was recorded",
        ),
    ),
    results=(
        declare.Result.of(
            "burr",
            RegisterBurr,
            register_burr,
            "register the burr (step 10)",
            judged=by_verdict(
                Remedy("turn the burr in its seat again (step 10)", StartBurrCapture())
            ),
            done="the registration of the burr was computed",
        ),
    ),
)
