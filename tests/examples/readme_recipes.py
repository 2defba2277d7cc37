"""usage: readme_recipes.py PROGRAMS_DIR REPOSITORY WORK_DIR

Runs the recipes of README.md as they stand, but for the port, which is the one that the system gives to the server: the
shell's in one bash, the Python one with the package of the repository. The C++ one is run by tests/package, docker's by
`make docker-test`. Exit 77 with the reason if Python lacks a module that the package needs.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys

# What the recipes leave behind.
MADE = ["bunny.npy", "bunny.png", "solid.npz", "served.npy", "results/bunny.npy", "results/solid.0.npy", "report.json"]
BY_PYTHON = "colours.png"


def read_blocks(readme):
    """Pairs of a language and the code of each block under "## Recipes"."""
    recipes = readme.split("\n## Recipes\n")[1].split("\n## ")[0]
    return re.findall(r"^```(\w+)\n(.*?)^```$", recipes, re.S | re.M)


def prepare_package(repository, work):
    """The folder of the Python package with its stubs, in a copy."""
    tree = work / "tree"
    shutil.copytree(repository / "client/python", tree / "client/python", ignore=shutil.ignore_patterns("_proto"))
    (tree / "proto").symlink_to(repository / "proto")
    subprocess.run([sys.executable, tree / "client/python/generate_stubs.py"], check=True)
    return tree / "client/python"


def main():
    programs, repository, work = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
    for module in ("numpy", "grpc", "google.protobuf"):
        if subprocess.run([sys.executable, "-c", f"import {module}"], stderr=subprocess.DEVNULL).returncode != 0:
            print(f"skipped: Python has no module {module}; docker/packages-python.txt lists the packages")
            return 77
    shutil.rmtree(work, ignore_errors=True)
    (work / "run").mkdir(parents=True)
    subprocess.run([sys.executable, repository / "tests/support/make_ball.py", work / "run/bunny.glb"], check=True)
    blocks = read_blocks((repository / "README.md").read_text(encoding="utf-8"))
    assert [language for language, _ in blocks] == ["sh", "python", "cpp", "sh", "sh", "sh"], "the recipes have changed"
    shell = "\n".join(code for language, code in blocks if language == "sh" and "docker" not in code)
    assert shell.count("50051") == 3 and shell.count("&\n") == 1
    python = next(code for language, code in blocks if language == "python")
    package = prepare_package(repository, work)
    environment = {key: value for key, value in os.environ.items() if not key.startswith("VOXELPIPE_")}
    environment["PATH"] = f"{programs}:{environment['PATH']}"
    core = os.environ.get("VOXELPIPE_CORE_PACKAGE", "")
    environment["PYTHONPATH"] = f"{package}:{core}"

    # The server says its port, and a little later than a person would type the next line.
    told = "port=$(sed -n 's/^listening on .*://p' listening) && [[ -n $port ]]"
    serves = f"until {told}; do kill -0 %1; sleep 0.1; done\n"
    shell = shell.replace("50051", "$port").replace("&\n", ">listening &\n" + serves)
    script = "set -euo pipefail\nport=0\n" + shell + "kill %1\nwait %1 || true\n"
    subprocess.run(["bash", "-c", script], cwd=work / "run", env=environment, check=True, timeout=200)
    subprocess.run([sys.executable, "-c", python], cwd=work / "run", env=environment, check=True, timeout=200)
    missing = [name for name in [*MADE, BY_PYTHON] if not (work / "run" / name).is_file()]
    assert not missing, missing
    import numpy

    with numpy.load(work / "run/solid.npz") as solid:
        assert (solid["target1"][solid["target0"] == 1] == 255).all(), "white inside too, as the ball's material"
    return 0


if __name__ == "__main__":
    sys.exit(main())
