"""usage: alert_drill.py REPOSITORY PROGRAMS_DIR

A drill of the alerts in docker/alerts.yaml: a real Prometheus scrapes real servers, which are brought into trouble one
after the other, and each alert fires for the server that has it. The rules are those of the file, but for their times:
no `for`, and a window of WINDOW. VoxelpipeNoDevice and VoxelpipeMemoryFull are left to tests/docker/alerts.test.yaml.
Exit 77 with the reason without Prometheus.
"""
import contextlib
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

try:
    import yaml
except ImportError as error:
    print(f"SKIPPED: {error} (docker/packages-operations.txt)")
    sys.exit(77)

PATIENCE_S = 60
WINDOW = "8s"
INTERVAL = "500ms"
TOKEN = "the-token-of-the-drill"
DESCRIPTORS = 80  # of the server that is short of them


def children_of(pid):
    tasks = pathlib.Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text(encoding="utf-8").split()]


class Server:
    def __init__(self, program, *options, descriptors=None, **variables):
        self.command = [program, "--log-level=error", *map(str, options)]
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("VOXELPIPE_")} | variables
        self.descriptors = descriptors
        self.start("127.0.0.1:0", "127.0.0.1:0")

    def start(self, listen, http):
        def limit():
            if self.descriptors:
                resource.setrlimit(resource.RLIMIT_NOFILE, (self.descriptors, self.descriptors))

        self.process = subprocess.Popen(  # pylint: disable=subprocess-popen-preexec-fn
            [*self.command, f"--listen={listen}", f"--http-listen={http}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=self.environment,
            preexec_fn=limit,
        )
        self.address = self.process.stdout.readline().removeprefix("listening on ").strip()
        self.http = self.process.stdout.readline().removeprefix("http on ").strip()
        assert self.http, "a server does not start"

    def wait_for_sample(self, line):
        """Until /metrics has this line."""
        give_up = time.monotonic() + PATIENCE_S
        text = ""
        while f"\n{line}\n" not in text:
            assert time.monotonic() < give_up, f"no '{line}' in {text}"
            with urllib.request.urlopen(f"http://{self.http}/metrics", timeout=30) as answer:
                text = answer.read().decode()
            time.sleep(0.05)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def restart(self):
        self.kill()
        self.start(self.address, self.http)


class Prometheus:
    def __init__(self, repository, work, servers):
        with socket.create_server(("127.0.0.1", 0)) as one:
            self.address = f"127.0.0.1:{one.getsockname()[1]}"
        config = yaml.safe_load((repository / "docker/prometheus.yaml").read_text(encoding="utf-8"))
        config["global"] = {"scrape_interval": INTERVAL, "evaluation_interval": INTERVAL}
        config["scrape_configs"][0]["static_configs"] = [{"targets": [server.http for server in servers]}]
        rules = yaml.safe_load((repository / "docker/alerts.yaml").read_text(encoding="utf-8"))
        for rule in rules["groups"][0]["rules"]:
            rule.pop("for", None)
            rule["expr"] = re.sub(r"\[\d+m\]", f"[{WINDOW}]", rule["expr"])
        (work / "prometheus.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
        (work / "alerts.yaml").write_text(yaml.safe_dump(rules), encoding="utf-8")
        self.process = subprocess.Popen(
            [
                "prometheus",
                f"--config.file={work}/prometheus.yaml",
                f"--storage.tsdb.path={work}/data",
                f"--web.listen-address={self.address}",
                "--log.level=error",
            ]
        )

    def firing(self):
        """Pairs of an alert and the server for which it fires."""
        try:
            with urllib.request.urlopen(f"http://{self.address}/api/v1/alerts", timeout=10) as answer:
                alerts = json.load(answer)["data"]["alerts"]
        except OSError:  # it is not up yet
            return set()
        return {(one["labels"]["alertname"], one["labels"]["instance"]) for one in alerts if one["state"] == "firing"}


class Drill:
    def __init__(self, prometheus):
        self.prometheus, self.seen = prometheus, []

    def expect(self, alert, server, trouble=lambda: None):
        """Makes trouble until the alert fires."""
        give_up = time.monotonic() + PATIENCE_S
        while (alert, server.http) not in self.prometheus.firing():
            assert time.monotonic() < give_up, f"{alert} does not fire, but {self.prometheus.firing()}"
            trouble()
            time.sleep(0.1)
        self.seen.append(alert)
        print(f"{alert} fires", flush=True)


def make_certificate(work):
    subject = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost", "-days", "7", "-nodes"]
    files = ["-keyout", work / "tls.key", "-out", work / "tls.crt"]
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]
    subprocess.run(["openssl", "req", "-x509", *key, *subject, *files], check=True, capture_output=True, timeout=60)


def write_large_obj(path, scale):
    """A strip of 1,000 triangles, some 24 KiB once it is loaded."""
    corners = "".join(f"v {scale * i / 1000} {i % 2} 0\n" for i in range(1002))
    path.write_text(corners + "".join(f"f {i} {i + 1} {i + 2}\n" for i in range(1, 1001)), encoding="utf-8")


def run_drill(repository, programs, work, stack):
    make_certificate(work)
    subprocess.run([sys.executable, repository / "tests/support/make_ball.py", work / "ball.glb"], check=True)
    tokens = {"clients": [{"name": "drill", "role": "user", "token": TOKEN}]}
    (work / "tokens.json").write_text(json.dumps(tokens), encoding="utf-8")
    (work / "token").write_text(TOKEN, encoding="utf-8")
    (work / "fault").write_text("", encoding="utf-8")
    subprocess.run([sys.executable, repository / "tests/docker/make_3mf.py", work / "corner.3mf"], check=True)

    def start(server):
        stack.callback(server.kill)
        return server

    guarded = start(
        Server(
            programs / "voxelpiped",
            *(f"--tls-cert={work}/tls.crt", f"--tls-key={work}/tls.key", f"--token-file={work}/tokens.json"),
            *("--reload-interval-ms=60000", "--isolate-loading=on"),
        )
    )
    faulty = start(
        Server(
            programs / "faulty_voxelpiped",
            *(
                "--max-queue=1",
                "--workers=1",
                "--gpu-streams=1",
                "--threads=1",
                "--share-equal-jobs=false",
                "--fallback=false",
            ),
            VOXELPIPE_TEST_FAULTS=str(work / "fault"),
        )
    )
    short = start(Server(programs / "voxelpiped", "--max-mesh-store-bytes=64KiB", descriptors=DESCRIPTORS))
    prometheus = Prometheus(repository, work, [guarded, faulty, short])
    stack.callback(prometheus.process.wait)
    stack.callback(prometheus.process.kill)
    drill = Drill(prometheus)
    client = programs / "voxelpipe"

    def call(*arguments):
        command = [client, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)

    # Nothing else is wrong with three idle servers.
    drill.expect("VoxelpipeCertificateExpires", guarded)
    time.sleep(2)
    assert prometheus.firing() == {("VoxelpipeCertificateExpires", guarded.http)}, prometheus.firing()

    port = guarded.address.rpartition(":")[2]
    (work / "old-token").write_text("a-token-of-before", encoding="utf-8")
    access = ["--server", f"localhost:{port}", "--tls-ca", work / "tls.crt", "--token-file", work / "old-token"]
    drill.expect("VoxelpipeCallersRefused", guarded, lambda: call("server-info", *access))

    (work / "tokens.json").write_text("{", encoding="utf-8")
    drill.expect("VoxelpipeReloadFails", guarded, lambda: guarded.process.send_signal(signal.SIGHUP))

    def kill_loaders():
        call("voxelize", work / "corner.3mf", "--resolution", 8, *access[:4], "--token-file", work / "token")
        for pid in children_of(guarded.process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    drill.expect("VoxelpipeLoadersDie", guarded, kill_loaders)

    load = ["bench", work / "ball.glb", "--server", faulty.address, "--resolution", 128, "--duration", 1]
    drill.expect("VoxelpipeRefusesJobs", faulty, lambda: call(*load, "--concurrency", 32))

    # A job that stalls, and one behind it that waits.
    job = ["voxelize", work / "ball.glb", "--server", faulty.address, "--backend", "cuda"]
    (work / "fault").write_text("kind=stall stage=fine_raster runs=1", encoding="utf-8")
    jobs = []
    for sample in ('voxelpipe_device_workers_busy{device="cuda:0"} 1', 'voxelpipe_queue_jobs{priority="normal"} 1'):
        jobs.append(stack.enter_context(subprocess.Popen([client, *map(str, job)], stdout=subprocess.DEVNULL)))
        faulty.wait_for_sample(sample)
    time.sleep(11)
    (work / "fault").write_text("kind=none", encoding="utf-8")
    drill.expect("VoxelpipeQueueSlow", faulty)
    assert [one.wait(PATIENCE_S) for one in jobs] == [0, 0]
    (work / "fault").write_text("kind=throw stage=fine_raster runs=-1", encoding="utf-8")
    drill.expect("VoxelpipeJobsFail", faulty, lambda: call(*job))
    (work / "fault").write_text("kind=lost stage=fine_raster runs=-1 probes=1000000", encoding="utf-8")
    drill.expect("VoxelpipeDeviceQuarantined", faulty, lambda: call(*job))

    # Stored meshes that evict each other before a call names them.
    together = ["voxelize", *[work / f"{name}.obj" for name in "abc"], "--together", "--server", short.address]
    for scale, name in enumerate("abc", start=1):
        write_large_obj(work / f"{name}.obj", scale)
    drill.expect("VoxelpipeMeshStoreTooSmall", short, lambda: call(*together))

    host, _, port = short.address.rpartition(":")
    connections = []

    def connect():
        if len(os.listdir(f"/proc/{short.process.pid}/fd")) < 0.9 * DESCRIPTORS:
            connections.append(stack.enter_context(socket.create_connection((host, int(port)))))

    drill.expect("VoxelpipeDescriptorsShort", short, connect)
    short.kill()
    drill.expect("VoxelpipeDown", short)

    def restart():
        faulty.restart()
        time.sleep(1.5)  # so that each start is scraped

    drill.expect("VoxelpipeRestarts", faulty, restart)
    return drill.seen


def main():
    repository, programs = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    if shutil.which("prometheus") is None:
        print("SKIPPED: Prometheus is not installed (docker/packages-prometheus.txt)")
        return 77
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        seen = run_drill(repository, programs, pathlib.Path(folder), stack)
    print(f"{len(seen)} alerts fired")
    return 0


if __name__ == "__main__":
    sys.exit(main())
