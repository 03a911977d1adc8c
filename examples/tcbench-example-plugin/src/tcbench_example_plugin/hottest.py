"""A further column of the conservation table."""

from tcbench import Metric, hookimpl


def hottest(trajectory):
    """Largest recorded temperature of any element; dimensionless."""
    return float(trajectory.temperatures.max())


@hookimpl
def tcbench_metrics():
    return [Metric(name="hottest", compute=hottest, description="largest recorded temperature")]
