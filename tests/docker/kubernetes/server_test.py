"""usage: server_test.py REPOSITORY VOXELPIPED VOXELPIPE

Starts the server with the very arguments of the Deployment, but for its ports, and asks it as Kubernetes and its
clients do: probes, calls with TLS and a token, the end of a pod.
"""
import http.client
import json
import pathlib
import signal
import ssl
import subprocess
import sys
import tempfile
import time

try:
    import yaml
except ImportError as error:
    print(f"SKIPPED: {error} (docker/packages-operations.txt)")
    sys.exit(77)

import kustomize
import programs

PATIENCE_S = 60


class Server:
    """The Deployment's container, here."""

    def __init__(self, voxelpiped, container, secrets):
        arguments = programs.mapped(container["args"], {"/etc/voxelpipe": str(secrets)})
        arguments = [
            "--listen=127.0.0.1:0"
            if one.startswith("--listen=")
            else "--http-listen=127.0.0.1:0"
            if one.startswith("--http-listen=")
            else one
            for one in arguments
        ]
        assert arguments.count("--listen=127.0.0.1:0") == arguments.count("--http-listen=127.0.0.1:0") == 1
        self.process = subprocess.Popen(
            [voxelpiped, *arguments], stdout=subprocess.PIPE, text=True, env=programs.clean_environment()
        )
        try:
            self.address = self.process.stdout.readline().removeprefix("listening on ").strip()
            self.http = self.process.stdout.readline().removeprefix("http on ").strip()
        except BaseException:
            self.process.kill()
            raise

    def get(self, path):
        """The status and the text of a GET; 0 if there is no answer."""
        connection = http.client.HTTPConnection(self.http, timeout=10)
        try:
            connection.request("GET", path)
            answer = connection.getresponse()
            return answer.status, answer.read().decode()
        except OSError:
            return 0, ""
        finally:
            connection.close()


def wait_for(what, condition):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up, what
        time.sleep(0.05)


def check_calls(voxelpipe, server, secrets):
    """Calls with the Service's name in the certificate and a token pass, others do not."""
    port = server.address.rpartition(":")[2]
    access = ["--tls-ca", secrets / "ca.pem", "--token-file", secrets / "token"]

    def call(*options):
        return subprocess.run(
            [voxelpipe, "server-info", "--server", f"localhost:{port}", "--json", *options],
            check=False,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            env=programs.clean_environment(),
        )

    answer = call(*access)
    assert answer.returncode == 0, answer.stderr
    assert json.loads(answer.stdout)["backends"], answer.stdout
    assert call(*access[:2]).returncode != 0, "a call without a token was answered"
    assert call().returncode != 0, "a call in plain text was answered"
    names = ssl.get_server_certificate(("127.0.0.1", int(port)))
    assert names == (secrets / "ca.pem").read_text(encoding="utf-8"), "another certificate"
    return lambda: call(*access).returncode == 0


def main():
    repository, voxelpiped, voxelpipe = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
    overlay = repository / "docker/kubernetes/overlays/cpu/server"
    documents = {kustomize.identity(document): document for document in kustomize.render(overlay)}
    pod = documents["Deployment", "voxelpiped"]["spec"]["template"]["spec"]
    container = pod["containers"][0]
    with tempfile.TemporaryDirectory() as folder:
        secrets = pathlib.Path(folder) / "voxelpipe"
        programs.make_secrets(secrets)
        server = Server(voxelpiped, container, secrets)
        try:
            paths = {
                probe: container[probe]["httpGet"]["path"]
                for probe in ("startupProbe", "readinessProbe", "livenessProbe")
            }
            wait_for("the server does not become ready", lambda: server.get(paths["startupProbe"])[0] == 200)
            assert server.get(paths["readinessProbe"])[0] == server.get(paths["livenessProbe"])[0] == 200
            serves = check_calls(voxelpipe, server, secrets)

            metrics = server.get("/metrics")[1]
            scaled = documents["HorizontalPodAutoscaler", "voxelpiped"]["spec"]["metrics"][0]["pods"]["metric"]["name"]
            assert f"\n{scaled} 0\n" in metrics, scaled
            adapter = yaml.safe_load(
                (repository / "docker/kubernetes/prometheus-adapter.yaml").read_text(encoding="utf-8")
            )
            rule = adapter["rules"]["custom"][0]
            assert rule["seriesQuery"].startswith(scaled + "{") and rule["name"]["as"] == scaled

            server.process.send_signal(signal.SIGTERM)
            told = time.monotonic()
            wait_for("readiness does not end", lambda: server.get(paths["readinessProbe"])[0] == 503)
            assert server.get(paths["livenessProbe"])[0] == 200, "a server that drains is alive"
            assert serves(), "a call within the lame duck was refused"
            code = server.process.wait(timeout=PATIENCE_S)
            took = time.monotonic() - told
            grace = pod["terminationGracePeriodSeconds"] - container["lifecycle"]["preStop"]["sleep"]["seconds"]
            assert code == 0 and took < grace, f"exit code {code} after {took:.1f} s, of {grace} s"
            print(f"served, not ready at SIGTERM, ended after {took:.1f} s of {grace} s")
        finally:
            server.process.kill()
            server.process.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
