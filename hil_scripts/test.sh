#!/usr/bin/env bash
# The checks of the project, in order, timed; works from a clean clone on a Debian machine with Rust installed.
#
#   hil_scripts/test.sh                   the quick form: what continuous integration runs for each change
#   hil_scripts/test.sh --full            everything: every night, and before a release
#   hil_scripts/test.sh --full --no-vcan  without what needs a kernel with CAN, where user-mode Linux cannot be started
#
# hil_scripts/tests.txt says which test is in which form, and why. The full form adds to the quick one: all features, all
# lints, the documentation, fuzzing, the rules for dependencies, GPU tests on a software Vulkan driver, other compilers for
# the C kit, and other people's programs and clients.
#
# Installs what is missing of Debian packages (apt, as root or through sudo), and says so; with these present it needs neither
# apt nor root. The Python scripts' packages come from PyPI into target/pythons and are kept there. All steps run, also after
# one has failed; at the end comes where the time went, and a count of the tests.
#
#   STARLOOP_ALLOW_SKIPS=n   accept n skipped tests (default 0), for a machine without Vulkan
#   CARGO_TARGET_DIR         where to build (default target/)
set -euo pipefail
cd "$(dirname "$0")/.."

form=quick
no_vcan=
for argument in "$@"; do
    case $argument in
    --full) form=full ;;
    --no-vcan) no_vcan=1 ;;
    *)
        echo "test.sh: got \"$argument\", wanted --full, --no-vcan or nothing" >&2
        exit 2
        ;;
    esac
done
readonly form no_vcan
# Tests that take a number of random cases take fewer in the quick form.
export STARLOOP_TESTS=$form

is_full() { [[ $form == full ]]; }

# The names of one kind of tests that this form runs, from hil_scripts/tests.txt.
listed() { awk -v kind="$1" -v form="$form" '$1 == kind && (form == "full" || $3 ~ /^quick/) { print $2 }' hil_scripts/tests.txt; }

packages=(tshark can-utils curl)                      # other people's readers of captures; a client of the live view
packages+=(aravis-tools-cli gir1.2-aravis-0.8 python3-gi python3-numpy) # clients of network cameras
python3 -c 'import ensurepip, venv' 2>/dev/null || packages+=(python3-venv) # for the scripts' packages
command -v cc >/dev/null || packages+=(gcc libc6-dev) # the linker that Rust calls, and the C kit's compiler
if is_full; then
    packages+=(mesa-vulkan-drivers libvulkan1)        # software Vulkan, for the GPU tests
    command -v c++ >/dev/null || packages+=(g++)      # the fuzzer's runtime
    packages+=(clang gcc-arm-none-eabi libnewlib-arm-none-eabi) # the C kit under other compilers
    packages+=(gstreamer1.0-tools)                    # a client of network cameras
    packages+=(netcat-openbsd)                        # a client of star trackers
    packages+=(linuxptp)                              # the PTP clock whose state the network camera reports
    packages+=(debootstrap systemd zsh fish)          # a bare Debian for the packages; what checks their unit and completions
    packages+=(openjdk-17-jre-headless)               # Orekit, another reader of attitudes and orbits
    packages+=(xvfb xdotool evilwm twm x11-xserver-utils libxkbcommon-x11-0 chromium siril) # screens without a monitor, a browser, a reader of SER files
    [[ -n $no_vcan ]] || packages+=(user-mode-linux iproute2 kmod) # SocketCAN without CAN in this kernel
fi
readonly allowed_skips="${STARLOOP_ALLOW_SKIPS:-0}"
readonly target="${CARGO_TARGET_DIR:-target}"
readonly log="$target/test.log"
readonly python="$target/python"
readonly tools="$target/tools"
readonly deny="$tools/bin/cargo-deny"
readonly checks="$target/checks" # of its own: cargo locks a target folder while it compiles
readonly cargo_deny_version=0.20.2

# The selection and the profile for cargo: the whole as a release; the quick form in less time, with the same bits, and without
# the features that take long to build.
selection=(--workspace --all-features)
profile=release
tests=(--lib --bins --tests)
if ! is_full; then
    profile=quick
    selection=(--workspace --features starloop/data_sets,starloop/hats,starloop/parquet,starloop/spice --exclude starloop_python)
    while read -r name; do selection+=(--exclude "$name"); done < <(awk '$1 == "crate" && $3 == "full" { print $2 }' hil_scripts/tests.txt)
    tests=(--lib --bins)
    while read -r name; do tests+=(--test "$name"); done < <(listed binary)
fi
readonly selection profile tests
readonly program="$target/$profile/starloop"

step_names=()
step_seconds=()
step_results=()
failed_steps=0

say() { printf '\n== %s\n' "$*"; }

# --- the machine -----------------------------------------------------------------------------------------------------

is_installed() { dpkg -s "$1" 2>/dev/null | grep -q '^Status: install ok installed'; }

as_root() { if [[ $EUID -eq 0 ]]; then "$@"; else sudo "$@"; fi; }

install_missing() {
    local missing=() package
    for package in "${packages[@]}"; do
        is_installed "$package" || missing+=("$package")
    done
    if [[ ${#missing[@]} -eq 0 ]]; then
        echo "nothing to install: ${packages[*]} are present"
        return
    fi
    echo "installing with apt: ${missing[*]}"
    as_root apt-get update -q &&
        as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}" ||
        echo "could not install ${missing[*]}; going on with what the machine has"
}

# True when the Vulkan loader has a driver to load.
has_vulkan() {
    [[ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ]] && return
    compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null ||
        compgen -G '/usr/local/share/vulkan/icd.d/*.json' >/dev/null ||
        compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null
}

# --- the steps -------------------------------------------------------------------------------------------------------

# Packages outside the workspace.
readonly outside=(tests/fuzz/Cargo.toml)

format() {
    local manifest
    cargo fmt --all --check
    for manifest in "${outside[@]}"; do
        cargo fmt --check --manifest-path "$manifest"
    done
}

# Reads the lock file of each package: one that is behind its manifest fails here, not after an hour.
read_locks() {
    local manifest
    for manifest in Cargo.toml "${outside[@]}"; do
        cargo metadata --quiet --locked --format-version 1 --manifest-path "$manifest" >/dev/null
    done
}

# As most people build it: without what is off by default. In the full form with everything there is and all tests, and the
# smaller build only compiles.
lint() {
    if is_full; then
        CARGO_TARGET_DIR="$checks" cargo clippy --locked --workspace --all-features --all-targets --release -- -D warnings
        CARGO_TARGET_DIR="$checks" cargo check --locked --workspace --release --lib --bins
    else
        # The same folder as the tests, for the macros and build scripts that they share: it is locked until the tests run.
        until grep -q '^ *Running' "$log" 2>/dev/null || [[ -e $log.ended ]]; do sleep 1; done
        cargo clippy --locked --workspace --profile "$profile" --lib --bins -- -D warnings
    fi
}

# The tests, and then what no test is linked with: the module of the Python package, the camera that clients read. With the
# tests named again, the features of dependencies stay the same, and nothing is built twice.
build() {
    cargo test --locked "${selection[@]}" "${tests[@]}" --profile "$profile" --no-run
    cargo build --locked "${selection[@]}" "${tests[@]}" --profile "$profile" --example camera_feed
}

# The whole output goes to the log; the terminal gets its course and what went wrong.
run_tests() {
    local status=0 times='target."cfg(unix)".runner=["env","RUSTC_BOOTSTRAP=1"]'
    if is_full; then
        if has_vulkan; then
            export STARLOOP_REQUIRE_GPU=1
        else
            echo "no Vulkan driver: GPU tests will be skipped"
        fi
    fi
    # libtest prints the seconds of each test to those who ask as a nightly compiler would.
    cargo test --locked "${selection[@]}" "${tests[@]}" --profile "$profile" --no-fail-fast --config "$times" -- \
        --show-output -Z unstable-options --report-time 2>&1 | tee "$log" | course || status=1
    touch "$log.ended"
    is_full || return $status
    cargo test --locked "${selection[@]}" --doc --profile "$profile" --no-fail-fast 2>&1 | tee -a "$log" | course || status=1
    return $status
}

# The lines of cargo's tests that a terminal needs.
course() { grep -E '^ +(Running|Doc-tests)|^test result|^SKIPPED:|FAILED' || true; }

# The lists of Python packages that this form needs, from PyPI.
requirements() {
    local list
    for list in hil_scripts/requirements*.txt; do
        case $list in
        # The other programs of the benchmark have an environment of their own: hundreds of megabytes.
        *_peers.txt) ;;
        # Other people's readers and simulators: for scripts of the full form.
        *_data_sets.txt | *_interop.txt) is_full && echo "$list" ;;
        *) echo "$list" ;;
        esac
    done
}

# An environment for each content of the lists, so that two forms or two branches do not build it in turn; `$python` is a
# link to this form's.
python_environment() {
    local lists hash folder
    mapfile -t lists < <(requirements)
    hash=$(cat "${lists[@]}" <(python3 --version) | sha256sum | cut -c 1-12)
    folder="$(realpath -m "$target")/pythons/$hash"
    # It is whole when its mark is there, which comes last.
    if [[ -e $folder/whole ]] && "$folder/bin/python" -c ''; then
        echo "$folder has it all"
    else
        rm -rf "$folder"
        python3 -m venv "$folder"
        "$folder/bin/python" -m pip install -q --disable-pip-version-check "${lists[@]/#/--requirement=}"
        touch "$folder/whole"
    fi
    [[ -L $python ]] || rm -rf "$python"
    ln -sfn "$folder" "$python"
}

# It is fetched while others compile: `$python.log` has what it says, `$python.status` how it ended.
begin_python_environment() {
    rm -f "$python.status"
    {
        set +e
        (
            set -e
            python_environment
        ) >"$python.log" 2>&1
        echo $? >"$python.status"
    } &
}

await_python_environment() {
    until [[ -s $python.status ]]; do sleep 0.2; done
    cat "$python.log"
    [[ $(<"$python.status") -eq 0 ]]
}

# unittest's last lines as libtest's `test result:`, so that one count has them all.
as_libtest() {
    awk '
        /^Ran [0-9]+ test/ { ran = $2 }
        /^(OK|FAILED)/ {
            gsub(/[(),]/, " ")
            for (i = 1; i <= NF; i++) if (split($i, part, "=") == 2) count[part[1]] = part[2]
        }
        END {
            failed = count["failures"] + count["errors"]
            if (!ran) failed = 1
            passed = ran - failed - count["skipped"]
            if (passed < 0) passed = 0
            word = failed ? "FAILED" : "ok"
            printf "test result: %s. %d passed; %d failed; %d ignored;\n", word, passed, failed, count["skipped"]
        }'
}

# The seconds that one script may take. What takes longer is stuck: it is ended with its processes, and Python says where it was.
readonly script_limit_s=600

# One script against the program: its output and exit status into files, its seconds behind them.
run_python_script() {
    local script=$1 folder=$2 name begin=$SECONDS status=0 parts=()
    name=$(basename "$script")
    # In the quick form some scripts run in part.
    is_full || mapfile -t parts < <(awk -v name="$name" '$2 == name && sub(/^quick:/, "", $3) { gsub(",", "\n", $3); print $3 }' hil_scripts/tests.txt)
    STARLOOP_NO_VCAN="$no_vcan" STARLOOP_BINARY="$(realpath "$program")" \
        timeout --signal=ABRT --kill-after=30 "$script_limit_s" \
        "$python/bin/python" -X faulthandler "$script" "${parts[@]}" >"$folder/$name.output" 2>&1 </dev/null || status=$?
    [[ $((SECONDS - begin)) -lt $script_limit_s ]] || echo "$name took more than $script_limit_s s and was ended" >>"$folder/$name.output"
    echo "$status $((SECONDS - begin))" >"$folder/$name.status"
    echo "     Running $script ($((SECONDS - begin)) s, exit status $status)"
}

# The scripts of this form against the program. Two at a time: most of them wait for a real
# clock. A script that fails beside another one is run again alone, and that run counts.
run_python_tests() {
    local folder scripts script name result seconds status=0
    folder=$(mktemp -d)
    mapfile -t scripts < <(listed script)
    scripts=("${scripts[@]/#/hil_scripts/tests/}")
    : >"$log.scripts"
    # shellcheck disable=SC2064  # expanded now: the variable is gone when the subshell exits
    trap "rm -rf '$folder'" EXIT
    for script in "${scripts[@]}"; do
        while [[ $(jobs -rp | wc -l) -ge 2 ]]; do wait -n; done
        run_python_script "$script" "$folder" &
    done
    wait
    for script in "${scripts[@]}"; do
        name=$(basename "$script")
        read -r result seconds <"$folder/$name.status"
        if [[ $result -ne 0 ]]; then
            echo "     $script failed beside another script; again, alone"
            cat "$folder/$name.output"
            run_python_script "$script" "$folder"
            read -r result seconds <"$folder/$name.status"
            [[ $result -eq 0 ]] || { status=1 && cat "$folder/$name.output"; }
        fi
        echo "     Result of $script ($seconds s)"
        echo "$seconds $script" >>"$log.scripts"
        cat "$folder/$name.output" >>"$log"
        as_libtest <"$folder/$name.output" | tee -a "$log"
    done
    return $status
}

build_fuzz_targets() { CARGO_TARGET_DIR="$target" hil_scripts/fuzz.sh --build; }

# Each for a few seconds from the committed corpus; hil_scripts/fuzz.sh says how to fuzz for longer.
fuzz() { CARGO_TARGET_DIR="$target" hil_scripts/fuzz.sh 3; }

skips_are_expected() {
    local skipped
    skipped=$(count_skipped)
    grep '^SKIPPED:' "$log" || true
    local allowed=$allowed_skips
    # Asked for: what needs a kernel with CAN is left out, and counted.
    [[ -z $no_vcan ]] || allowed=$((allowed + $(count_no_vcan)))
    # Assertions about the real clock that a busy machine left without a case; each says why.
    grep '^UNJUDGED:' "$log" || true
    echo "$skipped skipped, $allowed allowed; $(grep -c '^UNJUDGED:' "$log" || true) left unjudged by a busy machine"
    [[ $(count_results passed) -gt 0 && $skipped -le $allowed ]]
}

# The program on a machine without a GPU: every driver hidden, it says that it renders on the CPU and makes frames.
run_without_gpu() {
    local folder
    folder=$(mktemp -d)
    # shellcheck disable=SC2064  # expanded now: the variable is gone when the subshell exits
    trap "rm -rf '$folder'" EXIT
    VK_DRIVER_FILES=/nonexistent VK_ICD_FILENAMES=/nonexistent VK_LOADER_DRIVERS_DISABLE='*' \
        "$program" run --clock virtual --duration 1 --out "$folder/run" 2>&1 | tee "$folder/output"
    grep -qi 'cpu' "$folder/output" || {
        echo "no line says that the CPU renders"
        return 1
    }
    [[ -n $(ls -A "$folder/run") ]]
}

install_cargo_deny() {
    [[ "$("$deny" --version 2>/dev/null)" != "cargo-deny $cargo_deny_version" ]] || return 0
    cargo install --quiet --debug --locked --root "$tools" --target-dir "$tools/build" "cargo-deny@$cargo_deny_version"
    rm -rf "$tools/build"
}

# Licences, sources and duplicate versions of dependencies, by the rules of .deny.toml; known vulnerabilities where their
# database can be reached.
check_dependencies() {
    install_cargo_deny
    "$deny" check licenses bans sources
    # A rule that is broken must be seen: without MIT most dependencies have no allowed licence.
    sed 's/"MIT", //' .deny.toml >"$tools/without_mit.toml"
    "$deny" --config "$tools/without_mit.toml" check licenses >"$tools/without_mit.txt" 2>&1 || true
    if ! grep -q '^error\[rejected\]' "$tools/without_mit.txt"; then
        cat "$tools/without_mit.txt"
        echo "cargo-deny passes a licence that is not allowed"
        return 1
    fi
    if "$deny" fetch db >/dev/null 2>&1; then
        "$deny" check --disable-fetch advisories
    else
        echo "the advisory database cannot be reached: known vulnerabilities are not checked"
    fi
}

document() { CARGO_TARGET_DIR="$checks" RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --all-features --no-deps --release; }

# --- counting --------------------------------------------------------------------------------------------------------

# Sum over all test programs of one word of libtest's `test result:` lines.
count_results() {
    [[ -f $log ]] || { echo 0 && return; }
    awk -v word="$1;" '/^test result:/ { for (i = 2; i <= NF; i++) if ($i == word) sum += $(i - 1) } END { print sum + 0 }' "$log"
}

# Tests left out because of --no-vcan.
count_no_vcan() {
    grep -c "skipped 'STARLOOP_NO_VCAN=1'" "$log" || true
}

# Tests that said so themselves, and tests that libtest ignored.
count_skipped() {
    local said=0
    [[ -f $log ]] && said=$(grep -c '^SKIPPED:' "$log" || true)
    echo $((said + $(count_results ignored)))
}

# Runs one step in a subshell, where the first failing command ends it, and notes time and result.
step() {
    local name=$1 started=$SECONDS status
    say "$name"
    set +e
    (
        set -e
        "$2"
    )
    status=$?
    set -e
    step_names+=("$name")
    step_seconds+=($((SECONDS - started)))
    if [[ $status -eq 0 ]]; then
        step_results+=(ok)
    else
        step_results+=(FAILED)
        failed_steps=$((failed_steps + 1))
    fi
}

# --- beside the tests ------------------------------------------------------------------------------------------------

# Many tests wait for a clock. Meanwhile compilers run at idle priority, which gives way to any test at once.
beside_functions=(lint)
is_full && beside_functions+=(document build_fuzz_targets install_cargo_deny)
readonly beside_functions

# For each function: `$checks/NAME.log` has its output, `$checks/NAME.status` its exit status.
begin_beside() {
    mkdir -p "$checks"
    rm -f "$checks"/*.status
    set -m # a process group of its own, so that an interrupted script can end it
    {
        trap - EXIT
        chrt --idle --pid 0 "$BASHPID" 2>/dev/null || renice -n 19 -p "$BASHPID" >/dev/null
        set +e
        for name in "${beside_functions[@]}"; do
            (
                set -e
                "$name"
            ) >"$checks/$name.log" 2>&1
            echo $? >"$checks/$name.status"
        done
    } &
    beside_group=$!
    set +m
}

end_beside() { [[ -z ${beside_group:-} ]] || kill -- "-$beside_group" 2>/dev/null || true; }

# Waits for one of the functions, prints what it printed, and has its exit status.
await_beside() {
    until [[ -s "$checks/$1.status" ]]; do
        kill -0 "$beside_group" 2>/dev/null || [[ -s "$checks/$1.status" ]] || { echo "$1 was ended" && return 1; }
        sleep 0.2
    done
    cat "$checks/$1.log"
    [[ $(<"$checks/$1.status") -eq 0 ]]
}

await_lint() { await_beside lint; }
await_document() { await_beside document; }
await_fuzz_targets() { await_beside build_fuzz_targets; }
await_cargo_deny() { await_beside install_cargo_deny; }

print_failures() {
    [[ -f $log && $(count_results failed) -gt 0 ]] || return 0
    say "what the failed tests said (all output: $log)"
    awk '/^failures:$/ { show = 1 } /^test result:/ { show = 0 } show' "$log"
}

print_table() {
    local i
    say "steps"
    for i in "${!step_names[@]}"; do
        printf '%-28s %6d s  %s\n' "${step_names[i]}" "${step_seconds[i]}" "${step_results[i]}"
    done
    printf '%-28s %6d s\n' total "$SECONDS"
}

# Where the time of the tests went: the ten slowest of each kind.
print_slowest() {
    say "slowest tests, s (several run at a time)"
    sed -nE 's/^test (.*) \.\.\. .*<([0-9.]+)s>$/\2 \1/p' "$log" 2>/dev/null | sort -rn | awk 'NR <= 10 { printf "%9.1f  %s\n", $1, $2 }'
    say "slowest scripts, s (two run at a time)"
    sort -rn "$log.scripts" 2>/dev/null | awk 'NR <= 10 { printf "%9d  %s\n", $1, $2 }'
}

main() {
    command -v cargo >/dev/null || {
        echo "cargo is missing: install Rust, https://rustup.rs" >&2
        exit 1
    }
    mkdir -p "$target"
    rm -f "$log" "$log.scripts" "$log.ended"
    trap end_beside EXIT
    step "system packages" install_missing
    begin_python_environment
    step "cargo fmt" format
    step "lock files" read_locks
    step "build" build
    begin_beside
    step "python environment" await_python_environment
    step "tests" run_tests
    step "python tests" run_python_tests
    step "cargo clippy" await_lint
    if is_full; then
        step "cargo doc" await_document
        step "build of fuzz targets" await_fuzz_targets
        step "fuzz targets" fuzz
    fi
    step "no unexpected skip" skips_are_expected
    step "run without a GPU" run_without_gpu
    if is_full; then
        step "build of cargo-deny" await_cargo_deny
        step "dependencies" check_dependencies
    fi
    print_failures
    print_table
    print_slowest
    echo
    echo "$form form: $(count_results passed) passed, $(count_results failed) failed, $(count_skipped) skipped"
    [[ $failed_steps -eq 0 ]]
}

main
