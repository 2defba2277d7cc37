"""usage: systemd_unit.py REPOSITORY VOXELPIPED

Checks docker/systemd/voxelpiped.service.in: systemd accepts it, with and without the drop-in for GPUs, and rates its
exposure at most MAX_EXPOSURE; its times fit the server's options. Exit 77 with the reason where systemd is missing.
"""
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

# `systemd-analyze security`: 0 is a service that may do nothing, 10 one that may do everything.
MAX_EXPOSURE = 1.4
MAX_EXPOSURE_GPU = 1.8
END_S = 10  # beyond lame duck and grace (server/main.cpp)


def fail(text):
    sys.exit(f"systemd_unit: {text}")


def settings_of(unit):
    """The settings of [Service]; of a repeated one, the last."""
    section = unit.split("[Service]\n")[1].split("\n[")[0]
    return dict(re.findall(r"^(\w+)=(.*)$", section, re.M))


def analyze(*arguments):
    return subprocess.run(
        ["systemd-analyze", *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )


def exposure_of(unit):
    # --threshold is in tenths, and 100 passes everything.
    answer = analyze("security", "--offline=yes", "--no-pager", "--threshold=100", unit)
    found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", answer.stdout)
    return float(found[1]) if found else fail(f"no exposure: {answer.stdout}{answer.stderr}")


def check_times(settings, voxelpiped):
    """The limit of the stop covers what the server takes by default, where its lame duck is the longer one."""
    options = subprocess.run(
        [voxelpiped, "--listen", "0.0.0.0:1", "--check-config"], capture_output=True, text=True, timeout=60, check=True
    ).stdout
    values = {key: int(value) for key, value in re.findall(r"^(lame-duck-ms|drain-grace-ms) = (\d+)", options, re.M)}
    need = values["lame-duck-ms"] / 1000 + values["drain-grace-ms"] / 1000 + END_S
    if int(settings["TimeoutStopSec"]) < need:
        fail(f"TimeoutStopSec={settings['TimeoutStopSec']} is less than lame duck, drain and end: {need} s")
    if settings["Type"] != "notify" or settings["KillMode"] != "mixed":
        fail("the unit waits for no READY, or signals the processes that load meshes")


def main():
    repository, voxelpiped = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    if shutil.which("systemd-analyze") is None:
        print("SKIPPED: systemd is not installed (docker/packages-operations.txt)")
        return 77
    template = (repository / "docker/systemd/voxelpiped.service.in").read_text(encoding="utf-8")
    text = template.replace("@bindir@", str(voxelpiped.parent))
    if "@" in re.sub(r"@system-service|@privileged", "", text):
        fail("something is not filled in")
    check_times(settings_of(text), voxelpiped)
    with tempfile.TemporaryDirectory() as folder:
        unit = pathlib.Path(folder) / "voxelpiped.service"
        for drop_in, most in (("", MAX_EXPOSURE), ("gpu.conf", MAX_EXPOSURE_GPU)):
            unit.write_text(text, encoding="utf-8")
            if drop_in:
                (pathlib.Path(folder) / "voxelpiped.service.d").mkdir()
                shutil.copy(repository / "docker/systemd" / drop_in, pathlib.Path(folder) / "voxelpiped.service.d")
            answer = analyze("verify", "--man=no", unit)
            if answer.returncode != 0 or answer.stderr:
                fail(f"verify {drop_in}: {answer.stderr}")
            exposure = exposure_of(unit)
            print(f"exposure{' with ' + drop_in if drop_in else ''}: {exposure}")
            if exposure > most:
                fail(f"{drop_in}: an exposure above {most}")
        # Both checks find what they are for.
        unit.write_text(text.replace("TimeoutStopSec=", "TimeoutStopSecs="), encoding="utf-8")
        if "TimeoutStopSecs" not in analyze("verify", "--man=no", unit).stderr:
            fail("verify takes a misspelt setting")
        unit.write_text(text.replace("DynamicUser=yes", "User=root"), encoding="utf-8")
        if exposure_of(unit) <= MAX_EXPOSURE_GPU:
            fail("a service that runs as root is not rated worse")
    return 0


if __name__ == "__main__":
    sys.exit(main())
