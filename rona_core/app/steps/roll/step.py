"""Roll: motion planning over the free angle about the probe, and placement of the base."""

from rona_core.app.declarations.declarations import Activity, Command, Result, Step, StepLine
from rona_core.app.dependencies.inputs import result_input
from rona_core.app.runtime.computing import compute_one
from rona_core.app.steps.roll.base_placement import derive_placement
from rona_core.app.steps.roll.derivation import derive_roll
from rona_core.app.steps.roll.handlers import apply_base_placement, choose_roll, recompute_roll
from rona_core.app.steps.roll.messages import (
    ApplyBasePlacement,
    ChooseRoll,
    StartBasePlacement,
    StartRollSearch,
)
from rona_core.app.steps.roll.plan_reasons import plan_reason, roll_summary
from rona_core.app.steps.setup.inputs import BASE, DRIVEN
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.app.steps.tool.robot_motion import drive_robot

SMOOTHING, ROLL, PLACEMENT = (result_input(name) for name in ("smoothing", "roll", "placement"))

STEP = Step(
    "roll",
    commands=(
        Command(ChooseRoll, choose_roll, needs=(ROLL,)),
        Command(ApplyBasePlacement, apply_base_placement, needs=(PLACEMENT,), takes_stale=True),
    ),
    activities=(
        Activity(StartRollSearch, compute_one, "Searching the roll", needs=(SMOOTHING,)),
        Activity(
            StartBasePlacement,
            compute_one,
            "Looking for places of the base",
            needs=(SMOOTHING,),
        ),
        Activity(
            StartRobotMove,
            drive_robot,
            "Moving the robot",
            uses_devices=True,
            drives_robot=True,
        ),
    ),
    results=(
        Result(
            "roll",
            StartRollSearch,
            derive_roll,
            {"smoothing": SMOOTHING, **DRIVEN},
            "plan the motion (step 7)",
            long=True,
            recompute=recompute_roll,
        ),
        Result(
            "placement",
            StartBasePlacement,
            derive_placement,
            {"smoothing": SMOOTHING, "base": BASE, **DRIVEN},
            "look for a place of the base (step 7)",
            long=True,
        ),
    ),
    line=StepLine(
        "Roll",
        roll_summary,
        StartRollSearch,
        leaves=lambda session: (ROLL,),
        unusable=plan_reason,
    ),
)
