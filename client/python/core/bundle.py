#!/usr/bin/env python3
"""Puts into the package voxelpipe_core what it needs beyond the C and C++ libraries of a system.

usage: bundle.py PACKAGE PROGRAM...
  PACKAGE  the folder that CMake made of the compiled package; changed in place
  PROGRAM  a program to put beside the module
Needs patchelf, binutils, and the Debian packages that the libraries are of. In PACKAGE/voxelpipe_core it makes

  bin/       the programs
  libs/      the libraries that these and the module load
  licenses/  the terms of all that is compiled or copied in

A process may have loaded libraries of the same names by then, of other versions. So each has a name with a hash of its
contents, as auditwheel gives it, and its unique symbols, of which a process has one definition whatever the library,
are common ones.
"""
from __future__ import annotations

import hashlib
import pathlib
import re
import shutil
import struct
import subprocess
import sys

# Every Linux with this glibc has them, by PEP 600. libstdc++ is one of them: exceptions cross it, so a process has one.
OF_THE_SYSTEM = re.compile(r"(ld-linux.*|lib(c|m|dl|rt|pthread|resolv|util|stdc\+\+|gcc_s))\.so\.\d+|linux-vdso\.so\.1")
# Loaded by this name while it runs, from its own folder: libtbb's allocator.
LOADED_BY = {"libtbb.so.12": "libtbbmalloc.so.2"}
# Compiled in: no library of the wheel names them.
HEADERS = (
    "libcli11-dev",
    "libdlpack-dev",
    "libhwy-dev",
    "libnanovdb-dev",
    "libtinygltf-dev",
    "nlohmann-json3-dev",
    "pybind11-dev",
)
COMMON_LICENSES = pathlib.Path("/usr/share/common-licenses")
OWN_LICENSE = pathlib.Path(__file__).resolve().parents[3] / "LICENSE"


def output(*command: object) -> str:
    return subprocess.run([*map(str, command)], check=True, stdout=subprocess.PIPE, text=True).stdout


def libraries_of(binary: pathlib.Path) -> dict[str, pathlib.Path]:
    """The libraries that the loader finds for a binary, and those that they need: name -> file."""
    found = {}
    for line in output("ldd", binary).splitlines():
        name, _, rest = line.strip().partition(" => ")
        if not rest or OF_THE_SYSTEM.fullmatch(name):
            continue
        if rest == "not found":
            sys.exit(f"bundle.py: {binary} needs {name}, which was not found")
        found[name] = pathlib.Path(rest.rpartition(" (")[0])
    for name in found.keys() & LOADED_BY.keys():
        found[LOADED_BY[name]] = found[name].with_name(LOADED_BY[name])
    return found


def make_unique_symbols_common(library: pathlib.Path) -> None:
    """Makes STB_GNU_UNIQUE symbols STB_GLOBAL, as -fno-gnu-unique does."""
    contents = bytearray(library.read_bytes())
    (sections,) = struct.unpack_from("<Q", contents, 0x28)
    size, count = struct.unpack_from("<HH", contents, 0x3A)
    for header in range(sections, sections + size * count, size):
        (kind,) = struct.unpack_from("<I", contents, header + 4)
        begin, length = struct.unpack_from("<QQ", contents, header + 0x18)
        if kind != 11:  # SHT_DYNSYM
            continue
        for info in range(begin + 4, begin + length, 24):
            if contents[info] >> 4 == 10:
                contents[info] = 1 << 4 | contents[info] & 15
    library.write_bytes(contents)


def packages_of(libraries: list[pathlib.Path]) -> set[str]:
    """The Debian packages that files are of."""
    packages = set()
    for library in libraries:
        real = library.resolve()
        # A package of before /lib was a link names it there.
        paths = [real, pathlib.Path("/", *real.parts[2:])]
        listed = subprocess.run(["dpkg-query", "-S", *map(str, paths)], capture_output=True, text=True).stdout
        if not listed:
            sys.exit(f"bundle.py: {real} is of no Debian package, so its license is not known")
        packages.add(listed.partition(":")[0])
    return packages


def copy_licenses(packages: set[str], folder: pathlib.Path) -> None:
    """Their terms, and the licenses of many packages that these refer to."""
    folder.mkdir()
    shutil.copyfile(OWN_LICENSE, folder / "voxelpipe")
    referred: set[str] = set()
    for package in packages:
        terms = pathlib.Path("/usr/share/doc", package, "copyright").read_text(encoding="utf-8", errors="replace")
        (folder / package).write_text(terms, encoding="utf-8")
        referred |= set(re.findall(rf"{COMMON_LICENSES}/([A-Za-z0-9.-]*[A-Za-z0-9])", terms))
    for name in referred:
        shutil.copyfile(COMMON_LICENSES / name, folder / name)


def main(package: pathlib.Path, programs: list[pathlib.Path]) -> None:
    root = package / "voxelpipe_core"
    modules = list(root.glob("_core*.so"))
    for name in ("bin", "libs", "licenses"):
        shutil.rmtree(root / name, ignore_errors=True)
    (root / "bin").mkdir()
    (root / "libs").mkdir()

    libraries: dict[str, pathlib.Path] = {}
    for binary in [*modules, *programs]:
        libraries |= libraries_of(binary)
    copies = {}
    for name, path in libraries.items():
        stem, suffix = name.split(".so", 1)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:8]
        copies[name] = name if name in LOADED_BY.values() else f"{stem}-{digest}.so{suffix}"
    renames = [word for old, new in copies.items() if old != new for word in ("--replace-needed", old, new)]

    def patch(binary: pathlib.Path, *soname: str, libraries_at: str) -> None:
        for change in (renames, soname, ("--set-rpath", libraries_at)):  # patchelf 0.14 mixes up changes made at once
            if change:
                output("patchelf", *change, binary)

    for name, path in libraries.items():
        copy = root / "libs" / copies[name]
        shutil.copy(path, copy)
        patch(copy, "--set-soname", copies[name], libraries_at="$ORIGIN")
        make_unique_symbols_common(copy)
    for binary in programs:
        shutil.copy(binary, root / "bin")
    for binary in [*modules, *(root / "bin").iterdir()]:
        output("strip", "--strip-unneeded", binary)
        patch(binary, libraries_at="$ORIGIN/libs" if binary in modules else "$ORIGIN/../libs")
    for binary in modules:
        make_unique_symbols_common(binary)
    copy_licenses(packages_of(list(libraries.values())) | {*HEADERS}, root / "licenses")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(next(line for line in (__doc__ or "").splitlines() if line.startswith("usage: ")))
    main(pathlib.Path(sys.argv[1]), [pathlib.Path(argument) for argument in sys.argv[2:]])
