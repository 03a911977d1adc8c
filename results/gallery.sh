#!/bin/sh
# Regenerates the pictures of docs/gallery.md from a run: `tcbench run --all`, then `sh results/gallery.sh results/latest`.
# Without a folder it first measures what the pictures need, into results/gallery.
set -e
cd "$(dirname "$0")/.."
run=${1:-results/gallery}
out=docs/gallery
mkdir -p "$out"
if [ $# -eq 0 ]; then
    tcbench run -s stiff_spring --study conservation --study stability --study work_precision --quiet -o "$run"
    tcbench run -s bound_equilibrium --study conservation --quiet -o "$run"
    tcbench run -s short_term --study convergence --quiet -o "$run"
    tcbench run -s relative_equilibrium --study equilibrium --quiet -o "$run"
    tcbench run --study ensemble --quiet -o "$run"
fi
tcbench map tc_monolithic midpoint_entropy short_term --x dt=0.02:4:24:log --y 'stiffness[1]=1:1000:20:log' --quiet -o results/gallery-map
tcbench map midpoint_entropy gauss2 random --x dt=0.025:1.6:7:log --y stiffness=0.03:300:6:log --quiet -o results/gallery-failures

five=tc_monolithic,tc_staggered,tc_strang,midpoint_entropy,midpoint_temperature
draw() {  # NAME KIND [OPTION...]
    name=$1; kind=$2; shift 2
    tcbench plot "$kind" "$run" "$@" -o "$out/$name.png"
}
draw speed_accuracy work-precision -s stiff_spring --y error_q --y energy_error_max --size 8.6x3.6 \
    --methods tc_gauss_adaptive,heyoka,scipy_odeint,tc_monolithic,midpoint_entropy
draw stable_steps stable-step -s stiff_spring --size 7x3.6
draw failure_shares failure-share --size 7.5x3.6 --methods $five,gauss2,gauss3,verlet_heat,tc_gonzalez
draw profile performance-profile --y state --size 9x5.4
draw clouds error-time --size 7x4
draw law_quantiles law-quantiles --size 9x4.8
draw laws laws -s stiff_spring --dt 0.3 --size 8x4 --methods $five
draw in_time in-time -s stiff_spring --dt 0.3 --size 8x4 --methods $five
draw conservation conservation -s stiff_spring --size 9x3 --methods $five
draw four_panel four-panel -s stiff_spring --dt 0.3 --size 8x4.6 --methods midpoint_entropy,tc_monolithic
draw path path -s bound_equilibrium --size 8x3.6 --methods midpoint_entropy,tc_monolithic
draw convergence convergence -s short_term --y p --y s --size 8.6x3.8 --methods tc_monolithic,tc_staggered,tc_strang,midpoint_entropy,gauss2,gauss3
draw blowup_times blowup -s stiff_spring --size 7x3.4 --methods midpoint_entropy,midpoint_temperature,gauss2,gauss3
draw equilibrium equilibrium -s relative_equilibrium --size 8x4.4 --methods tc_monolithic,tc_staggered,midpoint_entropy
run=results/gallery-map
draw map map --size 8x4.4
run=results/gallery-size
tcbench run --study size -i tc_monolithic -i tc_strang --quiet -o "$run"
draw size size --size 9x4.6
run=results/gallery-mesh
tcbench run --study mesh -i tc_monolithic --quiet -o "$run"
draw mesh mesh
run=results/gallery-tolerance
tcbench run --study tolerance -s gas_containers -i tc_monolithic -i tc_auto -i scipy_odeint -i solve_ivp_radau -i gauss2 -i variational \
    --quiet -o "$run"
draw tolerance tolerance -s gas_containers
tcbench run --study reachable_range -s short_term -i tc_monolithic -i gauss2 -i variational --quiet -o "$run"
draw reachable_range reachable-range -s short_term
run=results/gallery-failures
draw failure_map failure-map --size 7.5x3.2
tcbench animate midpoint_entropy tc_monolithic stiff_spring --dt 0.15 --t-end 6 --frames 60 --fps 15 -o "$out/blowup.gif"
