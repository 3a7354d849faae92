"""Which further scan lines tell most of the bone below one bed."""
