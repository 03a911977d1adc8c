"""Speed of every registered integrator. A new plugin is measured without an edit here."""

import tcbench

STEPS = 1000
METHODS = [i.name for i in tcbench.integrators().values() if i.kind != "adaptive"]
SCENARIOS = list(tcbench.scenarios())


def steps_of(integrator, scenario, steps=STEPS, **options):
    """A run of that many steps of the scenario's own size (or as many as the scenario allows)."""
    scenario = tcbench.scenarios()[scenario]
    return tcbench.simulate(integrator, scenario, t_end=steps * scenario.dt, record_every=None, **options)


class Steps:
    """A thousand steps: milliseconds here are microseconds a step. Runs that fail are left out."""

    params = (METHODS, SCENARIOS)
    param_names = ("integrator", "scenario")
    warmup_time = 0.05

    def setup(self, integrator, scenario):
        if not steps_of(integrator, scenario).ok:
            raise NotImplementedError("the run fails at the scenario's own step")  # how asv is told to leave it out

    def time_thousand_steps(self, integrator, scenario):
        steps_of(integrator, scenario)


class Call:
    """What a warm call costs beside its steps."""

    def setup(self):
        steps_of("tc_monolithic", "short_term", 1)

    def time_simulate_one_step(self):
        steps_of("tc_monolithic", "short_term", 1)


class Memory:
    """Memory must not grow with the number of steps."""

    params = (1_000, 1_000_000)
    param_names = ("steps",)

    def peakmem_metrics_only(self, steps):
        scenario = tcbench.scenarios()["bound_equilibrium"]
        tcbench.simulate("tc_monolithic", scenario, dt=0.05, t_end=0.05 * steps, record_every=None)
