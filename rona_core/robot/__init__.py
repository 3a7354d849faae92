"""The robot: kinematics, the search over the free roll, verification and timing."""
