"""usage: batch_test.py REPOSITORY VOXELPIPE WORK_DIR

Runs the Indexed Job of docker/kubernetes/ as its controller would, without one: the very command of the container for
each index, with the variables set, two at a time; one is killed on the way and started again; an index that ends with 3
has failed for good. Then the command of the aggregate. The results are those of one undisturbed run.
"""
import hashlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

try:
    import yaml  # pylint: disable=unused-import
except ImportError as error:
    print(f"SKIPPED: {error} (docker/packages-operations.txt)")
    sys.exit(77)

import kustomize
import programs

MESHES = 96
PATIENCE_S = 120
KILLED = 3  # this index


def make_meshes(repository, data):
    """`MESHES` meshes of different sizes, and their list."""
    ball = data / "meshes/ball.glb"
    ball.parent.mkdir(parents=True)
    subprocess.run([sys.executable, repository / "tests/support/make_ball.py", ball], check=True)
    lines = [
        {"input": "meshes/ball.glb", "id": f"ball-{i}", "resolution": 96 + i, "fill": "parity"} for i in range(MESHES)
    ]
    write_list(data, lines)
    return lines


def write_list(data, lines):
    (data / "list.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")


def container_of(documents, name):
    return next(document for document in documents if document["metadata"]["name"] == name)["spec"]["template"]["spec"][
        "containers"
    ][0]


class Cluster:
    """Starts the containers of the Job, as Kubernetes would."""

    def __init__(self, documents, voxelpipe, data):
        self.job = next(document for document in documents if document["metadata"]["name"] == "voxelpipe-batch")["spec"]
        self.container, self.voxelpipe, self.data = container_of(documents, "voxelpipe-batch"), voxelpipe, data

    def start(self, index):
        """The container of an index: $(NAME) in arguments are variables, of which the Job's controller sets one."""
        variables = {one["name"]: one["value"] for one in self.container["env"]}
        variables["JOB_COMPLETION_INDEX"] = str(index)
        arguments = self.container["args"]
        for name, value in variables.items():
            arguments = [argument.replace(f"$({name})", value) for argument in arguments]
        command = [self.voxelpipe if word == "voxelpipe" else word for word in self.container["command"]]
        return subprocess.Popen(
            [*command, *programs.mapped(arguments, {"/data": str(self.data)})],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=programs.clean_environment(**variables),
        )

    def action(self, code):
        for rule in self.job["podFailurePolicy"]["rules"]:
            if code in rule.get("onExitCodes", {}).get("values", []):
                return rule["action"]
        return "Count"

    def run(self, kill=None):
        """Runs all indexes to their end, two at a time; `kill`: this index once, on its way. Out: {index: exit code of
        its last pod}, and how many pods there were."""
        waiting, running, ended, pods = list(range(self.job["completions"])), {}, {}, 0
        give_up = time.monotonic() + PATIENCE_S
        while waiting or running:
            assert time.monotonic() < give_up, f"{running} run still"
            while waiting and len(running) < 2:
                index = waiting.pop(0)
                running[index] = self.start(index)
                pods += 1
            if kill in running and self.results_of(kill) > 0:
                running[kill].send_signal(signal.SIGKILL)
                assert running[kill].wait() == -signal.SIGKILL, "the index ended before it was killed"
                assert self.results_of(kill) < MESHES // self.job["completions"], "the index was killed too late"
                kill = None
            for index, process in list(running.items()):
                if process.poll() is None:
                    continue
                del running[index]
                ended[index] = process.returncode
                assert self.action(process.returncode) != "FailJob", f"index {index} ended with {process.returncode}"
                if process.returncode != 0 and self.action(process.returncode) == "Count":
                    waiting.insert(0, index)
            time.sleep(0.002)
        return ended, pods

    def results_of(self, index):
        return sum(
            (self.data / f"results/ball-{i}.npy").is_file() for i in range(index, MESHES, self.job["completions"])
        )


def aggregate(documents, voxelpipe, data):
    container = container_of(documents, "voxelpipe-aggregate")
    command = [*container["command"], *programs.mapped(container["args"], {"/data": str(data)})]
    path = programs.clean_environment(PATH=f"{voxelpipe.parent}:{os.environ['PATH']}")
    answer = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=path)
    assert answer.stdout, answer.stderr
    return answer.returncode, json.loads(answer.stdout)


def digests(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("*.npy")}


def main():
    repository, voxelpipe, work = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
    overlay = repository / "docker/kubernetes/overlays/cpu"
    documents = kustomize.render(overlay / "batch") + kustomize.render(overlay / "aggregate")
    shutil.rmtree(work, ignore_errors=True)
    data = work / "data"
    lines = make_meshes(repository, data)
    cluster = Cluster(documents, voxelpipe, data)

    ended, pods = cluster.run(kill=KILLED)
    assert set(ended.values()) == {0} and pods == cluster.job["completions"] + 1, f"{ended}, {pods} pods"
    code, report = aggregate(documents, voxelpipe, data)
    assert code == 0 and report["done"] == MESHES and report["failed"] == 0 and report["missing"] == 0, report
    subprocess.run(
        [voxelpipe, "batch", data / "list.jsonl", "--output-dir", work / "alone", "--resolution=128"],
        check=True,
        stdout=subprocess.DEVNULL,
        timeout=PATIENCE_S,
        env=programs.clean_environment(),
    )
    assert digests(data / "results") == digests(work / "alone") and len(digests(work / "alone")) == MESHES

    # A mesh that is none: its index has failed for good, the others go on.
    (data / "meshes/broken.glb").write_bytes(os.urandom(100))
    write_list(data, [*lines, {"input": "meshes/broken.glb", "id": "broken"}])
    ended, pods = cluster.run()
    broken = MESHES % cluster.job["completions"]
    assert ended == {index: 3 if index == broken else 0 for index in ended} and pods == len(
        ended
    ), f"{ended}, {pods} pods"
    code, report = aggregate(documents, voxelpipe, data)
    assert code == 3 and report["done"] == MESHES and report["failed"] == 1, report
    left = (data / "retry.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(left) == 1 and json.loads(left[0])["id"] == "broken", left
    print(f"{MESHES} meshes by {len(ended)} indexes, one killed; a broken mesh failed its index alone")
    return 0


if __name__ == "__main__":
    sys.exit(main())
