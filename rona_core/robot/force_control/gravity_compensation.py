"""Payload identification from static wrench measurements, and gravity compensation.

The sensor sits on the flange: ``sensor`` is ``flange``. Forces in N, torques in N mm.
"""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.wrench import SensorModel, ToolLoad
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.robot.kinematics.robot_model import RobotModel, Tool

GRAVITY_BASE = np.array((0.0, 0.0, -9.80665))  # m/s^2, z of ``base`` is up
LEAST_POSES = 4
LEAST_SPREAD = 0.1  # of gravity's direction in the sensor: smallest singular value, per pose
LEAST_MASS_KG = 1e-3
MASS_SIGMAS = 3.0  # by which a weighed mass may differ from the stated one
G_PER_KG = 1000.0


def fit_tool_load(rotations_base_sensor: ArrayLike, wrenches: ArrayLike) -> ToolLoad:
    """Return mass, centre of mass and offset from readings in free poses, by least squares.

    Args:
        rotations_base_sensor: Orientation of the sensor (n, 3, 3) in each pose.
        wrenches: What it showed there (n, 6), averaged.

    Raises:
        InvalidInputError: wrong shapes.
        DegenerateGeometryError: too few poses, or the sensor was turned too little between them.
    """
    rotations = as_floats(rotations_base_sensor, name="rotations_base_sensor")
    seen = as_floats(wrenches, name="wrenches")
    n = len(seen)
    if rotations.shape != (n, 3, 3) or seen.shape != (n, 6):
        raise InvalidInputError("n poses need rotations (n, 3, 3) and wrenches (n, 6)")
    if n < LEAST_POSES:
        raise DegenerateGeometryError(f"{n} poses are too few to weigh a tool: {LEAST_POSES}")
    gravity = np.einsum("nji,j->ni", rotations, GRAVITY_BASE)  # (n, 3) in the sensor
    down = gravity / np.linalg.norm(GRAVITY_BASE)
    spread = np.linalg.svd(down - down.mean(axis=0), compute_uv=False) / np.sqrt(n)
    if spread[1] < LEAST_SPREAD:
        raise DegenerateGeometryError(
            f"the tool was turned too little to be weighed: {spread[1]:.2g} of gravity across the "
            f"first turn, {LEAST_SPREAD:g} is needed; turn it about two axes"
        )
    eyes = np.tile(np.eye(3), (n, 1))
    by_force = np.column_stack((gravity.reshape(-1), eyes))  # mass, offset
    force = np.linalg.lstsq(by_force, seen[:, :3].reshape(-1))[0]
    # (m com) x g = -[g]x (m com)
    turning = np.concatenate([-cross_matrix(g) for g in gravity])
    by_torque = np.column_stack((turning, eyes))  # mass times centre, offset
    torque = np.linalg.lstsq(by_torque, seen[:, 3:].reshape(-1))[0]
    mass = float(force[0])
    if mass < LEAST_MASS_KG:
        raise DegenerateGeometryError(f"the tool seems to weigh {1000.0 * mass:.2g} g")
    left = seen[:, :3].reshape(-1) - by_force @ force, seen[:, 3:].reshape(-1) - by_torque @ torque
    variance = float(left[0] @ left[0]) / (3 * n - by_force.shape[1])
    mass_sigma = np.sqrt(variance * np.linalg.inv(by_force.T @ by_force)[0, 0])
    return ToolLoad(
        mass_kg=mass,
        com_sensor_mm=readonly(as_floats(torque[:3] / mass)),
        offset=readonly(as_floats(np.concatenate((force[1:], torque[3:])))),
        residual_n=float(np.sqrt((left[0] ** 2).mean())),
        residual_nmm=float(np.sqrt((left[1] ** 2).mean())),
        n_poses=n,
        mass_sigma_kg=float(mass_sigma),
    )


def mass_disagreement(load: ToolLoad, tool: Tool) -> str | None:
    """Return that the weighed mass m is not the stated mass m0, and what to do; None where it is.

    They agree where |m - m0| <= 3 sqrt(sigma_m^2 + sigma_m0^2), sigma_m by the residual of the
    identification and sigma_m0 as the tool states it (two-sided z test, 0.3 % of false alarms).
    """
    sigma = float(np.hypot(load.mass_sigma_kg, tool.mass_sigma_kg))
    if abs(load.mass_kg - tool.mass_kg) <= MASS_SIGMAS * sigma:
        return None
    weighed, stated = (
        f"{G_PER_KG * mass:.0f} ± {G_PER_KG * error:.0f} g"
        for mass, error in (
            (load.mass_kg, load.mass_sigma_kg),
            (tool.mass_kg, tool.mass_sigma_kg),
        )
    )
    return (
        f"The tool on the flange weighs {weighed}, the model of the robot states {stated}: another "
        "tool is clamped, a part is missing, or a cable pulls. Check what is on the flange and "
        "scan again; if it is right, state its mass in the model (Tool.mass_kg)"
    )


def pressing_force_n(
    load: ToolLoad, up_sensor: Floats, wrench: Floats, axis_sensor: Floats
) -> float:
    """Return the force with which the tool presses along its axis, the weight taken off.

    ``up_sensor`` is z of ``base`` (3,) in the sensor.
    """
    weight = load.mass_kg * GRAVITY_BASE[2] * up_sensor
    return -float((wrench[:3] - (weight + load.offset[:3])) @ axis_sensor)


def probe_axis_sensor(model: RobotModel) -> Floats:
    """Return the axis of the probe (3,) in ``sensor``, whose axes are those of ``flange``."""
    return model.T_flange_probe.rotation[:, 2]


def lever_mm(model: RobotModel) -> float:
    """Return the distance of the probe's axis from the origin of the sensor."""
    T_flange_probe = model.T_flange_probe
    return float(
        np.linalg.norm(np.cross(T_flange_probe.translation, T_flange_probe.rotation[:, 2]))
    )


def force_range_n(model: RobotModel, sensor: SensorModel) -> float:
    """Return the largest pressing force that leaves neither force nor torque range.

    A tool across the flange turns force into torque: with a lever beyond torque range over force
    range (79 mm for 5000 N mm and 63 N) the torque range is what limits the force.
    """
    lever = lever_mm(model)
    by_torque = sensor.torque_range_nmm / lever if lever > 0.0 else np.inf
    return float(min(sensor.force_range_n, by_torque))


def cross_matrix(v: Floats) -> Floats:
    """Return the matrix (3, 3) that takes the cross product with ``v`` from the left."""
    x, y, z = v
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
