#!/usr/bin/env python3
"""Checks that the binaries of a wheel need nothing but each other and what every Linux of its tag has.

usage: check_wheel.py WHEEL WORK_FOLDER     Exit status 1: they do not; says why.
"""
from __future__ import annotations

import pathlib
import re
import subprocess
import sys
import zipfile
from typing import AbstractSet

# PEP 600: what every Linux of a tag has. libz and others that auditwheel lets pass are not taken for granted.
OF_THE_SYSTEM = {"ld-linux-x86-64.so.2", "libc.so.6", "libm.so.6", "libstdc++.so.6", "libgcc_s.so.1"}
# The C++ libraries of GCC 12, which the distributions with glibc 2.36 have.
NEWEST = {"GLIBCXX": (3, 4, 30), "CXXABI": (1, 3, 13), "GCC": (12, 0, 0)}
ASKED_FOR_WHILE_RUNNING = {"libtbbmalloc.so.2"}
NOT_IN_THE_MODULE = re.compile(r"lib(grpc|gpr|ssl|crypto|cuda)\b.*")


class Binary:
    """What readelf says of a file."""

    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        command = ["readelf", "--dynamic", "--version-info", "--dyn-syms", "--wide", str(path)]
        text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        self.needed = set(re.findall(r"\(NEEDED\).*\[(.*)\]", text))
        self.folders = re.findall(r"\((?:RUNPATH|RPATH)\).*\[(.*)\]", text)
        self.versions = set(re.findall(r"Name: (GLIBC|GLIBCXX|CXXABI|GCC)_([0-9.]+) ", text))
        self.has_unique_symbols = " UNIQUE " in text


def faults_of(binary: Binary, libraries: AbstractSet[str], newest: dict[str, tuple[int, ...]]) -> list[str]:
    faults = [f"needs {name}" for name in sorted(binary.needed - libraries - OF_THE_SYSTEM)]
    for folder in binary.folders or ["none"]:
        if not re.fullmatch(r"\$ORIGIN(/\.\./libs|/libs)?", folder):
            faults.append(f"searches the folder {folder}")
    for family, version in sorted(binary.versions):
        if tuple(map(int, version.split("."))) > newest[family]:
            faults.append(f"needs {family}_{version}")
    if binary.path.parent.name != "bin" and binary.has_unique_symbols:
        faults.append("has unique symbols, which it would share with other libraries of a process")
    return faults


def main(wheel: pathlib.Path, work: pathlib.Path) -> None:
    tag = re.search(r"-manylinux_(\d+)_(\d+)_x86_64\.whl$", wheel.name)
    if not tag:
        sys.exit(f"{wheel.name}: has no tag manylinux")
    newest = {**NEWEST, "GLIBC": tuple(map(int, tag.groups()))}
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(work)
    root = work / "voxelpipe_core"
    libraries = {path.name: Binary(path) for path in (root / "libs").iterdir()}
    others = [Binary(path) for path in [*root.glob("_core*.so"), *(root / "bin").iterdir()]]
    faults = []
    for binary in [*libraries.values(), *others]:
        faults += [f"{binary.path.name}: {fault}" for fault in faults_of(binary, libraries.keys(), newest)]

    reached: set[str] = set()
    for binary in others:  # the module first
        waiting = binary.needed & libraries.keys()
        while waiting:
            reached |= waiting
            waiting = set().union(*(libraries[name].needed for name in waiting)) & libraries.keys() - reached
        if binary.path.parent == root:
            faults += [f"the module loads {name}" for name in reached if NOT_IN_THE_MODULE.match(name)]
    faults += [f"{name}: nothing needs it" for name in libraries.keys() - reached - ASKED_FOR_WHILE_RUNNING]
    if len(others) != 3 or not (root / "licenses" / "libprotobuf32").is_file():
        faults.append("a program or a license is missing")
    if faults:
        sys.exit("\n".join(faults))
    size = wheel.stat().st_size
    print(f"{wheel.name}: {size / 1e6:.1f} MB, {len(others)} binaries and {len(libraries)} libraries, complete")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
