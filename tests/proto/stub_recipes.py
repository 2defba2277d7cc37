"""usage: stub_recipes.py LANGUAGE PROGRAMS_DIR REPOSITORY WORK_DIR

Runs the lines and the program of one language in proto/README.md as they stand, but for the port, which is one that is
free. The bytes that the program writes must be those of the command line. Exit 77 with the reason if a tool is missing.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys

RESOLUTION = "256"
NPM_PACKAGES = re.compile(r"`npm install ([^`]+)`")


def read_section(readme, language):
    """The shell's lines, the name of the program, and the program."""
    section = readme.split(f"\n## {language}\n")[1].split("\n## ")[0]
    shell = re.search(r"^```sh\n(.*?)^```$", section, re.S | re.M).group(1)
    name, code = re.search(r"^`(\S+)`:\n\n```\w+\n(.*?)^```$", section, re.S | re.M).groups()
    return section, shell, name, code


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


MISSING = {"Python": python_missing, "Go": go_missing, "JavaScript": javascript_missing}


def main():
    language = sys.argv[1]
    programs, repository, work = (pathlib.Path(argument).resolve() for argument in sys.argv[2:5])
    section, shell, name, code = read_section((repository / "proto/README.md").read_text(encoding="utf-8"), language)
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
    command = [programs / "voxelpipe", "voxelize", "bunny.glb", "--resolution", RESOLUTION, "-o", "expected.raw"]
    subprocess.run(command, cwd=work, check=True, stdout=subprocess.DEVNULL)
    server = subprocess.Popen([programs / "voxelpiped", "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
    try:
        port = re.search(r"listening on \S+:(\d+)", server.stdout.readline()).group(1)
        (work / name).write_text(code.replace("50051", port).replace("localhost", "127.0.0.1"), encoding="utf-8")
        script = "set -euo pipefail\n" + shell
        result = subprocess.run(["bash", "-c", script], cwd=work, stdout=subprocess.PIPE, text=True, timeout=250)
    finally:
        server.terminate()
        server.wait(30)
    print(result.stdout)
    assert result.returncode == 0, f"exit {result.returncode}"
    assert re.search(r"^\d+ x \d+ x \d+ voxels\n\d+ occupied$", result.stdout, re.M), "no summary"
    same = (work / "bunny.bits").read_bytes() == (work / "expected.raw").read_bytes()
    assert same, "other bytes than the command line"
    return 0


if __name__ == "__main__":
    sys.exit(main())
