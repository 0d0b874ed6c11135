#!/usr/bin/env bash
# Trains the teams of a section of docs/results.md, five seeds each, draws their curves, and compares them with the
# reference if docs/reference-curves has its curves.
#
#   docs/reproduce/curves.sh SECTION [FOLDER]      FOLDER, default runs/SECTION, must not exist yet
#
# Sections: lbf-5x5, lbf-5x5-q, speaker-listener, speaker-listener-q, speaker-listener-current, tag, adversary, rware
#
# RONDO names the program (default: built here), JOBS how many seeds train side by side (default 1).
set -euo pipefail

root=$(cd "$(dirname "$0")/../.." && pwd)
section=${1:?which section? see the first lines of this file}
out=${2:-runs/$section}

if [ -e "$out" ]; then
    echo "error: $out exists; name another folder, or remove it" >&2
    exit 78
fi
if [ -z "${RONDO:-}" ]; then
    cargo build --release --manifest-path "$root/Cargo.toml"
    RONDO=${CARGO_TARGET_DIR:-$root/target}/release/rondo
fi

# The independent learner, then the multi-timescale one, a step of the paper's grid to each side of its rate.
curves() { # TASK INDEPENDENT RATE MULTI FAST SLOW REFERENCE OPTION...
    local task=$1 independent=$2 rate=$3 multi=$4 fast=$5 slow=$6 reference=$7
    shift 7
    "$RONDO" train "$task" --algo "$independent" --lr-fast "$rate" --seeds 5 --jobs "${JOBS:-1}" --quiet \
        --out "$out/$independent" "$@"
    "$RONDO" train "$task" --algo "$multi" --lr-fast "$fast" --lr-slow "$slow" --seeds 5 --jobs "${JOBS:-1}" --quiet \
        --out "$out/$multi" "$@"
    local files=()
    if [ -n "$reference" ]; then
        files=("$root/docs/reference-curves/$reference"-s*.json)
    fi
    "$RONDO" plot "$out/$independent" "$out/$multi" "${files[@]}" --out "$out/learning-curves.png" \
        --title "$task, five seeds"
    if [ -n "$reference" ]; then
        "$RONDO" compare "$out/$independent" --reference "${files[@]}"
    fi
}

speaker=mpe-simple-speaker-listener
case $section in
lbf-5x5)
    curves lbf-5x5-2p-1f ippo 3e-4 mtppo 4e-4 1e-4 ippo-lbf-5x5-2p-1f \
        --profile epymarl --t-max 100000 --test-interval 20000
    ;;
lbf-5x5-q)
    curves lbf-5x5-2p-1f iql 3e-4 mtql 6e-4 1.5e-4 iql-lbf-5x5-2p-1f \
        --t-max 60000 --test-interval 10000
    ;;
speaker-listener)
    curves $speaker ippo 3e-4 mtppo 6e-4 1.5e-4 ippo-mpe-speaker-listener \
        --rules epymarl --pad --t-max 80000 --test-interval 20000
    ;;
speaker-listener-q)
    curves $speaker iql 5e-4 mtql 1e-3 2.5e-4 iql-mpe-speaker-listener \
        --rules epymarl --pad --t-max 85000 --test-interval 5000
    ;;
speaker-listener-current)
    curves $speaker iql 5e-4 mtql 1e-3 2.5e-4 "" \
        --t-max 85000 --test-interval 5000
    ;;
tag | adversary)
    curves mpe-simple-"$section" ippo 4e-4 mtppo 8e-4 2e-4 "" \
        --t-max 1000000 --test-interval 100000
    ;;
rware)
    curves rware-tiny-4ag ippo 5e-4 mtppo 1e-3 2.5e-4 "" \
        --t-max 4000000 --test-interval 500000 --test-episodes 20
    ;;
*)
    echo "error: there is no section \`$section\`; see the first lines of $0" >&2
    exit 64
    ;;
esac
