"""Nets of springs in the plane, `net[nx=4,ny=4]`: a system that grows."""

from tcbench import ScenarioFamily, hookimpl

from .net import net_of


@hookimpl
def tcbench_scenarios():
    source = "Romero (2009), section 4, with the masses and springs of a net"
    return [ScenarioFamily("net", net_of, {"nx": "4", "ny": "4"}, "cost against size, in the plane", source)]
