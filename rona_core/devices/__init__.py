"""Device protocols, samples, settings and recordings, whether virtual, replayed or real."""
