#!/bin/sh
# Regenerates the pictures of docs/gallery.md. It measures first (minutes), into results/gallery.
# After `tcbench run --all`, `sh results/gallery.sh results/latest` draws from that run instead.
set -e
cd "$(dirname "$0")/.."
run=${1:-results/gallery}
orders=$run
out=docs/gallery
mkdir -p "$out"
if [ $# -eq 0 ]; then
    tcbench run -s stiff_spring --study conservation --study stability --study work_precision --quiet -o "$run"
    tcbench run -s short_term --study convergence --quiet -o "$run-orders"
    orders=$run-orders
fi
tcbench plot work-precision "$run" -s stiff_spring --y error_q --y energy_error_max --size 8.6x3.6 -o "$out/speed_accuracy.png" \
    --methods tc_gauss_adaptive,heyoka,scipy_odeint,tc_monolithic,midpoint_entropy
tcbench plot stable-step "$run" -s stiff_spring --size 7x3.6 -o "$out/stable_steps.png"
tcbench plot laws "$run" -s stiff_spring --dt 0.3 --size 8x4 -o "$out/laws.png" \
    --methods tc_monolithic,tc_staggered,tc_strang,midpoint_entropy,midpoint_temperature
tcbench plot convergence "$orders" -s short_term -o "$out/convergence.png" \
    --methods tc_monolithic,tc_staggered,tc_strang,midpoint_entropy,gauss2,gauss3
tcbench animate midpoint_entropy tc_monolithic stiff_spring --dt 0.15 --t-end 6 --frames 60 --fps 15 -o "$out/blowup.gif"
