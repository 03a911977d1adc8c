"""Nets of springs, `net[nx=4,ny=4]` in the plane and `truss3d[nx=2,ny=2,nz=4]` in space: systems that grow."""

from tcbench import ScenarioFamily, hookimpl


def net_of(nx, ny):
    from . import net  # networks are imported when one is asked for, not when plugins are listed

    return net.net_of(nx, ny)


def truss_of(nx, ny, nz):
    from . import truss

    return truss.truss_of(nx, ny, nz)


@hookimpl
def tcbench_scenarios():
    source = "Romero (2009), section 4, with the masses and springs of a"
    return [
        ScenarioFamily("net", net_of, {"nx": "4", "ny": "4"}, "cost against size, in the plane", f"{source} net"),
        ScenarioFamily(
            "truss3d", truss_of, {"nx": "2", "ny": "2", "nz": "4"}, "cost against size, in space", f"{source} bar"
        ),
    ]
