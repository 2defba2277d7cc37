#!/usr/bin/env python3
"""How many Draco meshes that are sent each time two servers answer in a second, one after the other, several times.

usage: draco_rate.py OLD_VOXELPIPED NEW_VOXELPIPED --mesh FILE.drc [--cli VOXELPIPE] [--rounds N] [--seconds S]
                     [--concurrency C] [--old-options "..."] [--new-options "..."]

--mesh: the output of `draco_mesh FILE.drc` (a target of the tests). --cli: the load generator for both, by default
`voxelpipe` beside the new server. The order changes from round to round, so that a machine that slows down affects both
alike. Prints a JSON line for each run, and one with the ratio of the medians. Needs only Python and the programs.
"""

import argparse
import json
import os
import shlex
import statistics
import subprocess
import sys


def free_port_server(program, options):
    """Starts a server on a port of its choice: the process and its address."""
    server = subprocess.Popen([program, "--listen", "127.0.0.1:0", "--log-level", "error", *options],
                              stdout=subprocess.PIPE, text=True)
    line = server.stdout.readline()
    if not line.startswith("listening on "):
        server.kill()
        sys.exit(f"{program} does not serve: {line.strip()}")
    return server, line.removeprefix("listening on ").strip()


def cpu_seconds(pid):
    """User and system time of a process so far."""
    with open(f"/proc/{pid}/stat", encoding="ascii") as stat:
        fields = stat.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(name, program, options, args):
    """One run of a fresh server."""
    server, address = free_port_server(program, options)
    try:
        command = [args.cli, "bench", args.mesh, "--server", address, "--send-mesh", "--concurrency",
                   str(args.concurrency), "--resolution", str(args.resolution), "--json", "--duration"]
        subprocess.run([*command, str(min(2.0, args.seconds))], stdout=subprocess.DEVNULL, check=False)  # warms it up
        before = cpu_seconds(server.pid)
        out = subprocess.run([*command, str(args.seconds)], stdout=subprocess.PIPE, text=True, check=False).stdout
        used = cpu_seconds(server.pid) - before
        result = json.loads(out)
        row = {"server": name, "per_second": round(result["per_second"], 2), "ok": result["ok"],
               "requests": result["requests"], "errors": result["errors"],
               "p50_ms": round(result["latency_ms"]["p50"], 2), "p99_ms": round(result["latency_ms"]["p99"], 2),
               "server_cpu_ms_per_request": round(used * 1e3 / max(1, result["ok"]), 2),
               "cpus": len(os.sched_getaffinity(0))}
        print(json.dumps(row), flush=True)
        return row
    finally:
        server.terminate()
        server.wait(timeout=60)


def main():
    """Parses the command line and runs."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("--mesh", required=True)
    parser.add_argument("--cli")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--concurrency", type=int, default=4 * len(os.sched_getaffinity(0)))
    parser.add_argument("--resolution", type=int, default=128)
    parser.add_argument("--old-options", default="")
    parser.add_argument("--new-options", default="")
    args = parser.parse_args()
    args.cli = args.cli or os.path.join(os.path.dirname(os.path.abspath(args.new)), "voxelpipe")
    servers = {"old": (args.old, shlex.split(args.old_options)), "new": (args.new, shlex.split(args.new_options))}
    rates = {"old": [], "new": []}
    for i in range(args.rounds):
        for name in ("old", "new") if i % 2 == 0 else ("new", "old"):
            row = run(name, *servers[name], args)
            if row["ok"] != row["requests"]:
                print(f"draco_rate: {name}: requests failed: {row['errors']}", file=sys.stderr)
            rates[name].append(row["per_second"])
    old, new = statistics.median(rates["old"]), statistics.median(rates["new"])
    pairs = [n / o for o, n in zip(rates["old"], rates["new"]) if o > 0]
    print(json.dumps({"old_median": old, "new_median": new, "ratio": round(new / old, 3) if old else None,
                      "ratios": [round(p, 3) for p in pairs], "concurrency": args.concurrency}))


if __name__ == "__main__":
    main()
