"""usage: stub_recipes.py LANGUAGE PROGRAMS_DIR REPOSITORY WORK_DIR

Runs the lines and the programs of one language in proto/README.md as they stand, but for the port, which is one that is
free; then with a resolution whose result comes in one message. The bytes and files that the programs write must be
those of the command line; no file may be left of a server that dies while it sends one. Exit 77 with the reason if a
tool is missing.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time
import zipfile

RESOLUTION = "256"  # of the programs: 2 MiB
SMALL_RESOLUTION = "64"
TORN_RESOLUTION = "740"
NPM_PACKAGES = re.compile(r"`npm install ([^`]+)`")


def read_section(readme, language):
    """The shell's lines, and the programs by name."""
    section = readme.split(f"\n## {language}\n")[1].split("\n## ")[0]
    shell = re.search(r"^```sh\n(.*?)^```$", section, re.S | re.M).group(1)
    programs = re.findall(r"^`([\w.]+)`(?:(?!^```).)*?^```\w+\n(.*?)^```$", section, re.S | re.M)
    return section, shell, dict(programs)


def found(*programs):
    missing = [program for program in programs if shutil.which(program) is None]
    return f"{', '.join(missing)}: not installed" if missing else ""


def python_missing(section, work):
    result = subprocess.run(["python3", "-c", "import grpc, google.protobuf"], stderr=subprocess.DEVNULL)
    return found("protoc", "grpc_python_plugin") or ("" if result.returncode == 0 else "Python has no module grpc")


def go_missing(section, work):
    os.environ["GOCACHE"] = str(work.parent / "go-cache")
    return found("protoc", "go", "protoc-gen-go", "protoc-gen-go-grpc")


def javascript_missing(section, work):
    missing = found("protoc", "node", "npm")
    if missing:
        return missing
    version = subprocess.run(["node", "--version"], capture_output=True, text=True, check=True).stdout
    if int(version[1:].split(".")[0]) < 20:
        return f"Node.js is {version.strip()}, needed is 20"
    kept = work.parent / "npm"
    packages = NPM_PACKAGES.search(section.replace("\n", " ")).group(1).split()
    if not (kept / "node_modules/@connectrpc/connect-node").is_dir():
        kept.mkdir(parents=True, exist_ok=True)
        command = ["npm", "install", "--prefix", kept, "--no-audit", "--no-fund", "--silent", *packages]
        try:
            subprocess.run(command, timeout=120, check=True)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
            return "npm cannot install the packages"
    (work / "node_modules").symlink_to(kept / "node_modules")
    return ""


def write_programs(work, sources, resolution, port):
    for name, code in sources.items():
        own = code.replace(RESOLUTION, resolution).replace("50051", port).replace("localhost", "127.0.0.1")
        (work / name).write_text(own, encoding="utf-8")


MISSING = {"Python": python_missing, "Go": go_missing, "JavaScript": javascript_missing}


def run(programs, work, shell, resolution):
    script = "set -euo pipefail\n" + shell
    result = subprocess.run(["bash", "-c", script], cwd=work, stdout=subprocess.PIPE, text=True, timeout=250)
    print(result.stdout)
    assert result.returncode == 0, f"exit {result.returncode}"
    assert re.search(r"^\d+ x \d+ x \d+ voxels\n\d+ occupied$", result.stdout, re.M), "no summary"
    command = [programs / "voxelpipe", "voxelize", "bunny.glb", "--resolution", resolution, "-o", "expected.raw"]
    subprocess.run(command, cwd=work, check=True, stdout=subprocess.DEVNULL)
    same = (work / "bunny.bits").read_bytes() == (work / "expected.raw").read_bytes()
    assert same, f"resolution {resolution}: other bytes than the command line"
    for exported in work.glob("result.*"):
        check_file(programs, work, exported, resolution)
        exported.unlink()


def check_file(programs, work, exported, resolution):
    expected = work / "expected" / exported.name.removesuffix(".zip")
    shutil.rmtree(expected.parent, ignore_errors=True)
    expected.parent.mkdir()
    command = [programs / "voxelpipe", "voxelize", "bunny.glb", "--resolution", resolution, "-o", expected]
    subprocess.run(command, cwd=work, check=True, stdout=subprocess.DEVNULL)
    if exported.suffix != ".zip":
        assert exported.read_bytes() == expected.read_bytes(), f"{exported.name}: other bytes than the command line"
        return
    with zipfile.ZipFile(exported) as archive:
        assert not archive.testzip() and archive.namelist(), f"{exported.name} is no archive"
        for name in archive.namelist():
            same = archive.read(name) == (expected.parent / name).read_bytes()
            assert same, f"{exported.name}: {name} has other bytes than the command line"


def check_torn_file(server, work):
    """The server dies while it sends a file of 400 MB: the program fails, and there is no file."""
    program = subprocess.Popen(["node", "export.mjs", "bunny.glb", "npy"], cwd=work, stderr=subprocess.DEVNULL)
    part = work / "result.part"
    deadline = time.monotonic() + 120
    while program.poll() is None and time.monotonic() < deadline and not (part.exists() and part.stat().st_size > 0):
        time.sleep(0.005)
    server.kill()
    assert program.wait(60) != 0, "a torn file is no error"
    assert part.stat().st_size > 0 and not (work / "result.npy").exists(), "a torn file has the name of a whole one"


def main():
    language = sys.argv[1]
    programs, repository, work = (pathlib.Path(argument).resolve() for argument in sys.argv[2:5])
    section, shell, sources = read_section((repository / "proto/README.md").read_text(encoding="utf-8"), language)
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    # The first python3 of the path must be the one that runs this.
    os.environ["PATH"] = f"{pathlib.Path(sys.executable).parent}:{os.environ['PATH']}"
    missing = MISSING[language](section, work)
    if missing:
        print(f"skipped: {missing}")
        return 77
    (work / "proto").symlink_to(repository / "proto")
    subprocess.run([sys.executable, repository / "tests/support/make_ball.py", work / "bunny.glb"], check=True)
    server = subprocess.Popen([programs / "voxelpiped", "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
    try:
        port = re.search(r"listening on \S+:(\d+)", server.stdout.readline()).group(1)
        for resolution in (RESOLUTION, SMALL_RESOLUTION):
            write_programs(work, sources, resolution, port)
            run(programs, work, shell, resolution)
        if "export.mjs" in sources:
            write_programs(work, sources, TORN_RESOLUTION, port)
            check_torn_file(server, work)
    finally:
        server.terminate()
        server.wait(30)
    return 0


if __name__ == "__main__":
    sys.exit(main())
