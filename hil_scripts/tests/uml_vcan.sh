#!/usr/bin/env bash
# Runs a command on a Linux kernel with CAN, on a machine whose own kernel has none, without rights of any kind.
#
#   hil_scripts/tests/uml_vcan.sh COMMAND [ARGUMENT...]
#
# The kernel is Debian's user-mode Linux: a program that runs a whole kernel as a process. It sees this machine's files
# (read-only; /run and $TMPDIR are its own, in memory) and this shell's exported variables. It has two virtual CAN
# interfaces, vcan0 and vcan1, both up and fit for CAN FD, and a source of pulses, pps0. The command runs there as root.
# What it prints, errors too, comes out here, and its exit status is this script's. Starting takes 2 to 6 s.
#
# Inside there is one CPU, a clock tick of 10 ms and no network. vcan has no bit times, no arbitration and no hardware
# stamps: frames arrive when they are sent.
#
#   apt-get install user-mode-linux iproute2 kmod can-utils gcc libc6-dev
#
#   UML_MEMORY_MB=n    memory of the guest (default 512), taken from a folder that programs can be run from
#   UML_TIMEOUT_S=n    seconds until the guest is ended (default 300)
#
# Exit status 125: the kernel could not be started, or ended without a word; the reason is printed.
set -euo pipefail

readonly memory_mb="${UML_MEMORY_MB:-512}"
readonly timeout_s="${UML_TIMEOUT_S:-300}"
readonly kernel=/usr/bin/linux.uml

cannot() {
    printf 'uml_vcan: cannot start: %s\n' "$*" >&2
    exit 125
}

[[ $# -gt 0 ]] || cannot "no command given: hil_scripts/tests/uml_vcan.sh COMMAND [ARGUMENT...]"
[[ $(uname -m) == x86_64 ]] || cannot "user-mode Linux is packaged for x86_64, and this is $(uname -m)"
[[ -x $kernel ]] || cannot "no $kernel: apt-get install user-mode-linux"
for program in ip:iproute2 insmod:kmod cc:'gcc libc6-dev'; do
    PATH=$PATH:/usr/sbin:/sbin command -v "${program%%:*}" >/dev/null || cannot "no ${program%%:*}: apt-get install ${program#*:}"
done
modules=$(find /usr/lib/uml/modules -maxdepth 1 -mindepth 1 -type d 2>/dev/null | sort -V | tail -1)
[[ -n $modules ]] || cannot "no modules under /usr/lib/uml/modules: apt-get install user-mode-linux"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The guest's memory is a file that it maps executable: prints a folder with enough space, not mounted noexec.
memory_folder() {
    local folder free_mb
    for folder in /dev/shm /tmp "$work"; do
        free_mb=$(df -m --output=avail "$folder" 2>/dev/null | tail -1 | tr -d ' ')
        if [[ -w $folder && ${free_mb:-0} -ge $memory_mb ]] && ! findmnt -no OPTIONS -T "$folder" 2>/dev/null | grep -qw noexec; then
            echo "$folder"
            return
        fi
    done
    return 1
}
memory=$(memory_folder) || cannot "no folder with $memory_mb MB free for its memory among /dev/shm, /tmp and $work"

# Processors with AMX have a longer extended register set than this kernel knows of. It hands the host the part that it
# knows, and the host refuses a partial set; the kernel then panics. This library, loaded into the kernel's process, puts
# the known part over a full set that was read just before.
cat >"$work/whole_registers.c" <<'EOF'
#define _GNU_SOURCE
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { EXTENDED_STATE = 0x202, STATE_MAX = 1 << 16 };

static long set_whole(pid_t process, struct iovec *known) {
    static unsigned char state[STATE_MAX] __attribute__((aligned(64)));
    struct iovec whole = {state, sizeof state};
    if (syscall(SYS_ptrace, PTRACE_GETREGSET, process, EXTENDED_STATE, &whole) != 0 || known->iov_len >= whole.iov_len)
        return syscall(SYS_ptrace, PTRACE_SETREGSET, process, EXTENDED_STATE, known);
    memcpy(state, known->iov_base, known->iov_len);
    return syscall(SYS_ptrace, PTRACE_SETREGSET, process, EXTENDED_STATE, &whole);
}

long ptrace(enum __ptrace_request request, ...) {
    va_list rest;
    va_start(rest, request);
    pid_t process = va_arg(rest, pid_t);
    void *address = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);
    if (request == PTRACE_SETREGSET && (long)address == EXTENDED_STATE)
        return set_whole(process, data);
    if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
        /* The system call stores the word; the library call returns it. */
        long word;
        if (syscall(SYS_ptrace, request, process, address, &word) < 0)
            return -1;
        errno = 0;
        return word;
    }
    return syscall(SYS_ptrace, request, process, address, data);
}
EOF
cc -O2 -shared -fPIC -o "$work/whole_registers.so" "$work/whole_registers.c" || cannot "the C compiler failed"

# --- what the guest does ---------------------------------------------------------------------------------------------

readonly ended="uml-ended-$$-$RANDOM"
export -p >"$work/environment"
printf '%q ' "$@" >"$work/command"
cat >"$work/init" <<EOF
#!/bin/bash
source "$work/environment"
export PATH="\$PATH:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin" TERM=dumb TMPDIR=/run/tmp
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs run /run
mkdir -p /run/tmp /dev/pts /dev/shm
mount -t devpts devpts /dev/pts
mount -t tmpfs shm /dev/shm
for module in net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev drivers/net/can/vcan \
    drivers/pps/pps_core drivers/pps/clients/pps-ktimer; do
    insmod "$modules/kernel/\$module.ko" || echo "uml_vcan: no module \$module"
done
ip link set lo up
for name in vcan0 vcan1; do
    ip link add "\$name" type vcan && ip link set "\$name" mtu 72 && ip link set "\$name" up
done
cd "$PWD" || exit
echo "uml_vcan: Linux \$(uname -r), up after \$(cut -d' ' -f1 /proc/uptime) s"
bash "$work/command" </dev/null 2>&1
echo "$ended \$?"
echo o >/proc/sysrq-trigger
sleep 60
EOF
chmod +x "$work/init"

# --- the guest -------------------------------------------------------------------------------------------------------

arguments=(
    "mem=${memory_mb}M" rootfstype=hostfs rootflags=/ ro "init=$work/init"
    con=null "con0=fd:0,fd:1" ssl=null quiet loglevel=3 "umid=vcan$$"
)
# The kernel keeps a folder of its own under HOME. A terminal makes line ends of two characters; its last words are the
# kernel's.
set +e
HOME=$work TMPDIR=$memory LD_PRELOAD="$work/whole_registers.so" timeout -k 2 "$timeout_s" "$kernel" "${arguments[@]}" \
    </dev/null 2>"$work/errors" | tee "$work/output" |
    sed -u -e 's/\r$//' -e "/^$ended /d" -e '/^sysrq: Power Off$/d' -e '/^reboot: Power down$/d'
kernel_status=${PIPESTATUS[0]}
set -e

status=$(sed -n "s/^$ended \([0-9]*\).*/\1/p" "$work/output" | tail -1)
if [[ -z $status ]]; then
    [[ $kernel_status -ne 124 ]] || cannot "not done after $timeout_s s: UML_TIMEOUT_S=n gives it more"
    grep -hE 'panic|Failed|error' "$work/errors" "$work/output" | head -5 >&2 || true
    tail -5 "$work/errors" >&2
    cannot "it ended with status $kernel_status before the command did; its last words are above"
fi
exit "$status"
