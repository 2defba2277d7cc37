#!/usr/bin/env python3
"""Puts the option tables of voxelpiped into server/OPERATIONS.md, or checks that they stand there.

usage: option_tables.py [--check] VOXELPIPED OPERATIONS.md

`voxelpiped --help-markdown` prints a table for each group of options between two comments that name it; the page has
the same comments. Exit status: 0 done or equal, 1 with --check: a table differs, 2 the page lacks a group or has one
that the program does not print.
"""
import re
import subprocess
import sys

TABLE = re.compile(r"<!-- options: (.+?) -->\n.*?<!-- /options -->\n", re.S)


def main(arguments):
    check = arguments[:1] == ["--check"]
    program, path = arguments[1:] if check else arguments
    printed = subprocess.run([program, "--help-markdown"], stdout=subprocess.PIPE, text=True, check=True).stdout
    tables = {match[1]: match[0] for match in TABLE.finditer(printed)}
    with open(path, encoding="utf-8") as file:
        page = file.read()
    groups = [match[1] for match in TABLE.finditer(page)]
    if not tables or sorted(groups) != sorted(tables):
        print(f"option_tables: {path} has the groups {groups}, {program} prints {sorted(tables)}", file=sys.stderr)
        return 2
    made = TABLE.sub(lambda match: tables[match[1]], page)
    if check and made != page:
        for old, new in zip(page.splitlines(), made.splitlines()):
            if old != new:
                print(f"- {old}\n+ {new}", file=sys.stderr)
                break
        print(f"option_tables: the tables of {path} are not those of {program}; run make option-tables",
              file=sys.stderr)
        return 1
    if not check:
        with open(path, "w", encoding="utf-8") as file:
            file.write(made)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
