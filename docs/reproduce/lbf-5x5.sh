#!/usr/bin/env bash
# Trains five seeds of IPPO and five of MTPPO on lbf-5x5-2p-1f with the settings of the reference curves in
# docs/reference-curves, draws all of them into one picture, and compares IPPO with the reference.
#
#   docs/reproduce/lbf-5x5.sh [FOLDER]      FOLDER, default runs/lbf-5x5, must not exist yet
#
# RONDO names the program (default: built here), JOBS how many seeds train side by side (default 1).
set -euo pipefail

root=$(cd "$(dirname "$0")/../.." && pwd)
out=${1:-runs/lbf-5x5}
reference=("$root"/docs/reference-curves/ippo-lbf-5x5-2p-1f-s*.json)

if [ -e "$out" ]; then
    echo "error: $out exists; name another folder, or remove it" >&2
    exit 78
fi
if [ -z "${RONDO:-}" ]; then
    cargo build --release --manifest-path "$root/Cargo.toml"
    RONDO=${CARGO_TARGET_DIR:-$root/target}/release/rondo
fi

train() { # NAME OPTION...
    local name=$1
    shift
    "$RONDO" train lbf-5x5-2p-1f --t-max 100000 --test-interval 20000 \
        --seeds 5 --jobs "${JOBS:-1}" --quiet --out "$out/$name" "$@"
}

train ippo --algo ippo --lr-fast 3e-4
# One step of the paper.s grid of rates above and below 2e-4.
train mtppo --algo mtppo --lr-fast 4e-4 --lr-slow 1e-4

"$RONDO" plot "$out/ippo" "$out/mtppo" "${reference[@]}" --out "$out/learning-curves.png" \
    --title "lbf-5x5-2p-1f, five seeds"
"$RONDO" compare "$out/ippo" --reference "${reference[@]}"
