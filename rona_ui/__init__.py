"""RONA in the browser and on the command line: panels, scene, REST, server."""
