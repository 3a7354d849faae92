"""Verification of tracker registration and pointer on landmarks, before the robot may scan."""
