"""Pages and charts of soak.py: from soak_report import real_text, virtual_text, memory_svg, latency_svg"""

import math

from page import Axis, Chart

MIB = 2.0**20


def mib(count):
    return f"{count / MIB:.1f} MiB"


def per_hour(memory):
    """A growth with its error, and whether it is flat."""
    return f"{memory['bytes_per_hour']:,.0f} ± {memory['standard_error']:,.0f} bytes per hour"


def nothing_lost(lost):
    return "none" if not lost else "; ".join(f"{what}: {len(which)}" for what, which in lost.items())


def quantile_rows(latency):
    """Rows of quantiles: all frames, and those without a fault that delays them."""
    lines = ["| time, ms | frames | p50 | p99 | p99.9 | largest |", "|---|---|---|---|---|---|"]
    for word, of in (("all", latency["all"]), ("without a commanded delay or pause", latency["undisturbed"])):
        for name in ("release_to_delivered_ms", "mid_exposure_to_delivered_ms", "wake_ms"):
            if name in of:
                cells = " | ".join(f"{of[name][share]:.2f}" for share in ("p50", "p99", "p99.9", "max"))
                lines.append(f"| `{name.removesuffix('_ms')}`, {word} | {of['frames']:,} | {cells} |")
    return lines


def counted(words):
    return ", ".join(f"{word} {count:,}" for word, count in sorted(words.items(), key=lambda one: (-one[1], one[0]))) or "none"


def real_text(real):
    """The hour on the real clock as Markdown."""
    frames, memory, bus, latency = real["frames"], real["memory"], real["bus"], real["latency"]
    camera, recorder, load = frames["camera"], frames["recorder"], real["load_average"]
    lines = [
        f"Flown {real['begun_utc']} for {real['seconds']:g} s, seed {real['seed']}, on {real['machine']}, starloop {real['version']}. "
        f"Load average of the machine {load[0]:.1f} to {load[2]:.1f}, mean {load[1]:.1f}; the program itself took {100.0 * real['cpu_share']:.0f} % of one core.",
        "",
        "| | |",
        "|---|---|",
        f"| **frames neither delivered nor counted** | **{nothing_lost(frames['lost'])}** |",
        f"| **counted, but not named by an event** | **network camera: {len(camera['unnamed'])}** |",
        f"| slots | {frames['slots']:,}: {counted(frames['fates'])} |",
        f"| causes of those not sent | {counted(frames['causes_of_dropped'])} |",
        f"| recorder | {recorder['recorded']:,} of {recorder['sent']:,} frames, {recorder['counted']} counted as lost; {real['recorded_bytes'] / 1e9:.1f} GB, each file read back with the CRC-32 of its row |",
        f"| network camera | {camera['received']:,} frames in {camera['sessions']} sessions of a client, with the recorder's pixels; {camera['missing']} missing within sessions, {camera['in_part']} of them came in part, {camera['counted']} counted by the camera as dropped or cut short, {real['cut']} of them cut short; {real['not_wanted']:,} while no client was there |",
        f"| live view | asked {real['monitor']['asked']:,} times, {real['monitor']['failed']} without an answer, {real['monitor']['pictures']:,} pictures |",
        f"| faults | {real['faults']['planned']} from the file, {real['faults']['injected']} injected; {counted(real['faults']['words'])} |",
        f"| from outside | {counted(real['faults']['outside'])} |",
        f"| bus load | mean {100.0 * bus['mean']:.1f} %, median {100.0 * bus['median']:.1f} %, 5 % to 95 % of the seconds {100.0 * bus['p5']:.1f} to {100.0 * bus['p95']:.1f} %, over {bus['seconds']:,} s ({100.0 * bus['by_starloop']:.1f} % are the run's own messages) |"
        if bus["seconds"]
        else "| bus load | not measured |",
        f"| memory after the warm-up | **{memory['verdict']}**: {per_hour(memory)}, mean {mib(memory['mean_bytes'])}, {memory['samples']} samples; limit {memory['limit_bytes_per_hour']:,.0f} bytes per hour |",
        f"| threads, descriptors | at most {memory['most_threads']} and {memory['most_descriptors']} |",
        f"| exit status | {real['exit_status']}{', ' + '; '.join(real['verdicts']) if real['verdicts'] else ''} |",
        "",
        *quantile_rows(latency),
        "",
        f"Events: {counted(real['events'])}.",
        "",
    ]  # fmt: skip
    return "\n".join(lines)


def virtual_text(day):
    """The simulated hours as Markdown."""
    total, memory = day["total"], day["memory"]
    statuses = sorted({leg["exit_status"] for leg in day["legs"]})
    lines = [
        f"{day['hours']:g} simulated hours at {day['rate_hz']:g} Hz in {len(day['legs'])} legs of {day['leg_s']:g} s, seeds from {day['seed']}, in {total['wall_s'] / 60.0:.0f} minutes.",
        "",
        "| | |",
        "|---|---|",
        f"| **frames neither delivered nor counted** | **{nothing_lost(day['lost'])}** |",
        f"| frames | {total['frames']:,}: {total['recorded']:,} recorded and read back, {total['dropped']} dropped, {total['counted']} counted as dropped |",
        f"| faults | {total['faults']:,} |",
        f"| memory | {per_hour(memory)} of simulated time, the mean of all legs and its error; mean {mib(memory['mean_bytes'])} |" if memory else "| memory | too short to say |",
        f"| exit statuses | {', '.join(map(str, statuses))} |",
        "",
        f"Events: {counted(total['events'])}.",
        "",
    ]  # fmt: skip
    return "\n".join(lines)


def memory_svg(samples, end_s):
    """Memory of the process over the run."""
    points = [(row[0] / 60.0, row[1] / MIB) for row in samples if row[0] <= end_s]
    top = max(y for _, y in points)
    memory = Axis("MiB", 0.0, 100.0 * math.ceil(1.1 * top / 100.0))
    chart = Chart("memory of the process", Axis("minutes", 0.0, end_s / 60.0, 6), memory)
    chart.line(points, "#1f77b4", "resident memory", 0)
    return chart.text()


def latency_svg(by_minute, end_s):
    """Quantiles of each minute, from the release of a frame to its delivery."""
    most = max(row[-1] for row in by_minute)
    delays = Axis("ms", 1.0, 10.0 ** math.ceil(math.log10(most)), is_log=True)
    chart = Chart("release to delivered, of each minute", Axis("minutes", 0.0, max(end_s / 60.0, 1.0), 6), delays)
    for place, (word, colour) in enumerate((("p50", "#2ca02c"), ("p99", "#1f77b4"), ("p99.9", "#ff7f0e"), ("largest", "#d62728"))):
        chart.line([(row[0] + 0.5, row[1 + place]) for row in by_minute], colour, word, place)
    return chart.text()
