"""The world that devices and patient are drawn from; unknown to every algorithm."""
