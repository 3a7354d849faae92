"""RONA core: calibration, path planning, ultrasound mapping and the session that holds them.

Works in a bare notebook; knows nothing of the browser or the web server.
"""

__version__ = "0.1.0"
