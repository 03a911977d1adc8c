#!/bin/sh
# Regenerates results/baseline: the paper's five methods on the seven scenarios, every study, and a chart of the README.
set -e
cd "$(dirname "$0")/.."
methods="-i tc_monolithic -i tc_staggered -i tc_strang -i midpoint_entropy -i midpoint_temperature"
scenarios="-s short_term -s long_term -s relative_equilibrium -s bound_equilibrium -s stiff_spring -s cold_spring"
studies="--study conservation --study convergence --study equilibrium --study claims --study stability"
tcbench run $methods $scenarios -s fast_conduction $studies --report --fresh --quiet -o results/baseline
tcbench plot laws results/baseline -s stiff_spring --dt 0.3 -o results/baseline/stiff_spring.png
