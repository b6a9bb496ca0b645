"""Bench and faults of soak.py: from soak_bench import bench_text, fault_schedule, outside_schedule

The bench flies a small satellite with the 1024 x 1024 tracker at 20 Hz. Its bus is slow, so that its own messages fill half of
it; a node of the soak fills the rest. Faults are drawn by a seed: some are in the bench file, some are injected during the run,
and some happen to the program from outside (a cable, a client, a pause of the whole program).
"""

import math
import random

from page import ROOT

CONFIGS = ROOT / "configs"
#: Bits per second of the bus, arbitration and data.
BIT_RATES = (125_000.0, 500_000.0)
#: Seconds from one fault of the bench to the next.
GAPS_S = (5.0, 25.0)
#: The same in a run of less than two minutes.
SHORT_GAPS_S = (0.5, 2.0)
#: Every so many faults come through the control socket instead of the bench file.
INJECTED_EACH = 4
#: Seconds at the start and at the end without a fault.
QUIET_S = (4.0, 4.0)
#: Seconds from one slew to the next: half a turn at 0.5 deg/s, and settling.
SLEW_GAP_S = 480.0

BENCH = """
name = "soak"
camera = "{camera}"
spacecraft = "{configs}/spacecraft/smallsat.toml"
seed = {seed}

[link]
kind = "simulated"
wire = "can_fd"
bit_rate = {bit_rate}
data_bit_rate = {data_bit_rate}
latency_us = 50.0
queue = 1024
{gateway}
{extra_link}
[timing]
frame_rate_hz = {rate_hz}
duration_s = {seconds}
start_utc = "{start_utc}"

[observer]
kind = "circular_orbit"
altitude_km = 550.0
inclination_deg = 97.6

[plant]
kind = "vehicle"
[plant.initial]
attitude = "given"
ra_deg = 84.05
dec_deg = -1.2
[plant.pointing]
ra_deg = 84.05
dec_deg = -1.2
[plant.telemetry]
every = 10

[flight_computer]
kind = "simulated"
attitude_hz = {attitude_hz}
{jitter}
clock_drift_ppm = 10.0

[attitude]
stale_policy = "blank"

[render]
backend = "cpu"

[budget]
ring_frames = {ring_frames}

[expect]                                   # pointing is not judged: faults come before the loop is on target again
recovery_s = {recovery_s}
{limits}
{sinks}
{events}
"""

REAL_SINKS = """
[sink]
kind = "recorder"
fits = true
png_every = 200
queue = 64

[[extra_sink]]
kind = "network_camera"
address = "{address}"
packet_bytes = 9000
frames_kept = 8
frames_queued = 8
queue = 16
"""


def bench_text(seed, seconds, events=(), *, rate_hz=20.0, camera=None, sinks="", serial_port=None, gateway=True,
               start_utc="2026-03-01T00:00:00Z", attitude_hz=100.0, jitter=True, bit_rates=BIT_RATES, limits=""):
    """Returns the bench as TOML, with its events."""
    return BENCH.format(
        camera=camera or CONFIGS / "cameras/star_tracker_20deg_20hz.toml", configs=CONFIGS, seed=seed,
        bit_rate=bit_rates[0], data_bit_rate=bit_rates[1], gateway="slcan_tcp = 0" if gateway else "",
        extra_link=f'[[extra_link]]\nkind = "serial"\nport = "{serial_port}"\n' if serial_port else "",
        rate_hz=rate_hz, seconds=seconds, start_utc=start_utc, attitude_hz=attitude_hz,
        jitter='jitter_source = "samples"\njitter_sample_hz = 1000.0' if jitter else "",
        ring_frames=min(int(seconds * rate_hz) + 100, 1_000_000), recovery_s=max(2.0 * seconds, 120.0), limits=limits, sinks=sinks or '\n[sink]\nkind = "null"\n',
        events="".join(event_text(event) for event in events),
    )  # fmt: skip


def limits_text(events, rate_hz):
    """Returns limits of `[expect]`: what faults of the bus may cost while they last, and four frames more each."""
    frames = sum(math.ceil(event.get("for_s", 0.0) * rate_hz) + 4 for event in events)
    kinds = ("blank_frames", "held_attitude_frames", "packets_lost")
    return "".join(f"{kind}_at_most = {frames}\n" for kind in kinds)


def event_text(event):
    """Returns an event as a table of TOML."""
    words = {True: "true", False: "false"}
    lines = [f"{key} = {words[value] if isinstance(value, bool) else repr(value).replace(chr(39), chr(34))}" for key, value in event.items()]
    return "\n[[event]]\n" + "\n".join(lines) + "\n"


def drawn_fault(dice):
    """Returns a fault without its time: its keys, and how many seconds it lasts (none for a command)."""
    between, scale = dice.uniform, lambda low, high: low * (high / low) ** dice.random()
    faults = [
        lambda: ({"do": "bus_loss", "share": between(0.1, 0.9)}, 8.0),
        lambda: ({"do": "bus_silence"}, 6.0),
        lambda: ({"do": "bus_delay", "delay_ms": scale(2.0, 150.0), "jitter_ms": scale(1.0, 50.0)}, 8.0),
        lambda: ({"do": "bus_duplicate", "share": between(0.1, 1.0)}, 8.0),
        lambda: ({"do": "bus_wrong_bits", "share": between(0.02, 0.2)}, 8.0),
        lambda: ({"do": "bus_reorder", "share": between(0.05, 0.5), "delay_ms": scale(5.0, 100.0)}, 8.0),
        lambda: ({"do": "bus_truncate", "share": between(0.02, 0.3)}, 8.0),
        lambda: ({"do": "bus_babble", "can_id": dice.choice([0x300, 0x7FF]), "period_ms": scale(2.0, 20.0), "bytes": 48}, 8.0),
        lambda: ({"do": "bus_off"}, 6.0),
        lambda: ({"do": "clock_step", "step_ms": dice.choice([-1, 1]) * scale(1.0, 50.0)}, 8.0),
        lambda: ({"do": "clock_drift", "ppm": dice.choice([-1, 1]) * scale(10.0, 200.0)}, 8.0),
        lambda: ({"do": "bus_back_loss", "share": between(0.2, 1.0)}, 8.0),
        lambda: ({"do": "frame_drop"}, 2.0),
        lambda: ({"do": "frame_duplicate"}, 3.0),
        lambda: ({"do": "frame_late", "late_ms": scale(50.0, 1500.0)}, 5.0),
        lambda: ({"do": "frame_torn"}, 5.0),
        lambda: ({"do": "frame_blank"}, 5.0),
        lambda: ({"do": "frame_bit_flip", "bit": dice.randrange(12), "count": dice.randrange(1, 100)}, 5.0),
        lambda: ({"do": "stray_light", "e_per_s": scale(1e3, 1e6)}, 8.0),
        lambda: ({"do": "stray_light_ramp", "from_e_per_s": 0.0, "to_e_per_s": scale(1e3, 1e6)}, 8.0),
        lambda: ({"do": "defocus_step", "sigma_px": between(1.0, 2.5)}, 5.0),
        lambda: ({"do": "contamination", "throughput": between(0.3, 0.9)}, 8.0),
        lambda: ({"do": "temperature_step", "by_k": between(-20.0, 30.0)}, 8.0),
        lambda: ({"do": "saturation"}, 3.0),
        lambda: ({"do": "false_stars", "mag": between(2.0, 5.0), "count": dice.randrange(1, 40)}, 5.0),
        lambda: ({"do": "missing_stars", "share": between(0.1, 0.9)}, 5.0),
        lambda: ({"do": "hot_pixels", "e_per_s": scale(1e4, 1e6), "count": dice.randrange(1, 100)}, 5.0),
        lambda: ({"do": "dead_pixels", "count": dice.randrange(1, 100)}, 5.0),
        lambda: ({"do": "proton_storm", "per_cm2_s": scale(10.0, 300.0), "energy_mev": 100.0}, 5.0),
        lambda: ({"do": "gyro_dropout"}, 5.0),
        lambda: ({"do": "gyro_spike", "rate_deg_h": [between(-60.0, 60.0) for _ in range(3)]}, 3.0),
        lambda: ({"do": "tracker_off"}, 8.0),
        lambda: ({"do": "slew", "ra_deg": between(0.0, 360.0), "dec_deg": between(-60.0, 60.0), "roll_deg": between(-180.0, 180.0)}, None),
    ]  # fmt: skip
    keys, most_s = dice.choice(faults)()
    keys = {key: round(value, 3) if isinstance(value, float) else value for key, value in keys.items()}
    return keys, None if most_s is None else round(dice.uniform(1.0, most_s), 3)


def fault_schedule(seed, seconds, gaps_s=GAPS_S, without=()):
    """Returns the events of a seed except some words: those of the bench file, and those to inject at their time."""
    gaps_s = gaps_s if seconds >= 120.0 else SHORT_GAPS_S
    dice, events, injected, at_s, number, slewed_s = random.Random(seed), [], [], QUIET_S[0], 0, -SLEW_GAP_S
    while True:
        at_s += dice.uniform(*gaps_s)
        keys, for_s = drawn_fault(dice)
        while keys["do"] in without or keys["do"] == "slew" and at_s - slewed_s < SLEW_GAP_S:
            keys, for_s = drawn_fault(dice)
        for_s = None if for_s is None else round(min(for_s, 0.15 * seconds), 3)
        slewed_s = at_s if keys["do"] == "slew" else slewed_s
        if at_s + (for_s or 0.0) > seconds - QUIET_S[1]:
            return events, injected
        number += 1
        event = {**keys, "at_s": round(at_s, 3)}
        if for_s is not None:
            event["for_s"] = for_s
        (injected if number % INJECTED_EACH == 0 else events).append(event)


def outside_schedule(seed, seconds):
    """Returns what happens to the program from outside: (at_s, word, for_s), in order of time."""
    dice = random.Random(seed + 1)
    # Of each word: gaps between two of them, and how long one lasts.
    words = {
        "serial_unplugged": ((20.0, 120.0), (1.0, 10.0)),
        "bus_node_reconnects": ((60.0, 300.0), (0.5, 5.0)),
        "camera_client_stops": ((60.0, 240.0), (1.0, 5.0)),
        "camera_client_killed": ((120.0, 480.0), (1.0, 5.0)),
        "monitor_pauses": ((60.0, 300.0), (5.0, 20.0)),
        "program_paused": ((120.0, 420.0), (0.05, 0.4)),
    }
    if seconds < 120.0:
        words = {word: ((4.0, 8.0), lasts) for word, (_, lasts) in words.items()}
    found = []
    for word, (gaps, lasts) in words.items():
        at_s = QUIET_S[0]
        while True:
            at_s += dice.uniform(*gaps)
            for_s = min(dice.uniform(*lasts), 0.1 * seconds)
            if at_s + for_s > seconds - QUIET_S[1]:
                break
            found.append((round(at_s, 3), word, round(for_s, 3)))
    return sorted(found)
