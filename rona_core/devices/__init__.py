"""What a tracker, a robot, a probe and a hand are to RONA, whether virtual, replayed or real."""
