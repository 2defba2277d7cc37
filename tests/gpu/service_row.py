"""A row of the service's table of one run of `voxelpipe bench --json`, on stdin. usage: service_row.py LABEL..."""

import json
import sys

if __name__ == "__main__":
    run = json.load(sys.stdin)
    server, latency = run["server"], run["latency_ms"]
    launches = server.get("launches_per_request")
    errors = ", ".join(f"{count} {code}" for code, count in run["errors"].items()) or "0"
    cells = [*sys.argv[1:], f"{run['per_second']:,.0f}", f"{latency['p50']:.2f}", f"{latency['p99']:.2f}",
             f"{server['batch_jobs']['mean']:.1f} / {server['batch_jobs']['max']}",
             "" if launches is None else f"{launches:.2f}", f"{server.get('cpu_us_per_request') or 0:.0f}",
             " ".join(f"{name} {jobs}" for name, jobs in server["workers"].items()), errors, run["hash"][:8]]
    print("| " + " | ".join(cells) + " |")
