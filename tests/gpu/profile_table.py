#!/usr/bin/env python3
"""usage: profile_table.py PROFILE.csv    (ncu --csv --page raw)

Prints the kernels by their share of the time: launches, mean duration, how busy the multiprocessors, the memory, L2 and
L1 were, occupancy, registers, and the two stalls that cost most.
"""
import collections
import csv
import sys

COLUMNS = {
    "duration": "gpu__time_duration.sum",
    "sm": "sm__throughput.avg.pct_of_peak_sustained_elapsed",
    "memory": "gpu__compute_memory_throughput.avg.pct_of_peak_sustained_elapsed",
    "dram": "gpu__dram_throughput.avg.pct_of_peak_sustained_elapsed",
    "l2": "lts__throughput.avg.pct_of_peak_sustained_elapsed",
    "l1": "l1tex__throughput.avg.pct_of_peak_sustained_active",
    "occupancy": "sm__warps_active.avg.pct_of_peak_sustained_active",
    "registers": "launch__registers_per_thread",
}
STALLS = "smsp__average_warps_issue_stalled_"
TO_US = {"ns": 1e-3, "nsecond": 1e-3, "us": 1.0, "usecond": 1.0, "ms": 1e3, "msecond": 1e3, "s": 1e6, "second": 1e6}


def number(text):
    try:
        return float(text.replace(",", ""))
    except ValueError:
        return 0.0


def read(path):
    """Rows of the table that ncu wrote between its own and the program's lines; the first row holds the units."""
    with open(path, newline="") as file:
        lines = file.read().splitlines()
    begin = next((i for i, line in enumerate(lines) if line.startswith('"ID"')), None)
    if begin is None:
        return [], {}
    rows = list(csv.DictReader(line for line in lines[begin:] if line.startswith('"')))
    return rows[1:], rows[0] if rows else {}


def main():
    rows, units = read(sys.argv[1])
    if not rows:
        print("no kernels were profiled")
        return 1
    kernels = collections.defaultdict(list)
    for row in rows:
        kernels[row["Kernel Name"].split("(")[0][:60]].append(row)
    scale = TO_US.get(units.get(COLUMNS["duration"], "us"), 1.0)

    def total(name):
        return sum(number(row.get(COLUMNS["duration"], "")) for row in kernels[name]) * scale

    everything = sum(total(name) for name in kernels) or 1.0
    print("| kernel | launches | us each | share | SM % | memory % | DRAM % | L2 % | L1 % | warps % | registers "
          "| stalls |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name in sorted(kernels, key=total, reverse=True)[:16]:
        group = kernels[name]
        # The longest launch speaks for the kernel.
        row = max(group, key=lambda r: number(r.get(COLUMNS["duration"], "")))
        cell = {key: number(row.get(column, "")) for key, column in COLUMNS.items()}
        stalls = sorted(
            ((number(value), key[len(STALLS):].split("_per_")[0]) for key, value in row.items()
             if key and key.startswith(STALLS) and not key.endswith("not_issued.ratio")), reverse=True)
        worst = ", ".join(f"{stall} {value:.1f}" for value, stall in stalls[:2])
        print(f"| {name} | {len(group)} | {total(name) / len(group):.1f} | {100 * total(name) / everything:.1f} % "
              f"| {cell['sm']:.0f} | {cell['memory']:.0f} | {cell['dram']:.0f} | {cell['l2']:.0f} | {cell['l1']:.0f} "
              f"| {cell['occupancy']:.0f} | {cell['registers']:.0f} | {worst} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
