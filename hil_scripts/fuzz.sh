#!/usr/bin/env bash
# Fuzzes everything that reads bytes: CAN, serial, slcan, socketcand, capture files, plain messages, a camera's control port,
# the session, star layers, star catalogs, elements of orbits, tables of jitter, files of attitudes and orbits, commands of
# trackers' clients, telemetry of trackers.
#
#   hil_scripts/fuzz.sh [SECONDS]                 each target for so long (5), from the committed corpus
#   hil_scripts/fuzz.sh --runs N                  N inputs for each target: the long run is --runs 2000000 (minutes)
#   hil_scripts/fuzz.sh --control                 each target with a deliberate fault (STARLOOP_FUZZ_BROKEN), which must be found
#   hil_scripts/fuzz.sh --reproduce TARGET FILE   runs one input
#   hil_scripts/fuzz.sh --build                   only builds the targets
#
# Needs stable Rust and a C++ compiler. The flags are those that cargo-fuzz gives the compiler, which is not needed: coverage
# counters, compared values, no folded branches. No sanitizer: it would watch unsafe code, and the readers have none. Nothing
# is written into the source tree: corpora grow in a temporary folder.
# A target fails on a panic, an input that takes longer than 10 s, more than 512 MB, or memory that grows by more than
# 32 MB between the first tenth of its inputs and the last.
#
#   CARGO_TARGET_DIR   where to build (default target/)
set -euo pipefail
cd "$(dirname "$0")/.."

readonly targets=(can_decode serial_resync slcan socketcand captures plain network_camera session layer star_lines elements
    jitter_table histories spice tracker_commands tracker_telemetry)
readonly memory_mb=512
readonly growth_mb=32
readonly control_seconds=300
readonly max_len=4096
target="$(realpath -m "${CARGO_TARGET_DIR:-target}")"
readonly target
readonly build="$target/fuzz"
host="$(rustc -vV | sed -n 's/^host: //p')"
readonly host
readonly programs="$build/$host/release"
readonly crashes="$build/crashes"
# In memory where there is such a folder: some readers open files.
folder="${TMPDIR:-/tmp}"
[[ -w /dev/shm ]] && folder=/dev/shm
work="$(mktemp -d -p "$folder")"
readonly work
export TMPDIR="$work"
trap 'rm -rf "$work"' EXIT

build() {
    command -v c++ >/dev/null || { echo "fuzz: no C++ compiler for libFuzzer: apt-get install g++" >&2; exit 1; }
    local coverage=sanitizer-coverage flags="-Cpasses=sancov-module --cfg fuzzing -Ccodegen-units=1" flag
    for flag in $coverage-level=4 $coverage-inline-8bit-counters $coverage-pc-table $coverage-trace-compares \
        $coverage-stack-depth simplifycfg-branch-fold-threshold=0; do
        flags+=" -Cllvm-args=-$flag"
    done
    # With a target, the flags are not for build scripts.
    CARGO_TARGET_DIR="$build" RUSTFLAGS="$flags" \
        cargo build --locked --release --manifest-path tests/fuzz/Cargo.toml --target "$host"
    mkdir -p "$crashes"
}

# fuzz TARGET CORPUS LIMIT: runs one target into $work/TARGET.log.
fuzz() {
    local dictionary="tests/fuzz/dictionaries/$1.dict" options=()
    if [[ -f "$dictionary" ]]; then options+=("-dict=$dictionary"); fi
    "$programs/$1" "-artifact_prefix=$crashes/$1-" "-rss_limit_mb=$memory_mb" "-max_len=$max_len" -timeout=10 \
        -print_final_stats=1 "${options[@]}" "$3" "$2" >"$work/$1.log" 2>&1
}

# Figures from the log of libFuzzer: inputs, inputs per second, peak memory, memory at a tenth and at the end, coverage
# before and after.
figures() {
    awk '
        /^#[0-9]+/ {
            count = substr($1, 2) + 0
            for (i = 2; i < NF; i++) {
                if ($i == "cov:") cov = $(i + 1) + 0
                if ($i == "rss:") rss = $(i + 1) + 0
            }
            if ($2 == "INITED") first_cov = cov
            counts[++lines] = count; memory[lines] = rss
        }
        /^stat::number_of_executed_units/ { runs = $2 }
        /^stat::average_exec_per_sec/ { speed = $2 }
        /^stat::peak_rss_mb/ { peak = $2 }
        END {
            early = memory[lines]
            for (i = lines; i > 0 && counts[i] >= runs / 10; i--) early = memory[i]
            print runs + 0, speed + 0, peak + 0, early + 0, memory[lines] + 0, first_cov + 0, cov + 0
        }' "$1"
}

say_crash() {
    local file
    file="$(sed -n 's/.*Test unit written to //p' "$work/$1.log" | tail -1)"
    grep -E 'panicked at|^(assertion|  left|  right| left|right)|ERROR: libFuzzer' -A 1 "$work/$1.log" | cut -c 1-300 | head -12 >&2
    echo "fuzz: $1 failed; to reproduce: hil_scripts/fuzz.sh --reproduce $1 $file" >&2
}

run_all() {
    local limit="$1" name failed=0 table="$work/table" runs speed peak early late before after
    printf '%-14s %10s %8s %8s %12s %10s  %s\n' target inputs per_s peak_MB 'MB_10%..end' coverage outcome >"$table"
    for name in "${targets[@]}"; do
        local outcome=ok
        mkdir "$work/$name"
        cp "tests/fuzz/corpus/$name/"* "$work/$name/"
        if ! fuzz "$name" "$work/$name" "$limit"; then
            outcome=FAILED
            say_crash "$name"
        fi
        read -r runs speed peak early late before after < <(figures "$work/$name.log")
        if [[ $outcome == ok && $((late - early)) -gt $growth_mb ]]; then
            outcome="FAILED: memory grows by $((late - early)) MB, allowed are $growth_mb"
        fi
        [[ $outcome == ok ]] || failed=1
        printf '%-14s %10s %8s %8s %12s %10s  %s\n' \
            "$name" "$runs" "$speed" "$peak" "$early..$late" "$before..$after" "$outcome" | tee -a "$table.lines"
    done
    printf '\n'
    cat "$table" "$table.lines"
    awk '{ inputs += $2 } END { printf "%-14s %10d\n", "all", inputs }' "$table.lines"
    return "$failed"
}

# From nothing, and from what each target finds itself: the fault must be met, not lie in the corpus.
run_control() {
    local name failed=0
    export STARLOOP_FUZZ_BROKEN=1
    for name in "${targets[@]}"; do
        mkdir "$work/$name"
        local begin=$SECONDS
        if fuzz "$name" "$work/$name" "-max_total_time=$control_seconds"; then
            echo "$name: the deliberate fault was NOT found in $control_seconds s" >&2
            failed=1
        elif grep -q 'panicked at' "$work/$name.log"; then
            echo "$name: the deliberate fault was found in $((SECONDS - begin)) s: $(grep -m1 -A1 'panicked at' "$work/$name.log" | tail -1)"
        else
            echo "$name: ended without finding anything: $(tail -1 "$work/$name.log")" >&2
            failed=1
        fi
        rm -f "$crashes/$name-"*
    done
    return "$failed"
}

case "${1:-5}" in
    --build) build ;;
    --runs) build && run_all "-runs=${2:?how many inputs for each target}" ;;
    --control) build && run_control ;;
    --reproduce) build && "$programs/${2:?a target: ${targets[*]}}" "${3:?a file}" ;;
    *[!0-9]*) sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0"; exit 2 ;;
    *) build && run_all "-max_total_time=${1:-5}" ;;
esac
