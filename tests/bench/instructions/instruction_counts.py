#!/usr/bin/env python3
"""usage: instruction_counts.py PROGRAM BUILD [--update] [--row NAME]...

Counts the instructions of the rows of PROGRAM (instruction_rows) under valgrind and compares them with
instruction_counts.json, which was made with the same BUILD (compiler, oneTBB, Highway, processor, kind of build). Only
instructions of our own binaries count: those of libc, oneTBB, libpng and so on depend on the machine, and are left out,
so a copy or a clearing by libc is not seen here. --update writes the file instead; --row counts some rows only.

Exit: 0 all rows are within TOLERANCE of their numbers; 1 a row is not, which is named; 2 the arguments are wrong, as
where the file has no such row; 77, with the reason, where valgrind is missing or the numbers are of another build.
"""
import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

NUMBERS = pathlib.Path(__file__).with_name("instruction_counts.json")
TOLERANCE = 0.03
SKIPPED = 77
NO_SUCH_INSTRUCTIONS = 3  # exit code of instruction_rows


def own_instructions(dump, program):
    """Name and instructions of one dump of callgrind, of the objects that are ours."""
    name, count, ours, called, own_objects = None, 0, False, False, {}
    for line in dump.splitlines():
        if line.startswith("desc: Trigger: Client Request: "):
            name = line.removeprefix("desc: Trigger: Client Request: ").strip()
        elif match := re.fullmatch(r"(c?)ob=\((\d+)\)(?: (.*))?", line):
            callee, number, path = match.groups()  # the path stands where the number is first used
            if path is not None:
                file = pathlib.PurePath(path).name
                own_objects[number] = file == pathlib.PurePath(program).name or file.startswith("libvoxelpipe")
            if not callee:
                ours = own_objects[number]
        elif line.startswith("calls="):
            called = True
        elif line[:1] in tuple("0123456789+-*"):
            if ours and not called:  # the line after calls= is what the callee took
                count += int(line.split()[1])
            called = False
    return name, count


def count_rows(program, rows):
    """Instructions by the row's name. Raises CalledProcessError."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "counts"
        subprocess.run(["valgrind", "-q", "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={out}",
                        program, *rows], check=True, stdout=subprocess.DEVNULL)
        dumps = [own_instructions(path.read_text(encoding="utf-8", errors="replace"), program)
                 for path in sorted(pathlib.Path(folder).glob("counts.*"), key=lambda path: int(path.suffix[1:]))]
    return {name: count for name, count in dumps if name is not None}


def differences(numbers, counted):
    """A line for each row that is missing, new, or beyond the tolerance."""
    lines = []
    for name in sorted(numbers.keys() | counted.keys()):
        before, now = numbers.get(name), counted.get(name)
        if not before or not now:
            lines.append(f"{name}: {'no number in the file' if not before else 'not counted'}")
        elif abs(now / before - 1) > TOLERANCE:
            lines.append(f"{name}: {100 * (now / before - 1):+.1f} % ({before:,} -> {now:,} instructions)")
    return lines


def write(path, build, counted):
    rows = ",\n".join(f"    {json.dumps(name)}: {count}" for name, count in counted.items())
    path.write_text(f'{{\n  "build": {json.dumps(build)},\n  "instructions": {{\n{rows}\n  }}\n}}\n', encoding="utf-8")


def skip(why):
    print(f"SKIPPED: {why}")
    return SKIPPED


def main(arguments):
    parser = argparse.ArgumentParser(usage=__doc__.splitlines()[0].removeprefix("usage: "))
    parser.add_argument("program")
    parser.add_argument("build")
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--row", action="append", default=[])
    given = parser.parse_args(arguments)
    if given.update and given.row:
        parser.error("--update counts all rows")
    known = json.loads(NUMBERS.read_text(encoding="utf-8")) if NUMBERS.exists() else {"build": "", "instructions": {}}
    if unknown := [name for name in given.row if name not in known["instructions"]]:
        parser.error(f"{NUMBERS.name} has no row {', '.join(unknown)}")
    if shutil.which("valgrind") is None:
        return skip("valgrind is not installed (docker/packages-valgrind.txt)")
    if not given.update and known["build"] != given.build:
        return skip(f"the numbers are of another build: {known['build']}; this is {given.build}")
    try:
        counted = count_rows(given.program, given.row)
    except subprocess.CalledProcessError as error:
        if error.returncode == NO_SUCH_INSTRUCTIONS:
            return skip("this machine has no AVX2")
        print(f"{given.program} failed under valgrind: exit {error.returncode}")
        return 1
    if not counted:
        return skip("instruction_rows was built without valgrind's headers: configure again")
    if given.update:
        write(NUMBERS, given.build, counted)
        print(f"{len(counted)} rows written to {NUMBERS}")
        return 0
    numbers = known["instructions"]
    faults = differences({name: n for name, n in numbers.items() if not given.row or name in given.row}, counted)
    if faults:
        print(f"Instructions differ by more than {100 * TOLERANCE:.0f} % from {NUMBERS.name}:", *faults, sep="\n  ")
        print("If that is meant: make instruction-counts, and say why in the commit.")
        return 1
    print(f"{len(counted)} rows within {100 * TOLERANCE:.0f} % of {NUMBERS.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
