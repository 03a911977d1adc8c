"""The asv suite: speed and quality of every registered integrator, over the commits."""
