"""Systems that grow: nets, `net[nx=4,ny=4]`, in space `truss3d[nx=2,ny=2,nz=4]`; and a continuum, `bar[n=20]`."""

from tcbench import ScenarioFamily, hookimpl

SPRINGS = "Romero (2009), section 4, with the masses and springs of a"
BAR = "standard linear solid with heat conduction, linear finite elements; dimensionless"
DASHPOTS = {"viscosity": float}  # of dashpots beside each spring; none


@hookimpl
def tcbench_scenarios():
    return [
        ScenarioFamily(
            "net", f"{__name__}.net:dashed_net", {"nx": "4", "ny": "4", "viscosity": ""},
            "cost against size, in the plane", f"{SPRINGS} net", takes={"nx": (2, 1000), "ny": (2, 1000)} | DASHPOTS,
        ),
        ScenarioFamily(
            "truss3d", f"{__name__}.truss:dashed_truss", {"nx": "2", "ny": "2", "nz": "4", "viscosity": ""},
            "cost against size, in space", f"{SPRINGS} bar",
            takes={"nx": (2, 200), "ny": (2, 200), "nz": (1, 200)} | DASHPOTS,
        ),
        ScenarioFamily(
            "bar", f"{__name__}.bar:bar", {"n": "20"}, "a continuum: waves in a bar that relaxes and conducts", BAR,
            takes={"n": (2, 100_000)},
        ),
    ]  # fmt: skip
