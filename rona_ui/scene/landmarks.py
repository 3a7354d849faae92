"""Landmarks of the verification: as the robot knows them, and as tracker and pointer do."""

import numpy as np

from rona_core.app.steps.scan.landmarks.view import LandmarkReport, landmark_report
from rona_ui.presentation.colors import GREEN, ORANGE, STEEL, VERMILLION, Rgb
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import NO_LINES, NO_POINTS

ROBOT, POINTER, APART = "/landmarks/robot", "/landmarks/pointer", "/landmarks/apart"
LABEL = "/landmarks/label"
ARM_MM, DOT_MM = 7.0, 3.5
UP_MM = (0.0, 0.0, 16.0)  # of a label
COLORS: dict[str, Rgb] = {"passed": GREEN, "failed": VERMILLION, "overridden": ORANGE}


class LandmarkLayer(Layer):
    """Draws a cross where the robot's tip touched, a dot where the pointer is said to be."""

    layer = "landmarks"
    follows = ("session", "view.step", "view.all_layers", "view.hidden")
    names = (ROBOT, POINTER, APART)

    def draw(self, new: Snapshot) -> None:
        """Draw crosses, dots, and a label with the distance at each."""
        report = landmark_report(new.session)
        color = COLORS.get(report.state, STEEL)
        self.nodes.lines(ROBOT, crosses(report), STEEL, width_px=3.0)
        dots = [row.pointer_base_mm for row in report.rows if row.pointer_base_mm is not None]
        points = np.array(dots, dtype=np.float64).reshape(-1, 3)
        self.nodes.cloud(POINTER, points if len(points) else NO_POINTS, color, size_mm=DOT_MM)
        pairs = [
            (row.robot_base_mm, row.pointer_base_mm)
            for row in report.rows
            if row.pointer_base_mm is not None
        ]
        apart = np.array(pairs, dtype=np.float64).reshape(-1, 2, 3) if pairs else NO_LINES
        self.nodes.lines(APART, apart, color, width_px=4.0)
        self._label(report if self.shown(new) else LandmarkReport(report.state, ""))

    def _label(self, report: LandmarkReport) -> None:
        wanted = {f"{LABEL}/{i}": row for i, row in enumerate(report.rows)}
        for name in self.nodes.names():
            if name.startswith(LABEL) and name not in wanted:
                self.nodes.remove(name)
        for name, row in wanted.items():
            far = "not seen" if row.distance_mm is None else f"{row.distance_mm:.2f} mm"
            self.nodes.label(name, f"{row.name}: {far}", np.add(row.robot_base_mm, UP_MM))


def crosses(report: LandmarkReport) -> np.ndarray:
    """Return three short lines through each landmark (3 n, 2, 3)."""
    if not report.rows:
        return NO_LINES
    places = np.array([row.robot_base_mm for row in report.rows])
    arms = ARM_MM * np.eye(3)
    return np.stack((places[:, None] - arms, places[:, None] + arms), axis=2).reshape(-1, 2, 3)
