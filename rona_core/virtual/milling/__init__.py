"""Truth of a milling: the bone under the burr, the force on it, and what a probe hears below."""
