#!/usr/bin/env python3
"""service.py BIN_DIR SECONDS [load [thorough]|streams]: the service's figures beside those of bare gRPC, as a Markdown
table, of which import_results.py makes JSON; with "load" or "streams" only the rows of service_load.py or
service_streams.py; "load thorough": and a minute at ten times the load."""
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
import glb  # noqa: E402
import service_load  # noqa: E402
import service_streams  # noqa: E402

BIN, SECONDS = sys.argv[1], float(sys.argv[2])


def sphere(path, rings, segments):
    """Writes a sphere of 2 * segments * (rings - 1) triangles."""
    points = [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
    for i in range(1, rings):
        a = math.pi * i / rings
        for j in range(segments):
            b = 2 * math.pi * j / segments
            points.append((math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), math.cos(a)))
    at = lambda i, j: 2 + (i - 1) * segments + j % segments  # noqa: E731
    triangles = []
    for j in range(segments):
        triangles += [(0, at(1, j), at(1, j + 1)), (1, at(rings - 1, j + 1), at(rings - 1, j))]
        for i in range(1, rings - 1):
            triangles += [(at(i, j), at(i + 1, j), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i, j + 1))]
    glb.write_glb(path, points, triangles)
    return len(triangles)


class Server:
    """A voxelpiped of its own."""

    def __init__(self, *arguments):
        command = [f"{BIN}/voxelpiped", "--listen", "127.0.0.1:0", "--log-level", "error", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().split()[-1]
        self.http_address = self.process.stdout.readline().split()[-1] if "--http-listen" in arguments else None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def bench(self, mesh, *arguments, seconds=SECONDS):
        command = [f"{BIN}/voxelpipe", "bench", mesh, "--server", self.address, "--json", "--duration", str(seconds),
                   "--warmup", "0.5", "--server-pid", str(self.process.pid), *arguments]
        done = subprocess.run(command, capture_output=True, text=True)
        if not done.stdout.strip():
            raise SystemExit(f"{' '.join(command)}: {done.stderr}")
        return json.loads(done.stdout.strip().splitlines()[-1])


def yardstick():
    """Bare gRPC: name -> (CPU us a request, GB/s)."""
    text = subprocess.run([f"{BIN}/service_yardstick", "--seconds", str(SECONDS)], capture_output=True, text=True).stdout
    rows = re.findall(r"^(\S.*?)\s+([\d.]+) us\s+([\d.]+) /s\s+([\d.]+) GB/s", text, re.M)
    return {name.strip(): (float(us), float(gigabytes)) for name, us, _, gigabytes in rows}


def core_cpu_us(mesh, *arguments):
    """CPU of the voxelization alone, in process, one thread: the median of many runs."""
    command = [f"{BIN}/voxelpipe", "voxelize", mesh, "--repeat", "500", "--threads", "1", "--json", *arguments]
    out = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return 1000 * find(out, "voxelize_cpu_ms")


def find(tree, key):
    """The first value of this key in nested JSON."""
    if isinstance(tree, dict):
        if key in tree:
            return tree[key]
        tree = list(tree.values())
    for branch in tree if isinstance(tree, list) else []:
        value = find(branch, key)
        if value is not None:
            return value
    return None


def row(what, ours, bare, target):
    print(f"| {what} | {ours} | {bare} | {target} |", flush=True)


def cpu_us(result):
    return result["server"]["cpu_us_per_request"] + result["client"]["cpu_us_per_request"]


def small(mesh, bare):
    request = ["--resolution", "32"]
    core = core_cpu_us(mesh, *request)
    # Messages as large as ours, and a client that polls, as that of the load does.
    unary, message = bare["unary 0.3 -> 4.7 KB, polled"][0], bare["bidi 0.3 -> 4.7 KB, 16 under way"][0]
    overheads = {}
    with Server() as server:
        for label, extra in (("Voxelize", []), ("VoxelizeUpload", ["--stream"]), ("VoxelizeBatch", ["--many"])):
            result = server.bench(mesh, "--concurrency", "16", *request, *extra)
            overheads[label] = cpu_us(result) - core
            target = {"Voxelize": "<= 60 us", "VoxelizeBatch": "<= half of Voxelize"}.get(label, "")
            row(f"500 triangles, 32^3, 16 clients, {label}",
                f"{overheads[label]:.0f} us CPU a request beyond {core:.0f} of compute; {result['per_second']:.0f} /s",
                f"{message if label == 'VoxelizeBatch' else unary:.0f} us", target)
    return overheads


def terminate(mesh):
    with Server("--lame-duck-ms", "1500") as server:
        command = [f"{BIN}/voxelpipe", "bench", mesh, "--server", server.address, "--json", "--duration", "1.5",
                   "--concurrency", "8", "--resolution", "32"]
        load = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        time.sleep(0.8)
        server.process.send_signal(signal.SIGTERM)
        result = json.loads(load.communicate()[0].strip().splitlines()[-1])
        code = server.process.wait()
        row("SIGTERM under load", f"{result['requests'] - result['ok']} of {result['requests']} lost, exit {code}", "",
            "none lost")


def main():
    only = sys.argv[3] if len(sys.argv) > 3 else None
    bare = {} if only else yardstick()
    print("| | ours | bare gRPC, same run | to reach |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        load = service_load.LoadRows(Server, sphere, row, folder, BIN, SECONDS)
        streams = service_streams.StreamRows(Server, sphere, row, folder, BIN, SECONDS)
        if only:
            {"load": load, "streams": streams}[only].all()
            if "thorough" in sys.argv[3:]:
                load.ten_times_the_load()
            return
        mesh = os.path.join(folder, "sphere500.glb")
        assert sphere(mesh, 11, 25) == 500
        streams.all()
        overheads = small(mesh, bare)
        row("VoxelizeBatch against Voxelize",
            f"{overheads['VoxelizeBatch'] / max(1e-9, overheads['Voxelize']):.0%}", "", "<= 50 %")
        load.all()
        terminate(mesh)
    for name, (us, gigabytes) in bare.items():
        row(f"bare gRPC: {name}", "", f"{us:.0f} us, {gigabytes:.2f} GB/s", "")


main()
