"""Continua: `solid[n=2,element=hex]` in space, a shear-flexible `rod[n=20]`, a rotating `ring[n=24]`, Sod's
`gas_tube[n=100]`, and phases that part, `cahn_hilliard[n=16]`."""

from collections.abc import Callable
from typing import Any

from tcbench import ScenarioFamily, hookimpl

FAMILIES: dict[str, tuple[dict[str, str], str, str]] = {  # settings, what it shows, source
    "solid": ({"n": "1", "element": "tet", "viscosity": ""}, "large rotations of a solid in space that conducts",
              "L-shaped block: Simo and Tarnow (1992), ZAMP 43:757; Romero (2010), IJNME 84:588"),
    "rod": ({"n": "20"}, "an angle as a variable: energy is exact, the angular momentum is not",
            "shear-flexible rod: Reissner (1972), ZAMP 23:795; Simo and Vu-Quoc (1986), J. Appl. Mech. 53:849"),
    "ring": ({"n": "24"}, "bending and spin over many turns, all momenta exact",
             "rotating ring with bending, by squared lengths and second differences"),
    "gas_tube": ({"n": "100"}, "a shock: entropy is made where the gas is compressed",
                 "Sod (1978), J. Comput. Phys. 27:1, in Lagrangian form with viscosity and conduction"),
    "cahn_hilliard": ({"n": "16"}, "stiff diffusion without motion: phases part and the heat stays",
                      "Cahn and Hilliard (1958), J. Chem. Phys. 28:258, with heat"),
}  # fmt: skip


def _of(name: str) -> Callable[..., Any]:
    def make(**settings: str) -> Any:
        from importlib import import_module  # when one is asked for, not when plugins are listed

        return getattr(import_module(f"{__name__}.{name}"), f"{name}_of")(**settings)

    return make


@hookimpl
def tcbench_scenarios() -> list[ScenarioFamily]:
    return [ScenarioFamily(name, _of(name), *rest) for name, rest in FAMILIES.items()]
