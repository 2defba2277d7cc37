"""Installs the npm packages of a test."""
import functools
import pathlib
import shutil
import subprocess

LIMIT_S = 180


@functools.cache  # tried once a process: each try may take LIMIT_S
def install(source, target):
    """In: a folder with package.json and package-lock.json. Out: the node_modules below `target`, and "" or what is
    missing. Packages that are there stay."""
    missing = [program for program in ("node", "npm") if shutil.which(program) is None]
    if missing:
        return None, f"{', '.join(missing)}: not installed"
    target = pathlib.Path(target)
    lock, stamp = pathlib.Path(source) / "package-lock.json", target / "package-lock.json"
    if not (target / "node_modules").is_dir() or not stamp.is_file() or stamp.read_bytes() != lock.read_bytes():
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(pathlib.Path(source) / "package.json", target)
        shutil.copy(lock, target)
        command = ["npm", "ci", "--prefix", str(target), "--no-audit", "--no-fund", "--silent"]
        try:
            subprocess.run(command, timeout=LIMIT_S, check=True)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
            stamp.unlink()
            return None, "npm cannot install the packages"
    return target / "node_modules", ""
