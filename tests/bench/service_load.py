"""The rows of service.py about a server that has much to do: half its load, twice its load, time-outs and cancels while workers are busy."""
import http.client
import json
import os
import random
import re
import signal
import subprocess
import time

import numpy

import glb

SPARSE = ["--target", "f32x3:max:shader=normal", "--result", "sparse"]
# What a job takes of one core; rings and segments of the sphere, request. The first is sent with its mesh.
JOBS = (
    ("0.2 ms", 11, 25, ["--resolution", "64", "--send-mesh"]),
    ("1 ms", 11, 25, ["--resolution", "64", *SPARSE]),
    ("5 ms", 100, 100, ["--resolution", "64", *SPARSE]),
    ("21 ms", 188, 188, ["--resolution", "128", *SPARSE]),
)
# Twenty thousand triangles across the whole grid: most of a minute of one core.
SLOW = ["--resolution", "256", "--target", "f32x1:max:shader=barycentric"]


class LoadRows:
    """In: service.py's own parts, and a folder for meshes."""

    def __init__(self, server, sphere, row, folder, binaries, seconds):
        self.server, self.row, self.folder, self.binaries, self.seconds = server, row, folder, binaries, seconds
        self.sphere = sphere

    def all(self):
        self.half_load()
        for job in JOBS:
            self.twice_the_load(*job)
        for timeout_ms in (50, 200):
            self.queue_timeouts(timeout_ms)
        self.cancels()
        self.deadlines()

    def mesh(self, rings, segments):
        path = os.path.join(self.folder, f"sphere{rings}x{segments}.glb")
        if not os.path.exists(path):
            self.sphere(path, rings, segments)
        return path

    def slow_mesh(self):
        path = os.path.join(self.folder, "slow.glb")
        if not os.path.exists(path):
            positions = numpy.random.default_rng(11).random((60000, 3))
            glb.write_glb(path, positions, numpy.arange(60000).reshape(-1, 3))
        return path

    def half_load(self):
        """Latency at half of what the server can do, beside bare gRPC's at the same rate: on two cores that client and server share, the
        kernel adds its part to both."""
        _, rings, segments, request = JOBS[0]
        mesh = self.mesh(rings, segments)
        with self.server("--max-queue", "64") as server:
            alone = server.bench(mesh, "--concurrency", "1", *request)
            peak = server.bench(mesh, "--concurrency", "32", *request)
            rate = peak["per_second"] / 2
            half = server.bench(mesh, "--rate", str(rate), *request)
        bare = bare_at(self.binaries, rate, self.seconds)["p99_ms"]
        core = alone["server"]["voxelize_ms"]["p99"] + alone["server"]["mesh_ms"]["p99"]
        added = half["latency_ms"]["p99"] - core
        self.row("half load, p99 beyond the core's own",
                 f"{added:.2f} ms at {half['per_second']:.0f} /s (p50 {half['latency_ms']['p50'] - core:.2f}; of p99, "
                 f"{half['start_lag_ms']['p99']:.2f} sent late, {half['server']['queue_ms']['p99']:.2f} in the queue)",
                 f"p99 {bare:.2f} ms at the same rate", "<= 2 ms")

    def twice_the_load(self, name, rings, segments, request):
        mesh = self.mesh(rings, segments)
        with self.server("--max-queue", "64") as server:
            def peak_now():
                return server.bench(mesh, "--concurrency", "32", *request, seconds=self.seconds)
            before = peak_now()
            memory = memory_of(server.process.pid)
            double = server.bench(mesh, "--rate", str(before["per_second"] * 2), *request, seconds=2 * self.seconds)
            memory_after = memory_of(server.process.pid)
            peak = max(before, peak_now(), key=lambda result: result["per_second"])
        refused = double["errors"].get("RESOURCE_EXHAUSTED", 0)
        told = double["errors_with_retry_info"].get("RESOURCE_EXHAUSTED", 0)
        other = {code: count for code, count in double["errors"].items() if code != "RESOURCE_EXHAUSTED"}
        # As many bare calls as were refused would leave so much to those that are answered: server and load share these cores.
        refused_rate = max(1.0, refused / (2 * self.seconds))
        taken = bare_at(self.binaries, refused_rate, self.seconds)["cpu_us"] * 1e-6 * refused_rate / os.cpu_count()
        self.row(f"twice the load, jobs of {name}, throughput",
                 f"{double['per_second']:.0f} /s ({double['per_second'] / peak['per_second']:.0%} of "
                 f"{peak['per_second']:.0f})", f"{refused_rate:.0f} calls /s leave {1 - taken:.0%}", ">= 95 %")
        if refused == 0:
            self.row(f"twice the load, jobs of {name}, refused", "none: no overload", "", "")
            return
        latency = double["error_latency_ms"]["RESOURCE_EXHAUSTED"]
        # What is left of the CPU when the answers have got what they take at the peak.
        cpu = {}
        for side in ("server", "client"):
            at_peak = peak[side]["cpu_us_per_request"]
            cpu[side] = max(0.0, double[side]["cpu_seconds"] * 1e6 - double["ok"] * at_peak) / refused
        self.row(f"twice the load, jobs of {name}, refused",
                 f"{refused} of {double['requests']}, {told} with RetryInfo, other errors {other or 'none'}; p50 "
                 f"{latency['p50']:.2f}, p99 {latency['p99']:.2f}, max {latency['max']:.1f} ms (sent late: p99 "
                 f"{double['start_lag_ms']['p99']:.2f}); about {cpu['server']:.0f} us CPU each on the server, "
                 f"{cpu['client']:.0f} on the client", "", "p99 <= 5 ms")
        self.row(f"twice the load, jobs of {name}, memory",
                 f"{memory['VmRSS']:.0f} -> {memory_after['VmRSS']:.0f} MiB, peak {memory_after['VmHWM']:.0f}", "", "bounded")

    def ten_times_the_load(self, seconds=60):
        """Not among all rows: takes more than a minute."""
        name, rings, segments, request = JOBS[2]
        mesh = self.mesh(rings, segments)
        with self.server("--max-queue", "64") as server:
            peak = server.bench(mesh, "--concurrency", "32", *request)
            memory = memory_of(server.process.pid)
            load = server.bench(mesh, "--rate", str(peak["per_second"] * 10), *request, seconds=seconds)
            memory_after = memory_of(server.process.pid)
        refused = load["errors"].get("RESOURCE_EXHAUSTED", 0)
        latency = load["error_latency_ms"].get("RESOURCE_EXHAUSTED", {"p50": 0, "p99": 0, "max": 0})
        self.row(f"ten times the load for {seconds} s, jobs of {name}",
                 f"{load['per_second']:.0f} /s ({load['per_second'] / peak['per_second']:.0%} of {peak['per_second']:.0f}); {refused} of "
                 f"{load['requests']} refused, {load['requests'] - load['ok'] - refused} other errors; p50 {latency['p50']:.2f}, p99 "
                 f"{latency['p99']:.2f}, max {latency['max']:.1f} ms (sent late: p99 {load['start_lag_ms']['p99']:.2f}); "
                 f"{memory['VmRSS']:.0f} -> {memory_after['VmRSS']:.0f} MiB", "", "")

    def queue_timeouts(self, timeout_ms):
        """How late a time-out is, at the client, with every core busy in the only worker."""
        _, rings, segments, request = JOBS[0]
        mesh, slow = self.mesh(rings, segments), self.slow_mesh()
        with self.server("--workers", "1") as server:
            command = [f"{self.binaries}/voxelpipe", "bench", mesh, "--server", server.address, "--json", "--rate", "100",
                       "--warmup", "2", "--duration", str(max(3, self.seconds)), "--queue-timeout-ms", str(timeout_ms),
                       *request]
            load = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            time.sleep(0.7)  # after its own first request
            busy = start_job(self.binaries, server, slow, SLOW)
            text = load.communicate()[0]
            still_busy = busy.poll() is None
            kill(busy)
        result = read_json(text)
        late = result["error_latency_ms"].get("DEADLINE_EXCEEDED")
        if not still_busy or late is None or result["ok"]:
            self.row(f"queue time-out of {timeout_ms} ms, late by", "the worker was not busy all the time", "", "<= 5 ms")
            return
        lag = result["start_lag_ms"]["p99"]
        self.row(f"queue time-out of {timeout_ms} ms, late by",
                 f"p50 {late['p50'] - timeout_ms:.2f}, p99 {late['p99'] - timeout_ms:.2f}, max {late['max'] - timeout_ms:.2f} ms "
                 f"at the client, {result['requests']} requests (sent late: p99 {lag:.2f})", "", "<= 5 ms")

    def cancels(self, runs=10):
        """From a client's death to a worker that is free, as the metrics show it: since it was killed, and since it was gone, which may be
        long after its connection is, or a while after the signal."""
        sphere, slow = self.mesh(188, 188), self.slow_mesh()
        for name, mesh, request in (
                ("f32 256^3, large triangles", slow, SLOW),
                ("sparse f32x3 512^3", sphere, ["--resolution", "512", *SPARSE]),
                ("flood 512^3", sphere, ["--resolution", "512", "--fit", "cube", "--fill", "flood"]),
                ("bits 1024^3", sphere, ["--resolution", "1024", "--fit", "cube"])):
            times, since_gone = [], []
            with self.server("--workers", "1", "--http-listen", "127.0.0.1:0") as server:
                metrics = Metrics(server)
                for attempt in range(4 * runs):
                    job = start_job(self.binaries, server, mesh, request)
                    while metrics.busy() == 0 and job.poll() is None:
                        time.sleep(0.0005)
                    time.sleep(random.Random(attempt).uniform(0, 0.02))
                    if metrics.busy() == 0:
                        kill(job)
                        continue  # it was over
                    begin = time.monotonic()
                    kill(job)
                    gone = time.monotonic()
                    while metrics.busy() != 0:
                        time.sleep(0.001)
                    times.append(1000 * (time.monotonic() - begin))
                    since_gone.append(1000 * (time.monotonic() - gone))
                    if len(times) == runs:
                        break
            if not times:
                self.row(f"client killed, {name}: worker free after", "the job was always over before", "", "<= 50 ms")
                continue
            times.sort()
            self.row(f"client killed, {name}: worker free after",
                     f"median {times[len(times) // 2]:.1f}, worst {times[-1]:.1f} ms of {len(times)} (worst since it was gone: "
                     f"{max(since_gone):.1f})", "", "<= 50 ms")


    def deadlines(self, deadline_ms=300, runs=8):
        """How long a worker is busy with a job whose deadline passes while it runs: the deadline, less the job's way to the worker."""
        manifest = os.path.join(self.folder, "slow.jsonl")
        with open(manifest, "w", encoding="utf-8") as file:
            file.write(json.dumps({"input": self.slow_mesh()}) + "\n")
        times = []
        with self.server("--workers", "1", "--http-listen", "127.0.0.1:0") as server:
            metrics = Metrics(server)
            for _ in range(runs):
                command = [f"{self.binaries}/voxelpipe", "batch", manifest, "--server", server.address, "--output-dir",
                           os.path.join(self.folder, "slow"), "--deadline-ms", str(deadline_ms), "--retries", "0", *SLOW]
                job = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                while metrics.busy() == 0 and job.poll() is None:
                    time.sleep(0.001)
                begin = time.monotonic()
                while metrics.busy() != 0:
                    time.sleep(0.001)
                times.append(1000 * (time.monotonic() - begin))
                job.wait()
        times.sort()
        self.row(f"deadline of {deadline_ms} ms, large triangles: worker busy for",
                 f"median {times[len(times) // 2]:.0f}, most {times[-1]:.0f} ms of {runs}", "", f"<= {deadline_ms + 50} ms")


class Metrics:
    """A server's /metrics, over one connection where it keeps it."""

    def __init__(self, server):
        self.connection = http.client.HTTPConnection(server.http_address)

    def busy(self):
        self.connection.request("GET", "/metrics")
        text = self.connection.getresponse().read().decode()
        return float(re.search(r'^voxelpipe_device_workers_busy\{device="cpu"\} (\S+)', text, re.M).group(1))


def bare_at(binaries, rate, seconds):
    """Bare unary calls at this rate: p99 in ms, and CPU of both sides in us a call."""
    command = [f"{binaries}/service_yardstick", "--rate", str(rate), "--seconds", str(seconds)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return {"p99_ms": float(re.search(r"p99 ([\d.]+)", text).group(1)),
            "cpu_us": float(re.search(r": ([\d.]+) us CPU", text).group(1))}


def start_job(binaries, server, mesh, request):
    return subprocess.Popen([f"{binaries}/voxelpipe", "voxelize", mesh, "--server", server.address, *request],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.wait()


def read_json(text):
    return json.loads(text.strip().splitlines()[-1])


def memory_of(pid):
    """VmRSS and VmHWM in MiB."""
    with open(f"/proc/{pid}/status", encoding="ascii") as status:
        return {key: int(value) / 1024 for key, value in re.findall(r"^(VmRSS|VmHWM):\s+(\d+) kB", status.read(), re.M)}
