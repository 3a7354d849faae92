"""A-mode ultrasound: probe, echo model, and detection of the skull boundaries."""
