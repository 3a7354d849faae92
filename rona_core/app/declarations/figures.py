"""The figures of a session: each declared once, with its words, unit, limit and meaning.

Quality table, report, REST, terminal, results page and ``docs/metrics.md`` read this list; the
functions of ``rona_core.evaluation`` and of ``overview/predicted_accuracy.py`` compute the values
under its keys. It stands in ``app`` because the interface shows every name and limit, also with
real devices, and must not import what compares with the ground truth. Limits are goals of this
program.
"""

from dataclasses import KW_ONLY, dataclass
from typing import Literal

from rona_core.calibration.hand_eye.quality import GOOD_MM as GOOD_TOOL_MM
from rona_core.calibration.pivot.quality import GOOD_SIGMA_MM as GOOD_POINTER_MM

Sense = Literal["at most", "at least"]
UNITS = {"": "", "deg": "°"}  # that follow a number otherwise than after a space
MOST_DECIMALS = 6  # that tell a value from the limit that it misses

OF_CALIBRATION = "from there on the verdict of the calibration is not good"
OF_THE_PAPER = "the paper"
WORST_OF_RESULTS = "the worst of the results page"


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of merit: its name, its meaning and its limit."""

    key: str
    title: str
    unit: str  # empty for counts, shares and words
    says: str  # the definition, in Markdown
    _: KW_ONLY
    of: str = ""  # the result or capture that it judges; empty: the run as a whole
    decimals: int = 2
    limit: float | None = None
    source: str = ""  # where the limit comes from
    sense: Sense = "at most"
    paper: float | None = None  # what the paper reports
    truth_of: str = ""  # key of the prediction that this is the truth of
    own_verdict: bool = False  # the verdict that the result states itself counts too
    share: bool = False  # of one; shown in percent

    def words(self, value: float, missed: float | None = None) -> str:
        """Return a value with its unit, as it is shown everywhere.

        Args:
            value: In the unit of the figure; a share of one.
            missed: Limit that the value does not keep: it is not rounded to it.
        """
        if self.share and self.decimals > 2:
            return percent(value)
        factor, places = (100.0, self.decimals - 2) if self.share else (1.0, self.decimals)
        value, unit = factor * value, "%" if self.share else self.unit
        if missed is not None:
            while places < MOST_DECIMALS and round(abs(value) - factor * missed, places) == 0.0:
                places += 1
        return f"{round(value, places) + 0.0:.{places}f}{UNITS.get(unit, f' {unit}')}"

    def named(self, value: float) -> str:
        """Return the title, and a value with its unit."""
        return f"{self.title} {self.words(value)}"


def percent(probability: float) -> str:
    """Return a probability in percent, never rounded to certainty."""
    return "over 99.9 %" if probability > 0.999 else f"{100.0 * probability:.1f} %"


CALIBRATION = (
    Figure(
        "tool_tip_error_mm",
        "Tool tip error",
        "mm",
        "distance from the calibrated tip of the tool to the true one, in the frame of its marker",
        of="tool",
        limit=0.5,
        source="the goal of `python -m benchmarks navigation`",
        truth_of="tool_tip_sigma_mm",
    ),
    Figure(
        "tool_tip_sigma_mm",
        "Tool tip, expected error",
        "mm",
        "predicted: standard deviation (3D) of the calibrated tip; chance, by the scatter of the "
        "data and the geometry of the motion, and what tracker and robot do the same every time",
        of="tool",
        limit=GOOD_TOOL_MM,
        source=OF_CALIBRATION,
        own_verdict=True,
    ),
    Figure(
        "tracker_registration_tre_mm",
        "Registration, TRE on the skull",
        "mm",
        "five named points on the skull are mapped from tracker to base with the registration "
        "found: RMS distance to where they really are. The points: the middle of the region and "
        "the places on the outer surface nearest to 30 mm from it, along ±y and ±z of the specimen",
        of="tool",
        limit=1.0,
        source="chosen: twice the root of the squared sum of the tracker's stated 0.35 mm and the "
        "robot's 0.35 mm; nothing is claimed",
        truth_of="tracker_registration_sigma_mm",
    ),
    Figure(
        "tracker_registration_sigma_mm",
        "Registration, assumed",  # robot and tracker are stated to be so; nothing measured it
        "mm",
        "assumed from the stated errors of robot and tracker: 3D RMS error in the base of places "
        "100 mm about the tips of the tool, mapped by the registration",
        of="tool",
        limit=1.0,
        source="as `tracker_registration_tre_mm`",
        own_verdict=True,
    ),
    Figure(
        "pointer_tip_error_mm",
        "Pointer tip error",
        "mm",
        "as `tool_tip_error_mm`, of the pointer; of a 5D pointer, the difference in "
        "length along its line",
        of="pointer",
        limit=0.5,
        source="as for the tool",
        truth_of="pointer_tip_sigma_mm",
    ),
    Figure(
        "pointer_tip_sigma_mm",
        "Pointer tip, expected error",
        "mm",
        "predicted: standard deviation (3D) of the calibrated tip, as `tool_tip_sigma_mm`",
        of="pointer",
        limit=GOOD_POINTER_MM,
        source=OF_CALIBRATION,
        own_verdict=True,
    ),
)

SURFACE_AND_PATH = (
    Figure(
        "surface_points",
        "Surface cloud, points",
        "",
        "points of the pointer's cloud, after averaging if that is on",
        of="surface",
        decimals=0,
    ),
    Figure(
        "surface_rms_mm",
        "Surface cloud, RMS",
        "mm",
        "RMS of the signed distances of the cloud to the true outer surface",
        of="surface",
        limit=0.5,
        source="the root of the squared sum of the tracker's and the robot's 0.35 mm; the paper "
        "states 2.5 mm, the worst of the results page is 0.53",
        paper=2.5,
        truth_of="surface_sigma_predicted_mm",
    ),
    Figure(
        "surface_sigma_predicted_mm",
        "Surface cloud, predicted RMS",
        "mm",
        "predicted: what `surface_rms_mm` is expected to be",
        of="surface",
        limit=0.5,
        source="as `surface_rms_mm`",
    ),
    Figure(
        "surface_tip_3d_rms_mm",
        "Pointer tip on surface, 3D RMS",
        "mm",
        "RMS distance, in all directions, from each point to where the true tip was in that frame",
        of="surface",
    ),
    Figure(
        "skull_registration_tre_mm",
        "Loaded skull, TRE on the skull",
        "mm",
        "only with a loaded skull that was registered in step 4: the five points of "
        "`tracker_registration_tre_mm`, mapped from the file of the skull to the base",
        of="registration",
        limit=1.5,
        source="chosen; nothing is claimed",
        truth_of="skull_registration_sigma_mm",
    ),
    Figure(
        "skull_registration_sigma_mm",
        "Loaded skull, predicted",
        "mm",
        "predicted: 3D RMS error over the surface points of that registration; the fit's own, and "
        "what the points of the pointer share",
        of="registration",
        limit=1.5,
        source="as `skull_registration_tre_mm`",
    ),
    Figure(
        "path_points_raw",
        "Path points, demonstrated",
        "",
        "samples of the demonstration",
        of="path",
        decimals=0,
        paper=307,
    ),
    Figure(
        "coverage_predicted_fraction",
        "Coverage, expected",
        "",
        "predicted: what `coverage_fraction` is expected to be; share of the disc of the region, "
        "about the middle of the measured surface, that lies within 2 mm of the path. Null where "
        "regions to scan are painted",
        of="path",
        limit=0.9,
        source="as `coverage_fraction`",
        sense="at least",
        share=True,
    ),
    Figure(
        "path_points_smoothed",
        "Path points, smoothed",
        "",
        "points that the simplified path keeps",
        of="smoothing",
        decimals=0,
        paper=90,
    ),
    Figure(
        "path_deviation_max_mm",
        "Max. path deviation",
        "mm",
        "the largest distance of a sample to the segment that replaces it and its neighbours. "
        "The samples are those that the simplifier was given, after filtering if that is on; one "
        "taken away by hand is measured to what stands in its place",
        of="smoothing",
        limit=1.0,
        source="the bound of the smoothing; its default is the paper's 1 mm; none where the bound "
        "is one of RMS or area",
        paper=1.0,
    ),
    Figure(
        "path_deviation_raw_max_mm",
        "Path deviation from raw samples",
        "mm",
        "as `path_deviation_max_mm`, with the samples before filtering",
        of="smoothing",
    ),
    Figure(
        "normal_error_median_deg",
        "Normal error, median",
        "deg",
        "angle between the planned probe axis, reversed, and the true normal, median over all "
        "interpolated poses of the 5D path. The true normal is that of the plane of least squared "
        "distances through the bone below the probe's crystal, about the nearest true surface "
        "point: a point of rough bone has another, which nothing that is pressed on it feels",
        of="smoothing",
        decimals=1,
        limit=1.0,
        source="1.0° off the normal a probe of 6 mm at 5 MHz has lost half of its echo",
    ),
    Figure(
        "normal_error_p95_deg",
        "Normal error, 95 %",
        "deg",
        "95th percentile of the angle of `normal_error_median_deg`",
        of="smoothing",
        decimals=1,
        limit=2.5,
        source="2.5° off the normal a probe of 3 mm at 5 MHz has lost half of its echo",
    ),
)

ROBOT_AND_SCAN = (
    Figure("rolls_tried", "Rolls tried", "", "roll angles that were judged", of="roll", decimals=0),
    Figure(
        "rolls_feasible",
        "Rolls the robot can traverse",
        "",
        "roll angles with which the whole path can be followed; branches of the arm are not "
        "counted separately",
        of="roll",
        decimals=0,
        limit=1.0,
        source="without one the path cannot be driven; none where the roll varies along the path",
        sense="at least",
    ),
    Figure("roll_mode", "Roll", "", "`constant`, `variable` or `none`", of="roll"),
    Figure(
        "roll_variation_deg",
        "Roll, variation along the path",
        "deg",
        "largest less smallest roll of the chosen one along the path; 0 where it is constant",
        of="roll",
        decimals=0,
    ),
    Figure(
        "min_joint_margin_deg",
        "Distance from joint limits, path",
        "deg",
        "least distance of any joint from its limits, over the planned motion from first to last "
        "path point",
        of="roll",
        decimals=1,
        limit=0.0,
        source="less cannot be driven",
        sense="at least",
    ),
    Figure(
        "min_clearance_mm",
        "Least clearance, whole motion",
        "mm",
        "least distance, over the whole certified motion, of any two parts that must not touch: "
        "robot, tool, head, table, floor, tracker; by the modelled obstacles, not by the truth",
        of="roll",
        decimals=1,
    ),
    Figure(
        "landmark_distance_mm",
        "Landmarks against the robot, RMS",
        "mm",
        "no truth: RMS distance, over the landmarks that were touched before the scan, between "
        "where tracker and pointer say they are and where the robot does; null where nothing was "
        "verified",
        of="landmarks",
        limit=2.0,
        source="the default of the gate before the scan",
        truth_of="landmark_sigma_mm",
    ),
    Figure(
        "landmark_sigma_mm",
        "Landmarks, expected",
        "mm",
        "predicted: what `landmark_distance_mm` is expected to be",
        of="landmarks",
    ),
    Figure(
        "scan_points",
        "A-scans",
        "",
        "A-scans taken in the first pass",
        of="capture scan",
        decimals=0,
    ),
    Figure(
        "second_pass_points",
        "A-scans of tilted passes",
        "",
        "A-scans taken in all tilted passes",
        of="capture second",
        decimals=0,
    ),
    Figure(
        "second_pass_reason",
        "No tilted passes, because",
        "",
        "why there were no tilted passes, or not all; null if there were",
    ),
    Figure(
        "references_reason",
        "No reference points, because",
        "",
        "why no reference points were measured with a caliper, or why they are not used; null if "
        "they are, or that stage was skipped",
    ),
    Figure(
        "scan_duration_s",
        "Scan duration",
        "s",
        "duration of the planned and verified trajectory, approach and retract included",
        of="roll",
        decimals=0,
        truth_of="scan_duration_predicted_s",
    ),
    Figure(
        "scan_duration_predicted_s",
        "Scan duration, expected",
        "s",
        "predicted: what `scan_duration_s` is expected to be, before a motion is planned; by "
        "length and way points of the smoothed path and the scan speed",
        of="smoothing",
        decimals=0,
    ),
    Figure(
        "contact_force_rms_n",
        "Force about its set point, RMS",
        "N",
        "RMS deviation of the pressing force, as measured and freed of the tool's weight, from "
        "its set point, over the steps of the force loop on the path; null where the scan was "
        "driven by position alone",
        of="capture scan",
        limit=0.7,
        source="the goal of `python -m benchmarks contact`",
    ),
    Figure(
        "contact_force_peak_n",
        "Largest force",
        "N",
        "largest measured pressing force from touching down to lifting off",
        of="capture scan",
        decimals=1,
        limit=6.0,
        source="the goal of `python -m benchmarks contact`",
    ),
    Figure(
        "head_shift_mm",
        "Head, shift since step 4",
        "mm",
        "no truth: how far the head lay in the scan, in the mean, from where it lay in step 4, at "
        "the middle of the scan, as its marker shows it; null where it was not watched",
        of="capture scan",
        decimals=3,
    ),
    Figure(
        "head_shift_sigma_mm",
        "Head, shift, predicted",
        "mm",
        "predicted: standard deviation (3D) of `head_shift_mm`",
        of="capture scan",
        decimals=3,
        limit=0.05,
        source="the goal of `python -m benchmarks head_motion`",
    ),
    Figure(
        "head_shift_error_mm",
        "Head, shift, error",
        "mm",
        "distance of the measured shift of the head from the true one",
        of="capture scan",
        decimals=3,
        limit=0.05,
        source="the goal of `python -m benchmarks head_motion`",
        truth_of="head_shift_sigma_mm",
    ),
    Figure(
        "head_motion_mm",
        "Head, motion during the scan",
        "mm",
        "no truth: largest distance of the head from its mean place during the scan, noise of the "
        "marker included",
        of="capture scan",
        limit=0.35,
        source="chosen: what an outer map may be off. For review, too, where the head was not "
        "watched",
    ),
)

MAPS = (
    Figure(
        "outer_sigma_predicted_mm",
        "Outer boundary, predicted",
        "mm",
        "predicted: what `outer_rms_mm` is expected to be",
        of="maps",
    ),
    Figure(
        "outer_rms_mm",
        "Outer boundary, RMS",
        "mm",
        "RMS error of the outer ultrasound map, before fusion, over its mapped cells, absolute, "
        "measured along the true outer normal",
        of="maps",
        limit=0.35,
        source="the paper; the median of the results page is 0.19, the worst 0.51, nearly all of "
        "it the assumed robot",
        paper=0.35,
        truth_of="outer_sigma_predicted_mm",
    ),
    Figure(
        "inner_sigma_predicted_mm",
        "Inner boundary, predicted",
        "mm",
        "predicted: what `inner_rms_mm` is expected to be",
        of="maps",
    ),
    Figure(
        "inner_rms_mm",
        "Inner boundary, RMS",
        "mm",
        "as `outer_rms_mm`, of the inner map",
        of="maps",
        limit=0.85,
        source="the paper: position and thickness together",
        paper=0.85,
        truth_of="inner_sigma_predicted_mm",
    ),
    Figure(
        "outer_same_robot_rms_mm",
        "Outer boundary, same robot",
        "mm",
        "`outer_rms_mm` for the same robot, which comes back to a place as it came there in the "
        "first pass",
        of="maps",
    ),
    Figure(
        "outer_other_roll_rms_mm",
        "Outer boundary, other roll",
        "mm",
        "the error of the outer map where the same robot comes with its roll turned by 90° (or as "
        "far as it reaches): its links err otherwise in another posture",
        of="maps",
    ),
    Figure(
        "inner_same_robot_rms_mm",
        "Inner boundary, same robot",
        "mm",
        "`inner_rms_mm` for the same robot",
        of="maps",
    ),
    Figure(
        "thickness_bias_mm",
        "Thickness, bias",
        "mm",
        "mean of mapped minus true thickness, both along the true outer normal, over cells mapped "
        "in both maps",
        of="maps",
    ),
    Figure(
        "thickness_map_sigma_predicted_mm",
        "Thickness, predicted",
        "mm",
        "predicted: what `thickness_rms_mm` is expected to be",
        of="maps",
    ),
    Figure(
        "thickness_rms_mm",
        "Thickness, RMS",
        "mm",
        "RMS of mapped minus true thickness, as in `thickness_bias_mm`",
        of="maps",
        limit=0.5,
        source="the paper; a patient whose bone is 8 % slower than published misses it until "
        "places of known thickness calibrate the speed",
        paper=0.5,
        truth_of="thickness_map_sigma_predicted_mm",
    ),
    Figure(
        "thickness_sigma_predicted_mm",
        "Thickness of A-scans, predicted",
        "mm",
        "predicted: standard deviation of a thickness; RMS over the sure A-scans of the root of "
        "the squared parts time of flight, speed of the patient (as far as studies differ), speed "
        "from place to place, lean of the inner table. Of the A-scans, not of the map: what "
        "interpolation adds stands in step 9",
        of="detection",
        limit=0.3,
        source="the goal of `python -m benchmarks sound_speed` without places of known thickness",
    ),
    Figure(
        "scan_thickness_rms_mm",
        "Thickness of sure A-scans, RMS",
        "mm",
        "RMS error of the thickness along the axis of the probe, at the speed the map takes, over "
        "the sure A-scans; those that are 0.5 mm off and more took another echo and are counted by "
        "the figures of wrong boundaries",
        of="detection",
        limit=0.3,
        source="as `thickness_sigma_predicted_mm`",
        paper=0.5,
        truth_of="thickness_sigma_predicted_mm",
    ),
    Figure(
        "sound_speed_error_percent",
        "Speed of sound, error",
        "%",
        "mean over the sure A-scans of the speed the map takes over the true one along the axis, "
        "minus 1",
        of="detection",
        decimals=1,
        limit=4.0,
        source="between two and three times what a speed called good may be unknown by (1.5 %)",
    ),
    Figure(
        "fused_outer_rms_mm",
        "Outer boundary after fusion, RMS",
        "mm",
        "error of the outer map after fusion with the pointer's cloud, absolute, on the cells "
        "that count for `outer_rms_mm`",
        of="maps",
        limit=0.35,
        source="as `outer_rms_mm`",
    ),
    Figure(
        "coverage_fraction",
        "Coverage, outer",
        "",
        "share of the requested disc that is mapped, outer boundary",
        of="maps",
        limit=0.9,
        source=WORST_OF_RESULTS,
        sense="at least",
        truth_of="coverage_predicted_fraction",
        share=True,
    ),
    Figure(
        "inner_coverage_fraction",
        "Coverage, inner",
        "",
        "share of the requested disc that is mapped, inner boundary",
        of="maps",
        limit=0.9,
        source=f"{WORST_OF_RESULTS}. One pass alone leaves gaps in the inner map, and is for "
        "review until the tilted ones",
        sense="at least",
        share=True,
    ),
    Figure(
        "inner_coverage_one_pass_fraction",
        "Coverage, inner, first pass",
        "",
        "share of the disc with an inner sample of the first pass within 2.5 mm",
        of="maps",
        share=True,
    ),
    Figure(
        "detection_failure_fraction",
        "Wrong inner boundary, all A-scans",
        "",
        "share of all A-scans of all passes, flagged ones too, whose thickness is more than 0.5 mm "
        "from the truth along the axis of the probe. It is that at the speed of "
        "the maps, measured with a caliper or else the published one: thick bone of another speed "
        "counts as wrong, too. An A-scan without an answer counts as wrong. Where the bone has no "
        "inner boundary, only an unflagged answer is wrong",
        of="detection",
        share=True,
    ),
    Figure(
        "unflagged_failure_fraction",
        "Wrong inner boundary, unflagged",
        "",
        "as `detection_failure_fraction`, among the unflagged A-scans alone: those that went into "
        "the inner map",
        of="detection",
        limit=0.04,
        source="chosen: flagged, not guessed (docs/metrics.md)",
        share=True,
    ),
    Figure(
        "flagged_fraction",
        "Flagged A-scans",
        "",
        "share of A-scans that are flagged",
        of="detection",
        share=True,
    ),
)

OUTER_CAUSES = (
    Figure(
        "outer_by_links_mm",
        "Links of the robot",
        "mm",
        "systematic error of the robot",
        of="maps",
        decimals=3,
    ),
    Figure(
        "outer_by_head_mm",
        "Head motion",
        "mm",
        "what the marker on the head left of its motion",
        of="maps",
        decimals=3,
    ),
    Figure(
        "outer_by_probe_mm",
        "Probe: mounting, line, coupling",
        "mm",
        "what all A-scans have in common besides: mounting, delay line, coupling",
        of="maps",
        decimals=3,
    ),
    Figure(
        "outer_by_sampling_mm",
        "Each echo, sampling and beam",
        "mm",
        "what cells err by besides: what each echo has for itself, what it averages of rough "
        "bone, and what lies between A-scans, which echoes cannot tell apart",
        of="maps",
        decimals=3,
    ),
)

THICKNESS_CAUSES = (
    Figure(
        "thickness_by_speed_mm",
        "Speed of sound, all echoes alike",
        "mm",
        "mean speed of sound of the patient, with what all its echoes have in common (a late echo "
        "and a slow bone cannot be separated, and with reference points they partly cancel)",
        of="maps",
        decimals=3,
    ),
    Figure(
        "thickness_by_place_mm",
        "Speed of sound, place",
        "mm",
        "speed of sound from place to place",
        of="maps",
        decimals=3,
    ),
    Figure(
        "thickness_by_echo_mm",
        "Each echo: timing",
        "mm",
        "what each echo has for itself",
        of="maps",
        decimals=3,
    ),
    Figure(
        "thickness_by_interpolation_mm",
        "Between A-scans, within the beam",
        "mm",
        "cells between A-scans and within the beam",
        of="maps",
        decimals=3,
    ),
)

IMPLANT_BED = (
    Figure(
        "burr_tip_error_mm",
        "Burr tip error",
        "mm",
        "distance from the registered tip of the burr to the true one, on the flange; null where "
        "it was not registered",
        of="burr",
        limit=0.5,
        source="as for the tool",
        truth_of="burr_tip_sigma_mm",
    ),
    Figure(
        "burr_tip_sigma_mm",
        "Burr tip, expected error",
        "mm",
        "predicted: standard deviation (3D) of the tip of the burr; chance, chuck, and what the "
        "robot does the same every time",
        of="burr",
        limit=0.4,
        source=OF_CALIBRATION,
        own_verdict=True,
    ),
    Figure(
        "bed_probability",
        "Implant bed, probability",
        "",
        "predicted: probability that the bed of step 10 leaves the bone that is wanted, and each "
        "screw finds its bone; least of these. Null where there is no bed",
        of="bed",
        decimals=3,
        share=True,
    ),
    Figure(
        "bed_residual_mm",
        "Bone below the bed, by the maps",
        "mm",
        "least bone left below that bed, the shortest way to the inner boundary, by the maps; a "
        "perfect burr",
        of="bed",
    ),
    Figure(
        "bed_residual_true_mm",
        "Bone below the bed, true",
        "mm",
        "as `bed_residual_mm`, in truth, where the robot that made the maps arrives",
        of="bed",
    ),
    Figure(
        "bed_reason",
        "No implant bed, because",
        "",
        "why there is no safe implant bed, null if there is one, or the run ended before",
    ),
    Figure(
        "milling_reason",
        "Not milled, because",
        "",
        "why the milling was not planned or not rehearsed, null if it was, or that stage was "
        "skipped",
    ),
    Figure(
        "rehearsal_residual_mm",
        "Bone left, by the rehearsal",
        "mm",
        "least bone that a rehearsal of the milling left, by maps and re-scan; negative: the dura "
        "was reached. Null without a rehearsal",
        of="rehearsal",
    ),
    Figure(
        "rehearsal_residual_true_mm",
        "Bone left by a rehearsal, true",
        "mm",
        "as `rehearsal_residual_mm`, in truth; null where the way that was milled is not stored: "
        "files of earlier versions hold no motion of raised layers",
        of="rehearsal",
    ),
    Figure(
        "rehearsal_raised_mm",
        "Rehearsal: floor above plan",
        "mm",
        "height of the milled floor over the planned one",
        of="rehearsal",
    ),
    Figure(
        "rehearsal_raised_s",
        "Rehearsal: time of raised layers",
        "s",
        "how long the certified motion of the raised layers lasts, from home to home; null where "
        "none was raised or none is certified",
        of="rehearsal",
        decimals=0,
    ),
    Figure(
        "rehearsal_implant_high_mm",
        "Rehearsal: implant over its seat",
        "mm",
        "how high the implant stands over its planned seat, negative if deeper; null where "
        "the milling was stopped",
        of="rehearsal",
    ),
    Figure(
        "rehearsal_rock_mm",
        "Rehearsal: rock of the implant",
        "mm",
        "by how much the lower side of the implant dips at the edge where it is pressed; null "
        "where the milling was stopped",
        of="rehearsal",
    ),
)

HANDHELD = (
    Figure(
        "sono_face_error_mm",
        "By hand: face of the probe, error",
        "mm",
        "distance of the calibrated middle of the face of the hand-held probe from the true one, "
        "in its marker frame",
        of="sono",
        limit=0.5,
        source="chosen, as for the pointer; 0.16 mm is the worst",
    ),
    Figure(
        "sono_axis_error_deg",
        "By hand: axis of the probe, error",
        "deg",
        "angle between the calibrated and the true axis of the hand-held probe",
        of="sono",
        limit=0.5,
        source="chosen; 0.05° is the worst",
    ),
    Figure(
        "sono_outer_rms_mm",
        "By hand: outer boundary, RMS",
        "mm",
        "as `outer_rms_mm`, of the maps of the scan by hand. Without the robot these are in the "
        "frame of the base marker, and its true mounting brings them to the base for this "
        "comparison alone; null where there was no scan by hand, as in `rona demo`",
        of="sono_maps",
        limit=0.35,
        source=OF_THE_PAPER,
    ),
    Figure(
        "sono_inner_rms_mm",
        "By hand: inner boundary, RMS",
        "mm",
        "as `inner_rms_mm`, of the same maps",
        of="sono_maps",
        limit=0.85,
        source=OF_THE_PAPER,
    ),
    Figure(
        "sono_thickness_rms_mm",
        "By hand: thickness, RMS",
        "mm",
        "as `thickness_rms_mm`, of the same maps",
        of="sono_maps",
        limit=0.5,
        source=OF_THE_PAPER,
        paper=0.5,
    ),
    Figure(
        "sono_coverage_fraction",
        "By hand: coverage, outer",
        "",
        "share of the requested disc that the scan by hand maps, outer boundary",
        of="sono_maps",
        limit=0.9,
        source="the worst of the scans by hand: the outer boundary is covered wholly",
        sense="at least",
        share=True,
    ),
    Figure(
        "sono_inner_coverage_fraction",
        "By hand: coverage, inner",
        "",
        "as `sono_coverage_fraction`, inner boundary",
        of="sono_maps",
        limit=0.9,
        source="the worst of the scans by hand",
        sense="at least",
        share=True,
    ),
)

RUN = (
    Figure("completed", "Completed", "", "true if every step has its result"),
    Figure(
        "failed_step", "Failed step", "", "the first step without a result; null where all have one"
    ),
    Figure("reason", "Because", "", "why that step has no result"),
    Figure(
        "wall_s",
        "Elapsed time",
        "s",
        "elapsed time of the whole procedure, where it was run in one call",
        decimals=0,
    ),
)

SECTIONS: dict[str, tuple[Figure, ...]] = {
    "Calibration": CALIBRATION,
    "Surface and path": SURFACE_AND_PATH,
    "Robot and scan": ROBOT_AND_SCAN,
    "Maps": MAPS,
    "Outer boundary by cause": OUTER_CAUSES,
    "Thickness by cause": THICKNESS_CAUSES,
    "Implant bed": IMPLANT_BED,
    "Handheld scan": HANDHELD,
    "The run as a whole": RUN,
}
FIGURES: dict[str, Figure] = {one.key: one for part in SECTIONS.values() for one in part}
PREDICTED = frozenset(one.truth_of for one in FIGURES.values()) - {""}  # keys of predictions


def limit_of(key: str) -> float:
    """Return the limit of a figure that has one.

    Raises:
        KeyError: no such figure, or one without a limit.
    """
    limit = FIGURES[key].limit
    if limit is None:
        raise KeyError(f"the figure {key} has no limit")
    return limit
