"""Maps beside a reference: another surface of the same bone, and how far they are apart."""
