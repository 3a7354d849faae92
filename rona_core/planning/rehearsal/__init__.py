"""Rehearsal of a milling: what is decided from force, commanded places and A-scans alone."""
