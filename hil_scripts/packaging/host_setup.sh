#!/usr/bin/env bash
# What a machine needs for a bench with real buses: looks, and with --apply sets.
#
#   hil_scripts/packaging/host_setup.sh [--check]              report; changes nothing
#   sudo hil_scripts/packaging/host_setup.sh --apply           set what is not as wanted
#
#   --can NAME        a CAN interface to bring up (may be given again; default: every one there is)
#   --bitrate N       bits per second of classic CAN and of arbitration (default 500000)
#   --dbitrate N      bits per second of CAN FD data; 0 for classic CAN (default 2000000)
#   --restart-ms N    back on the bus this long after bus-off (default 100)
#   --txqueuelen N    frames that wait in an interface's queue (default 1000)
#   --user NAME       who runs starloop: may use real-time priorities and lock memory (default: the caller)
#
# Reported, with the command that would set it: CAN interfaces; the limit of socket receive buffers; real-time priority
# and locked memory of the user; the CPUs' frequency governor; the latency of FTDI serial adapters and of other serial
# ports. Interfaces, governor and latencies last until the next boot or replugging; the rest lasts.
#
# Exit status: 0 all as wanted; 3 something is not (--check), or could not be set (--apply); 2 wrong command line.
# STARLOOP_HOST_ROOT names another root for /sys, /proc and /etc, for tests.
set -euo pipefail

readonly root="${STARLOOP_HOST_ROOT:-}"
readonly receive_buffer_bytes=4194304
readonly rtprio=50

apply=false
interfaces=()
bitrate=500000
dbitrate=2000000
restart_ms=100
txqueuelen=1000
user="${SUDO_USER:-$(id -un)}"
unmet=0

usage() {
    sed -n '2,/^set -euo/{/^set -euo/d;s/^# \{0,1\}//;p}' "$0"
}

number() {
    [[ $2 =~ ^[0-9]+$ ]] || {
        echo "host_setup: $1: wanted a number, got \"$2\"" >&2
        exit 2
    }
    printf '%s' "$2"
}

while [[ $# -gt 0 ]]; do
    case $1 in
        --check) apply=false ;;
        --apply) apply=true ;;
        --help | -h)
            usage
            exit 0
            ;;
        --can | --bitrate | --dbitrate | --restart-ms | --txqueuelen | --user)
            [[ $# -ge 2 ]] || {
                echo "host_setup: $1 wants a value" >&2
                exit 2
            }
            case $1 in
                --can) interfaces+=("$2") ;;
                --bitrate) bitrate=$(number "$1" "$2") ;;
                --dbitrate) dbitrate=$(number "$1" "$2") ;;
                --restart-ms) restart_ms=$(number "$1" "$2") ;;
                --txqueuelen) txqueuelen=$(number "$1" "$2") ;;
                --user) user=$2 ;;
            esac
            shift
            ;;
        *)
            echo "host_setup: unknown argument \"$1\"; see --help" >&2
            exit 2
            ;;
    esac
    shift
done
if $apply && [[ -z $root && $EUID -ne 0 ]]; then
    echo "host_setup: --apply changes the system: run it as root" >&2
    exit 2
fi

# --- reporting and setting -------------------------------------------------------------------------------------------

as_wanted() { printf 'ok      %-34s %s\n' "$1" "$2"; }

absent() { printf 'none    %-34s %s\n' "$1" "$2"; }

# differs WHAT NOW WANTED HOW COMMAND...: prints the difference and how to set it; with --apply runs the command.
differs() {
    local what=$1 now=$2 wanted=$3 how=$4
    shift 4
    if ! $apply; then
        printf 'differs %-34s %s, wanted %s\n        %s\n' "$what" "$now" "$wanted" "$how"
        unmet=$((unmet + 1))
    elif "$@"; then
        printf 'set     %-34s %s, was %s\n' "$what" "$wanted" "$now"
    else
        printf 'FAILED  %-34s %s, wanted %s\n        %s\n' "$what" "$now" "$wanted" "$how"
        unmet=$((unmet + 1))
    fi
}

write() { printf '%s\n' "$2" >"$1"; }

# --- CAN -------------------------------------------------------------------------------------------------------------

# The number after WORD in the interface's details; empty without it.
detail() { sed -n "s/.*\\b$1 \\([0-9]*\\).*/\\1/p" <<<"$2" | head -1; }

can_settings() {
    printf 'bitrate %s restart-ms %s' "$bitrate" "$restart_ms"
    if [[ $dbitrate -ne 0 ]]; then printf ' dbitrate %s fd on' "$dbitrate"; else printf ' fd off'; fi
}

bring_up() {
    local name=$1 settings
    read -ra settings < <(can_settings)
    ip link set "$name" down &&
        ip link set "$name" txqueuelen "$txqueuelen" type can "${settings[@]}" &&
        ip link set "$name" up
}

bring_up_virtual() {
    ip link set "$1" down && ip link set "$1" mtu 72 && ip link set "$1" up
}

check_can() {
    local name=$1 details now wanted how
    details=$(ip -details link show "$name" 2>/dev/null) || {
        differs "CAN interface $name" "absent" "plugged in, its driver loaded" "ip link show type can" false
        return
    }
    if grep -qw vcan <<<"$details"; then
        now="$(grep -q 'UP' <<<"$details" && echo up || echo down) mtu $(detail mtu "$details")"
        wanted="up mtu 72"
        if [[ $now == "$wanted" ]]; then
            as_wanted "CAN interface $name" "$now"
        else
            differs "CAN interface $name" "$now" "$wanted" "ip link set $name mtu 72, while it is down; then up" bring_up_virtual "$name"
        fi
        return
    fi
    now="$(grep -q '[<,]UP[,>]' <<<"$details" && echo up || echo down)"
    now+=" bitrate $(detail bitrate "$details") dbitrate $(detail dbitrate "$details")"
    now+=" restart-ms $(detail restart-ms "$details") txqueuelen $(detail qlen "$details")"
    wanted="up bitrate $bitrate dbitrate $([[ $dbitrate -eq 0 ]] || echo "$dbitrate") restart-ms $restart_ms txqueuelen $txqueuelen"
    how="ip link set $name txqueuelen $txqueuelen type can $(can_settings), while it is down; then up"
    if [[ $now == "$wanted" ]]; then
        as_wanted "CAN interface $name" "$now"
    else
        differs "CAN interface $name" "$now" "$wanted" "$how" bring_up "$name"
    fi
}

check_can_interfaces() {
    local name
    if ! command -v ip >/dev/null; then
        differs "CAN interfaces" "no program ip" "iproute2 installed" "apt-get install iproute2" apt-get install -y iproute2
        return
    fi
    if [[ ${#interfaces[@]} -eq 0 ]]; then
        mapfile -t interfaces < <({ ip -o link show type can && ip -o link show type vcan; } 2>/dev/null |
            sed -n 's/^[0-9]*: \([^:@]*\).*/\1/p')
    fi
    [[ ${#interfaces[@]} -gt 0 ]] || absent "CAN interfaces" "none plugged in"
    for name in "${interfaces[@]}"; do
        check_can "$name"
    done
}

check_receive_buffer() {
    local file=$root/proc/sys/net/core/rmem_max now
    [[ -r $file ]] || return 0
    now=$(<"$file")
    if [[ $now -ge $receive_buffer_bytes ]]; then
        as_wanted "socket receive buffer, at most" "$now bytes"
    else
        differs "socket receive buffer, at most" "$now bytes" "$receive_buffer_bytes" \
            "sysctl net.core.rmem_max=$receive_buffer_bytes, and the same in /etc/sysctl.d/60-starloop.conf" keep_receive_buffer
    fi
}

keep_receive_buffer() {
    mkdir -p "$root/etc/sysctl.d" &&
        write "$root/etc/sysctl.d/60-starloop.conf" "net.core.rmem_max = $receive_buffer_bytes" &&
        write "$root/proc/sys/net/core/rmem_max" "$receive_buffer_bytes"
}

# --- real time -------------------------------------------------------------------------------------------------------

limits() {
    printf '%s - rtprio %s\n%s - memlock unlimited\n' "$user" "$rtprio" "$user"
}

write_limits() { mkdir -p "$root/etc/security/limits.d" && limits >"$root/etc/security/limits.d/60-starloop.conf"; }

check_limits() {
    local what="real-time limits of $user" file=$root/etc/security/limits.d/60-starloop.conf
    if [[ -r $file ]] && diff -q <(limits) "$file" >/dev/null; then
        as_wanted "$what" "rtprio $rtprio, memlock unlimited, from the next login"
    else
        differs "$what" "not set" "rtprio $rtprio, memlock unlimited" "/etc/security/limits.d/60-starloop.conf" write_limits
    fi
}

set_governors() {
    local file
    for file in "$root"/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor; do
        write "$file" performance || return
    done
}

check_governor() {
    local files=("$root"/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor) now
    if [[ ! -e ${files[0]} ]]; then
        absent "CPU frequency governor" "the system sets no frequencies"
        return
    fi
    now=$(sort -u "${files[@]}" | paste -sd' ')
    if [[ $now == performance ]]; then
        as_wanted "CPU frequency governor" "$now"
    else
        differs "CPU frequency governor" "$now" performance "echo performance > .../cpu*/cpufreq/scaling_governor" set_governors
    fi
}

# --- serial ----------------------------------------------------------------------------------------------------------

check_ftdi() {
    local file name now found=false
    for file in "$root"/sys/bus/usb-serial/devices/*/latency_timer; do
        [[ -e $file ]] || continue
        found=true
        name=$(basename "$(dirname "$file")")
        now=$(<"$file")
        if [[ $now -eq 1 ]]; then
            as_wanted "latency timer of $name" "1 ms"
        else
            differs "latency timer of $name" "$now ms" "1 ms" "echo 1 > $file" write "$file" 1
        fi
    done
    $found || absent "FTDI serial adapters" "none plugged in"
}

check_low_latency() {
    local port name now
    for port in "$root"/sys/class/tty/ttyS*/device/driver/module "$root"/sys/bus/usb-serial/devices/ttyUSB*; do
        [[ -e $port ]] || continue
        name=$(grep -o 'tty\(S\|USB\)[0-9]*' <<<"$port" | head -1)
        if ! command -v setserial >/dev/null; then
            absent "low latency of $name" "unknown without setserial: apt-get install setserial"
            continue
        fi
        now=$(setserial -g "/dev/$name" 2>/dev/null) || continue
        # A port of the chipset without a chip.
        grep -q 'UART: unknown' <<<"$now" && continue
        if grep -q low_latency <<<"$now"; then
            as_wanted "low latency of $name" "on"
        else
            differs "low latency of $name" "off" "on" "setserial /dev/$name low_latency" setserial "/dev/$name" low_latency
        fi
    done
}

check_can_interfaces
check_receive_buffer
check_limits
check_governor
check_ftdi
check_low_latency
if [[ $unmet -gt 0 ]]; then
    $apply && echo "$unmet could not be set" || echo "$unmet not as wanted; --apply sets what can be set"
    exit 3
fi
echo "all as wanted"
