#!/usr/bin/env python3
"""usage: check_skips.py LIST RESULTS...

In: RESULTS, of ctest --output-junit. LIST: lines of `PATTERN  reason`, a pattern of test names (* and ?) that may be
skipped; # begins a comment. Prints each skipped test that no pattern names, with what it said, and each pattern that
names no test; exit 1 if there is any.
"""
import fnmatch
import pathlib
import sys
import xml.etree.ElementTree


def read_list(path):
    """Pairs of pattern and reason."""
    rules = []
    for line in pathlib.Path(path).read_text(encoding="utf-8").splitlines():
        text = line.split("#")[0].strip()
        if not text:
            continue
        pattern, _, reason = text.partition(" ")
        if not reason.strip():
            raise SystemExit(f"{path}: '{pattern}' has no reason")
        rules.append((pattern, reason.strip()))
    return rules


def read_results(paths):
    """Names of all tests, and those skipped with what they printed."""
    names, skipped = [], {}
    for path in paths:
        for case in xml.etree.ElementTree.parse(path).getroot().iter("testcase"):
            names.append(case.get("name"))
            if case.get("status") not in ("run", "fail"):
                output = case.findtext("system-out") or ""
                skipped[case.get("name")] = output.strip().splitlines()[-1] if output.strip() else "(no output)"
    return names, skipped


def main(list_path, *result_paths):
    rules = read_list(list_path)
    names, skipped = read_results(result_paths)
    faults = [f"skipped, and not in {list_path}: {name}: {said}" for name, said in sorted(skipped.items())
              if not any(fnmatch.fnmatchcase(name, pattern) for pattern, _ in rules)]
    faults += [f"{list_path}: no test is named '{pattern}'" for pattern, _ in rules
               if not any(fnmatch.fnmatchcase(name, pattern) for name in names)]
    print("\n".join(faults + [f"{len(names)} tests, {len(skipped)} skipped, {len(faults)} of them unexpected"]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
