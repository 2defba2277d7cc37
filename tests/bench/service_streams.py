"""The rows of service.py about many bytes: sending ready results, with and without TLS, and uploading meshes.

Each row alternates with bare gRPC: medians of both."""
import json
import os
import re
import statistics
import struct
import subprocess

ROUNDS = 5
MEBIBYTES = 768  # of one bare stream
DENSE = ["--resolution", "512", "--fit", "cube", "--target", "u8x1:replace:shader=constant", "--stream",
         "--same-request"]
PIECES = (("1 MiB", 1 << 20), ("256 KiB", 256 << 10))


class StreamRows:
    """In: service.py's own parts, and a folder for meshes and certificates."""

    def __init__(self, server, sphere, row, folder, binaries, seconds):
        self.server, self.row, self.folder, self.binaries = server, row, folder, binaries
        self.seconds = max(1.0, seconds / ROUNDS * 2)  # a few results each
        self.mesh = os.path.join(folder, "sphere.glb")
        sphere(self.mesh, 11, 25)

    def all(self):
        for name, piece in PIECES:
            self.result(name, piece, "", ["--without-hash"])
            self.result(name, piece, ", with SHA-256", [])
        tls = self.certificate()
        if tls:
            self.result(*PIECES[0], ", TLS", ["--without-hash"], tls)
        self.library()

    def bare(self, tls=None):
        """One round of the yardstick: name -> (GB/s, CPU-s/GB)."""
        command = [f"{self.binaries}/service_yardstick", "--streams", "--megabytes", str(MEBIBYTES)]
        command += ["--tls-cert", tls[0], "--tls-key", tls[1]] if tls else []
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        rows = re.findall(r"^(.{32}) .*?([\d.]+) GB/s +([\d.]+) CPU-s/GB", text, re.M)
        return {name.strip(): (float(speed), float(cpu)) for name, speed, cpu in rows}

    def result(self, name, piece, label, options, tls=None):
        """A result that was made once, before the time is taken, and kept."""
        flags = ["--piece-bytes", str(piece), "--result-cache-bytes", "1G"]
        flags += ["--tls-cert", tls[0], "--tls-key", tls[1]] if tls else []
        options = options + (["--tls-ca", tls[0]] if tls else [])
        ours, bare = [], []
        with self.server(*flags) as server:
            for _ in range(ROUNDS):
                bare.append(self.bare(tls)[f"raw stream, {name} pieces"])
                got = server.bench(self.mesh, *DENSE, *options, seconds=self.seconds)
                if not got["ok"]:
                    self.row(f"dense 512^3 u8, {name} pieces{label}", "no answer in time: more seconds", "", ">= 90 %")
                    return
                gigabytes = got["result_bytes"] * 1e-9
                cpu = got["server"]["cpu_us_per_request"] + got["client"]["cpu_us_per_request"]
                ours.append((gigabytes * got["per_second"], cpu * 1e-6 / gigabytes))
        self.compare(f"dense 512^3 u8, {name} pieces{label}", ours, bare, ">= 90 %")

    def library(self):
        """The same through the C++ client, into memory, and a mesh of 64 MiB up. Needs the target service_client."""
        program = f"{self.binaries}/service_client"
        if not os.path.exists(program):
            return
        mesh = os.path.join(self.folder, "heavy.glb")
        pad(self.mesh, mesh, 64 << 20)
        rounds = {"result": [], "hashed": [], "upload": []}
        bare = []
        with self.server("--result-cache-bytes", "1G") as server:
            for _ in range(ROUNDS):
                bare.append(self.bare())
                out = subprocess.run([program, server.address, str(server.process.pid), mesh, str(self.seconds / 2)],
                                     capture_output=True, text=True, check=True).stdout
                for key, of in json.loads(out).items():
                    cpu = of["server_cpu_s_per_gb"] + of["client_cpu_s_per_gb"]
                    rounds[key].append((of["gigabytes_per_second"], cpu))
        down = [of["raw stream, 1 MiB pieces"] for of in bare]
        wide = [of["raw stream, 1 MiB of 128 MiB"] for of in bare]
        self.compare("bare gRPC, pieces of 128 MiB in place of one", wide, down, "")
        self.compare("dense 512^3 u8 into memory, C++ client", rounds["result"], down, "")
        self.compare("dense 512^3 u8 into memory, SHA-256 checked", rounds["hashed"], down, "")
        self.compare("mesh of 64 MiB up, C++ client", rounds["upload"], [of["raw upload, 1 MiB pieces"] for of in bare], "")

    def compare(self, what, ours, bare, target):
        speed, cpu = (statistics.median(of) for of in zip(*ours))
        bare_speed, bare_cpu = (statistics.median(of) for of in zip(*bare))
        with_cpu = f", {cpu:.2f} CPU-s/GB" if cpu else ""
        self.row(what, f"{speed:.2f} GB/s ({speed / bare_speed:.0%}){with_cpu}", f"{bare_speed:.2f} GB/s, {bare_cpu:.2f} CPU-s/GB",
                 target)

    def certificate(self):
        """A certificate for this machine that signs itself, and its key; None where there is no openssl to make it."""
        cert, key = (os.path.join(self.folder, name) for name in ("cert.pem", "key.pem"))
        command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
                   "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1", "-keyout", key, "-out", cert]
        try:
            subprocess.run(command, capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            return None
        return cert, key


def pad(source, target, extra):
    """Copies a GLB with `extra` bytes more in its buffer, which nothing refers to."""
    with open(source, "rb") as file:
        data = file.read()
    json_bytes = struct.unpack_from("<I", data, 12)[0]
    text = json.loads(data[20:20 + json_bytes])
    buffer = data[28 + json_bytes:] + bytes(extra)
    text["buffers"][0]["byteLength"] = len(buffer)
    chunk = json.dumps(text).encode()
    chunk += b" " * (-len(chunk) % 4)
    with open(target, "wb") as file:
        file.write(struct.pack("<4sIII4s", b"glTF", 2, 28 + len(chunk) + len(buffer), len(chunk), b"JSON") + chunk)
        file.write(struct.pack("<I4s", len(buffer), b"BIN\0") + buffer)
