"""usage: readme_test.py REPOSITORY PROGRAMS_DIR WORK_DIR

Runs the blocks of docker/README.md that are marked sh, in one bash, as they stand there but for the ports, which are
free ones. Of the blocks marked console, which need an engine, root or a cluster, it checks the syntax, that their files
are there, and that the programs know the options.
"""
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys

TIMEOUT_S = 240
PORTS = ["50051", "50052", "50053", "9464"]  # of the page
PROGRAMS = {"voxelpipe": True, "voxelpiped": False}  # True: with commands


def free_ports(count):
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [str(one.getsockname()[1]) for one in sockets]
    for one in sockets:
        one.close()
    return ports


def known_options(folder, program, command=None):
    arguments = [folder / program, *([command] if command else []), "--help"]
    text = subprocess.run(arguments, capture_output=True, text=True, timeout=60, check=True).stdout
    return set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text))


def check_console(block, repository, folder):
    """Syntax, files, options."""
    answer = subprocess.run(["bash", "-n"], input=block, capture_output=True, text=True, timeout=60, check=False)
    assert answer.returncode == 0, f"{block}\n{answer.stderr}"
    for path in re.findall(r"(?<![\w/.-])(?:docker|tests)/[\w./-]+", block):
        assert (repository / path).exists(), f"{path} is not there:\n{block}"
    for line in re.sub(r"\\\n", " ", block).splitlines():
        for program, commands in PROGRAMS.items():
            for call in re.findall(rf"(?:^|['|&] *){program} (\S.*)", line):
                used = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", call))
                unknown = used - known_options(folder, program, call.split()[0] if commands else None)
                assert not unknown, f"{program} has no {sorted(unknown)}: {line}"


def run_sh(blocks, repository, folder, work):
    script = "\n".join(blocks)
    for port, free in zip(PORTS, free_ports(len(PORTS))):
        assert port in script, f"no command uses the port {port}"
        script = re.sub(rf"\b{port}\b", free, script)
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    subprocess.run([sys.executable, repository / "tests/support/make_ball.py", work / "bunny.glb"], check=True)
    environment = {key: value for key, value in os.environ.items() if not key.startswith("VOXELPIPE_")}
    environment["PATH"] = f"{folder}:{environment['PATH']}"
    start = "set -euo pipefail\ntrap 'kill -KILL $(jobs -p) 2>/dev/null || true' EXIT\n"
    with (work / "log").open("w", encoding="utf-8") as log:
        answer = subprocess.run(
            ["bash", "-xc", start + script],
            cwd=work,
            env=environment,
            stdout=log,
            stderr=log,
            timeout=TIMEOUT_S,
            check=False,
        )
    assert answer.returncode == 0, (work / "log").read_text(encoding="utf-8")[-4000:]
    return (work / "log").read_text(encoding="utf-8")


def main():
    repository, folder, work = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
    readme = (repository / "docker/README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", readme, re.S | re.M)
    assert {language for language, _ in blocks} == {"sh", "console", "ini"}
    for language, block in blocks:
        if language == "console":
            check_console(block, repository, folder)
    shell = [block for language, block in blocks if language == "sh"]
    log = run_sh(shell, repository, folder, work)
    for expected in ("+ echo refused", "+ echo killed", "0 done, 200 done before, 0 failed"):
        assert expected in log, f"no '{expected}' in:\n{log[-4000:]}"
    print(f"{len(shell)} blocks run, {sum(language == 'console' for language, _ in blocks)} looked at")
    return 0


if __name__ == "__main__":
    sys.exit(main())
