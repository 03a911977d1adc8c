"""Continua: `solid[n=2,element=hex]` in space, a shear-flexible `rod[n=20]`, a rotating `ring[n=24]`, Sod's
`gas_tube[n=100]`, and phases that part, `cahn_hilliard[n=16]`."""

from typing import Any

from tcbench import ScenarioFamily, hookimpl

MANY = (2, 100_000)
FAMILIES: dict[str, tuple[dict[str, str], dict[str, Any], str, str]] = {  # settings, which may be, shows, source
    "solid": ({"n": "1", "element": "tet", "viscosity": ""},
              {"n": (1, 40), "element": ("tet", "hex"), "viscosity": float},  # 40: 600,000 numbers
              "large rotations of a solid in space that conducts",
              "L-shaped block: Simo and Tarnow (1992), ZAMP 43:757; Romero (2010), IJNME 84:588"),
    "rod": ({"n": "20"}, {"n": MANY}, "an angle as a variable: energy is exact, the angular momentum is not",
            "shear-flexible rod: Reissner (1972), ZAMP 23:795; Simo and Vu-Quoc (1986), J. Appl. Mech. 53:849"),
    "ring": ({"n": "24"}, {"n": (4, 100_000)}, "bending and spin over many turns, all momenta exact",
             "rotating ring with bending, by squared lengths and second differences"),
    "gas_tube": ({"n": "100"}, {"n": (4, 100_000)}, "a shock: entropy is made where the gas is compressed",
                 "Sod (1978), J. Comput. Phys. 27:1, in Lagrangian form with viscosity and conduction"),
    "cahn_hilliard": ({"n": "16"}, {"n": (3, 400)}, "stiff diffusion without motion: phases part and the heat stays",
                      "Cahn and Hilliard (1958), J. Chem. Phys. 28:258, with heat"),
}  # fmt: skip


@hookimpl
def tcbench_scenarios() -> list[ScenarioFamily]:
    return [
        ScenarioFamily(name, f"{__name__}.{name}:{name}", settings, *told, takes=takes)
        for name, (settings, takes, *told) in FAMILIES.items()
    ]
