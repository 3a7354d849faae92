"""Tell results of older files apart by what they really use, so that a finer rule keeps them fresh.

Files that were written before remember one digest of all settings of the robot, of the whole probe
and of the choice of the base marker. Where that digest is of the settings in the same file, the
result is fresh by the old rule, and so by the new one, which looks at fewer of them.
"""

from typing import Any

from rona_core.devices.settings import ROOM_C
from rona_core.session.codec import digest

NO_ARM = ("contact", "latency_ms")  # of the robot's settings, that results never depended on
DRIVEN = ("roll", "placement", "second")  # they depend on the speed of the scan
BLOCK_PROBE = {"pitch_mm": 1.0, "line_temperature_c": ROOM_C}
HAND_PROBE = {"pitch_mm": 1.0}


def with_present_digests(session: Any) -> Any:
    """Return the plain values of a session with digests of inputs as this program takes them.

    What is stale stays so. Values that are no session come back as they are.
    """
    try:
        setup = session["setup"]
        results = {
            name: {**held, "inputs": _inputs(name, held, setup)}
            for name, held in session["results"].items()
            if isinstance(held, dict) and name != "more"  # which older files do not have
        }
    except (KeyError, TypeError, AttributeError, ValueError):
        return session  # decoding says what is wrong
    return {**session, "results": {**session["results"], **results}}


def _inputs(name: str, held: dict[str, Any], setup: dict[str, Any]) -> dict[str, Any]:
    inputs, robot = dict(held["inputs"]), setup["devices"]["robot"]
    arm = {key: value for key, value in robot.items() if key not in NO_ARM}
    if inputs.get("robot") == digest(arm):
        inputs["robot"] = digest(robot["model"])
        if name in DRIVEN:
            inputs["scan speed"] = digest(robot["scan_speed_mm_per_s"])
        if name == "placement":
            inputs["base"] = digest(
                [digest(robot[key]) for key in ("base_shift_mm", "base_turn_deg")]
            )
    if inputs.get("reference") == digest(setup["use_base_marker"]):
        inputs["reference"] = digest(True)
    parts = {"line": BLOCK_PROBE, "sono_detection": HAND_PROBE}.get(name, {})
    probe = setup["devices"]["probe"]
    if parts and inputs.get("probe") == digest(probe):
        inputs["probe"] = digest({**probe, **parts})
    if held["message"] == "GenerateScanPattern":
        inputs.setdefault("region", digest(setup["region"]["radius_mm"]))
    return inputs
