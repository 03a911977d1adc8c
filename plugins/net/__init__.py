"""Systems that grow: nets, `net[nx=4,ny=4]`, in space `truss3d[nx=2,ny=2,nz=4]`; and a continuum, `bar[n=20]`."""

from tcbench import ScenarioFamily, hookimpl


def net_of(nx, ny, viscosity):
    from . import net  # networks are imported when one is asked for, not when plugins are listed

    return net.net_of(nx, ny, viscosity)


def truss_of(nx, ny, nz, viscosity):
    from . import truss

    return truss.truss_of(nx, ny, nz, viscosity)


def bar_of(n):
    from . import bar

    return bar.bar_of(n)


@hookimpl
def tcbench_scenarios():
    dashpots = {"viscosity": ""}  # of those beside each spring; none
    source = "Romero (2009), section 4, with the masses and springs of a"
    return [
        ScenarioFamily(
            "net", net_of, {"nx": "4", "ny": "4"} | dashpots, "cost against size, in the plane", f"{source} net"
        ),
        ScenarioFamily(
            "truss3d",
            truss_of,
            {"nx": "2", "ny": "2", "nz": "4"} | dashpots,
            "cost against size, in space",
            f"{source} bar",
        ),
        ScenarioFamily(
            "bar",
            bar_of,
            {"n": "20"},
            "a continuum: waves in a bar that relaxes and conducts",
            "standard linear solid with heat conduction, linear finite elements; dimensionless",
        ),
    ]
