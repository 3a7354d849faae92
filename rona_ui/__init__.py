"""The browser interface of RONA."""
