"""usage: slurm_test.py VOXELPIPE SOURCE_DIR WORK_DIR [--meshes N] [--triangles N]

The scripts of docker/slurm on a real Slurm with one node, this machine: a list in 8 shards, of which one task is
cancelled and put back into the queue, and one killed (-9), then the same list in 5 shards. No item may be done twice,
`aggregate` has to be exact, and the bytes those of one undisturbed run. Then small arrays with a server on the node and
with --gres=gpu. Exit 77, with the reason, where Slurm is not installed.
"""
import argparse
import collections
import hashlib
import itertools
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

parser = argparse.ArgumentParser()
parser.add_argument("voxelpipe", type=lambda path: pathlib.Path(path).resolve())
parser.add_argument("source", type=lambda path: pathlib.Path(path).resolve())
parser.add_argument("work", type=lambda path: pathlib.Path(path).resolve())
parser.add_argument("--meshes", type=int, default=80)
parser.add_argument("--triangles", type=int, default=300_000)  # of a mesh: reading them is the work of an item
GIVEN = parser.parse_args()
sys.path.insert(0, str(GIVEN.source / "tests/slurm"))
import cluster as slurm  # noqa: E402

SCRIPTS = GIVEN.source / "docker/slurm"
MESHES = 4
PATIENCE = 300 + GIVEN.meshes  # seconds, for an array to end
ENDED = {"COMPLETED", "FAILED", "CANCELLED", "NODE_FAIL", "TIMEOUT", "OUT_OF_MEMORY"}


def write_meshes(directory):
    """A few boxes of many triangles in OFF, and a list of items that voxelize one of them each.

    An item takes a tenth of a second and more, most of it to read its text, so that tasks are met in their midst.
    """
    directory.mkdir()
    side = max(1, round((GIVEN.triangles / 12) ** 0.5))  # squares along an edge of a box
    for mesh in range(MESHES):
        size = (1, 0.5 + mesh / 8, 0.7 + mesh / 11)
        corners, squares = [], []
        for axis, high in itertools.product(range(3), (0, 1)):
            first = len(corners)
            for u, v in itertools.product(range(side + 1), repeat=2):
                corner = {axis: high, (axis + 1) % 3: u / side, (axis + 2) % 3: v / side}
                corners.append("%.6f %.6f %.6f\n" % tuple(corner[a] * size[a] for a in range(3)))
            for u, v in itertools.product(range(side), repeat=2):
                a, b = first + u * (side + 1) + v, first + (u + 1) * (side + 1) + v
                squares.append(f"4 {a} {b} {b + 1} {a + 1}\n" if high else f"4 {a} {a + 1} {b + 1} {b}\n")
        text = f"OFF\n{len(corners)} {len(squares)} 0\n" + "".join(corners) + "".join(squares)
        (directory / f"m{mesh}.off").write_text(text)
    items = [
        {"input": f"m{number % MESHES}.off", "id": f"d{number % 10}/m{number}", "resolution": 32 + number % 61}
        for number in range(GIVEN.meshes)
    ]
    (directory / "list.jsonl").write_text("".join(json.dumps(item) + "\n" for item in items))
    return directory / "list.jsonl"


def tree(directory):
    """The hash of each file by its name; links too, which batch must not leave."""
    files = {}
    for path in directory.rglob("*"):
        name = str(path.relative_to(directory))
        if path.is_symlink():
            files[name] = "link"
        elif path.is_file():
            files[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return files


def finished(directory):
    return sum(1 for _ in (directory / ".voxelpipe").rglob("*.npy.json"))


def stamps(directory):
    """When the result of each item with a record was written, as the file itself says."""
    records = (directory / ".voxelpipe").rglob("*.npy.json")
    files = [directory / record.relative_to(directory / ".voxelpipe").with_suffix("") for record in records]
    return {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in files}


def wait_for(what, condition, patience=PATIENCE):
    end = time.monotonic() + patience
    while not (value := condition()):
        if time.monotonic() > end:
            raise SystemExit(f"slurm: waited {patience} s for {what}")
        time.sleep(0.05)
    return value


def check(fact, what):
    if not fact:
        raise SystemExit(f"slurm: {what}")


class Array:
    """One submission of the list: the array job and the aggregate after it."""

    def __init__(self, cluster, output, count, *sbatch, batch=(), **variables):
        self.cluster, self.output, self.count = cluster, output, count
        options = [f"--array=0-{count - 1}", "--cpus-per-task=1", *sbatch]
        arguments = [str(LIST), str(output), *batch]
        text = cluster.run(SCRIPTS / "submit.sh", *options, "--", *arguments, **variables)
        self.job = text.split()[-1]
        self.aggregate = re.search(r"Submitted batch job (\d+)", text)[1]
        self.reports = pathlib.Path(f"{output}.reports") / self.job

    def running(self):
        """Tasks that run, and the numbers of their jobs."""
        lines = self.cluster.run("squeue", "--noheader", "-t", "R", "-j", self.job, "-o", "%a %A", "-r", check=False)
        pairs = [line.split() for line in lines.splitlines() if line.strip()]
        return [(self.cluster.run("squeue", "--noheader", "-j", job, "-o", "%K").strip(), job) for _, job in pairs]

    def two_running(self):
        running = self.running()
        return running[:2] if len(running) > 1 else None

    def states(self):
        return {name: state for name, state in self.cluster.jobs().items() if name.startswith(self.job + "_")}

    def wait(self):
        """Until array and aggregate have ended. Out: the aggregate's JSON, and the states of the tasks."""
        wait_for(f"array {self.job}", lambda: set(self.states().values()) <= ENDED and len(self.states()) == self.count)
        wait_for("the aggregate job", lambda: self.cluster.jobs().get(self.aggregate) in ENDED)
        if not (self.reports / "left.jsonl").exists():
            logs = "".join(path.read_text() for path in self.cluster.directory.glob(f"voxelpipe-{self.job}_*.log"))
            raise SystemExit(f"slurm: no aggregate\n{logs}")
        reports = sorted(self.reports.glob("[0-9]*.json"))
        done = subprocess.run(
            [GIVEN.voxelpipe, "aggregate", *reports, "--json"], stdout=subprocess.PIPE, text=True, check=False
        )
        return json.loads(done.stdout), self.states()

    def made(self):
        """How often each item was made, by the reports."""
        times = collections.Counter()
        for path in self.reports.glob("[0-9]*.json"):
            items = json.loads(path.read_text())["items"]
            times.update(item["id"] for item in items if item["status"] == "done")
        return times


def disturb(array):
    """Cancels one task and queues it again, and kills another. Out: their numbers, and the results that were there."""
    share = GIVEN.meshes // 8
    wait_for("items in the midst of their shards", lambda: finished(array.output) >= max(2, share // 4))
    (queued, _), (killed, killed_job) = wait_for("two tasks", array.two_running)
    array.cluster.run("scontrol", "requeue", f"{array.job}_{queued}")
    processes = wait_for("a process", lambda: array.cluster.processes(killed_job, "voxelpipe"))
    for process in processes:
        os.kill(process, signal.SIGKILL)
    at = stamps(array.output)
    wait_for("the requeue", lambda: array.states().get(f"{array.job}_{queued}") == "PENDING")
    array.cluster.run("scontrol", "update", f"JobId={array.job}_{queued}", "StartTime=now")  # not in two minutes
    return queued, killed, at


def main():
    reason = slurm.why_not()
    if reason:
        print(f"slurm: {reason}")
        sys.exit(77)
    shutil.rmtree(GIVEN.work, ignore_errors=True)
    GIVEN.work.mkdir(parents=True)
    global LIST
    LIST = write_meshes(GIVEN.work / "meshes")
    os.environ["PATH"] = f"{GIVEN.voxelpipe.parent}:{os.environ['PATH']}"
    begin = time.monotonic()
    command = [GIVEN.voxelpipe, "batch", LIST, "--output-dir", GIVEN.work / "whole", "--threads", "1", "--jobs", "2"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    whole = tree(GIVEN.work / "whole")
    print(f"slurm: undisturbed {GIVEN.meshes} meshes, {len(whole)} files, {time.monotonic() - begin:.1f} s")

    # Not in the folder of the build: the path of a socket has at most 107 bytes.
    with tempfile.TemporaryDirectory(prefix="slurm-") as directory, slurm.Cluster(directory, cpus=2) as cluster:
        out = GIVEN.work / "out"
        begin = time.monotonic()
        first = Array(cluster, out, 8, VOXELPIPE_RESTARTS="0")
        queued, killed, at = disturb(first)
        all_of, states = first.wait()
        share = sum(1 for i in range(GIVEN.meshes) if i % 8 == int(killed))
        print(
            f"slurm: 8 shards, task {queued} requeued and task {killed} killed at {len(at)} results: "
            f"{time.monotonic() - begin:.1f} s, done {all_of['done']}, missing {all_of['missing']}"
        )
        check(0 < len(at) < GIVEN.meshes, "nothing was disturbed")
        check(states.pop(f"{first.job}_{killed}") == "FAILED", f"the killed task did not fail: {states}")
        check(set(states.values()) == {"COMPLETED"}, f"tasks did not complete: {states}")
        check(all_of["items"] == GIVEN.meshes and all_of["failed"] == 0, f"aggregate is wrong: {all_of}")
        check(all_of["missing"] == share, f"missing are not those of the killed task: {all_of['missing']}, {share}")
        check(all_of["shards_without_report"] == [f"{killed}/8"], all_of["shards_without_report"])
        check(len((first.reports / "left.jsonl").read_text().splitlines()) == share, "the retry list is wrong")
        between = stamps(out)
        before = len(between)

        begin = time.monotonic()
        second = Array(cluster, out, 5)
        all_of, states = second.wait()
        print(f"slurm: 5 shards over {before} finished items: {time.monotonic() - begin:.1f} s, {all_of['done']} done")
        check(set(states.values()) == {"COMPLETED"}, f"tasks did not complete: {states}")
        check(all_of["done"] == all_of["items"] == GIVEN.meshes, f"not all is done: {all_of}")
        made = second.made()
        check(sum(made.values()) == GIVEN.meshes - before, "the second array did what was done")
        check(max((first.made() + made).values()) == 1, "an item was done twice")
        check(f"{GIVEN.meshes:,} items" in (second.reports / "aggregate.txt").read_text(), "the table is wrong")
        check((second.reports / "left.jsonl").read_text() == "", "something is left")
        last = stamps(out)
        again = [path for path, stamp in [*at.items(), *between.items()] if last[path] != stamp]
        check(not again, f"results were written again: {again}")
        check(tree(out) == whole, "the bytes are not those of an undisturbed run")

        for name, options, variables in (
            ("server", [], {"VOXELPIPE_NODE_SERVER": "1"}),
            ("gpu", ["--gres=gpu:1"], {}),
        ):
            if name == "server" and not (GIVEN.voxelpipe.parent / "voxelpiped").exists():
                continue
            array = Array(cluster, GIVEN.work / name, 2, *options, **variables)
            all_of, states = array.wait()
            check(set(states.values()) == {"COMPLETED"}, f"{name}: tasks did not complete: {states}")
            check(all_of["done"] == GIVEN.meshes, f"{name}: {all_of}")
            check(tree(GIVEN.work / name) == whole, f"{name}: other bytes")
            print(f"slurm: {name}: the same bytes")


if __name__ == "__main__":
    main()
