"""The tip of the burr, registered in a seat about which the robot turns the spindle."""
