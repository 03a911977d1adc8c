"""Nets of springs in the plane, `net[nx=4,ny=4]`: a system that grows."""

from tcbench import ScenarioFamily, hookimpl


def net_of(nx, ny):
    from . import net  # networks are imported when one is asked for, not when plugins are listed

    return net.net_of(nx, ny)


@hookimpl
def tcbench_scenarios():
    source = "Romero (2009), section 4, with the masses and springs of a net"
    return [ScenarioFamily("net", net_of, {"nx": "4", "ny": "4"}, "cost against size, in the plane", source)]
