"""Messages in logs and results of older files, as schema 4 calls them."""

from typing import Any

# Messages that schema 4 calls by the field's terms; logs and results remember them by name.
RENAMED_IN_4 = {
    "CalibrateSono": "CalibrateHandheldProbe",
    "DrawPattern": "GenerateScanPattern",
    "KeepPathSample": "PinPathSample",
    "PutObstacle": "AddObstacle",
    "SetBone": "SetBoneModel",
    "SetReference": "SetUseBaseMarker",
    "SetSurroundings": "SetWorkcell",
    "StartBlockShots": "StartDelayLineCapture",
    "StartReferencePoints": "StartCaliperMeasurements",
    "StartSecondPlan": "StartGapPlan",
    "StartSecondScan": "StartGapScan",
    "StartSonoCalibration": "StartHandheldCalibration",
    "StartSonoMapping": "StartHandheldMapping",
    "StartSonoScan": "StartHandheldScan",
    "StartWhatIf": "StartProbeSweep",
}
# Outcomes in logs: each capture and result had a message of its own.
CAPTURES_BEFORE_4 = {
    "StoreBlockCapture": "block",
    "StorePathCapture": "path",
    "StorePointerCapture": "pointer",
    "StoreReferences": "references",
    "StoreScanCapture": "scan",
    "StoreSecondCapture": "second",
    "StoreSonoPivot": "sono_pivot",
    "StoreSonoScan": "sono_scan",
    "StoreSonoSpin": "sono_spin",
    "StoreSurfaceCapture": "surface",
    "StoreToolCapture": "tool",
}
RESULTS_BEFORE_4 = {  # outcome -> activity, the field of its result, and the result
    "StoreBasePlacement": ("StartBasePlacement", {"placement": "placement"}),
    "StoreMaps": (
        "StartMapping",
        {"detection": "detection", "second_detection": "second_detection", "maps": "maps"},
    ),
    "StoreRegistration": ("StartSkullRegistration", {"registration": "registration"}),
    "StoreRobotPlan": ("StartRollSearch", {"plan": "roll"}),
    "StoreSecondPlan": ("StartGapPlan", {"second": "second"}),
    "StoreSonoMaps": (
        "StartHandheldMapping",
        {"sono_detection": "sono_detection", "sono_maps": "sono_maps"},
    ),
    "StoreWhatIf": ("StartProbeSweep", {"what_if": "what_if"}),
}


# Choices that are no longer offered: message, argument and old value -> what takes its place.
REPLACED_CHOICES: dict[tuple[str, Any, str], str] = {
    ("CalibratePointer", "method", "aos"): "ml",
    ("SmoothScanPath", "normal_method", "robust"): "jet",
    ("SmoothScanPath", "normal_method", "tls"): "jet",
}


def with_present_message(held: Any) -> Any:
    """Return a log entry or result, as plain values, with its message as it is called today."""
    if not isinstance(held, dict) or not isinstance(held.get("message"), str):
        return held
    name, arguments = str(held["message"]), held.get("arguments")
    if name in CAPTURES_BEFORE_4 and isinstance(arguments, dict):
        kept = {"append": False, **arguments, "kind": CAPTURES_BEFORE_4[name]}
        return {**held, "message": "StoreCapture", "arguments": kept}
    if name in RESULTS_BEFORE_4 and isinstance(arguments, dict):
        message, fields = RESULTS_BEFORE_4[name]
        values = {fields[key]: value for key, value in arguments.items() if key in fields}
        kept = {"message": message, "values": values}
        return {**held, "message": "StoreResult", "arguments": kept}
    name = RENAMED_IN_4.get(name, name)
    present = {**held, "message": name}
    if isinstance(arguments, dict):
        present["arguments"] = {
            key: REPLACED_CHOICES.get((name, key, str(value)), value)
            for key, value in arguments.items()
        }
    return present
