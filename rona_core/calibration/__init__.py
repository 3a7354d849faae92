"""Calibration of tools and pointers, and registration of robot and tracker."""
