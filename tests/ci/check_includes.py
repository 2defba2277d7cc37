#!/usr/bin/env python3
"""usage: check_includes.py BUILD_DIR COMPILER [SOURCE]...

Parses every .cpp of the programs as BUILD_DIR compiles it, but without its precompiled headers: a file that does not
include what it uses fails. Those of tests only as SOURCEs: they would double the time. With SOURCEs, these alone.
"""
import concurrent.futures
import json
import os
import pathlib
import shlex
import subprocess
import sys

TOP = pathlib.Path(__file__).resolve().parents[2]


def parse_command(command, compiler):
    """The arguments of a command of compile_commands.json, from the compiler on, that parse and write nothing."""
    arguments = shlex.split(command)
    arguments = arguments[arguments.index(compiler):]
    kept = []
    at = 0
    while at < len(arguments):
        argument = arguments[at]
        takes_next = argument == "-o" or argument == "-include" and arguments[at + 1].endswith("cmake_pch.hxx")
        at += 2 if takes_next else 1
        if not takes_next and argument not in ("-Winvalid-pch", "-fpch-preprocess", "-Werror"):
            kept.append(argument)
    return kept + ["-fsyntax-only", "-w"]


def list_commands(build, compiler, only):
    """Pairs of a source and its command: a source that several targets compile is parsed once."""
    found = {}
    for entry in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
        path = pathlib.Path(entry["file"])
        ours = path.suffix == ".cpp" and path.is_relative_to(TOP) and not path.is_relative_to(build)
        name = str(path.relative_to(TOP)) if ours else ""
        if ours and (name in only if only else not name.startswith("tests/")):
            found.setdefault(name, (entry["directory"], parse_command(entry["command"], compiler)))
    return sorted(found.items())


def parse(item):
    name, (directory, command) = item
    done = subprocess.run(command, cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return name, done.returncode, done.stdout


def main(build, compiler, *only):
    items = list_commands(pathlib.Path(build).resolve(), compiler, only)
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for name, code, output in pool.map(parse, items):
            if code != 0:
                failed += 1
                print(f"{name} does not compile without precompiled headers:\n{output}", flush=True)
    print(f"{len(items)} files, {failed} of them without an include")
    return 1 if failed or not items else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
