"""Benchmark results as JSON, one file for each run of one table. The only module that reads, checks and writes them.

A file is an object:
  title, date, commit, machine, method   texts; "not recorded" where it was not
  unit     of `ours`, `p10`, `p90` and `theirs`; a row may have its own
  better   "lower", "higher" or "equal" (counts: any change is a difference); a row may have its own
  peer     optional: what `theirs` was measured with; a row may have its own
  plot     optional: the case whose rows the plot shows over N
  rows     a list of objects:
    case, mesh, N   what was measured; together they are unique in the file. mesh and N may be missing
    ours            the figure
    p10, p90        optional: its spread
    theirs          optional: the peer's figure
    others          any further figures and texts by name, e.g. occupied (voxels; must be equal to be comparable)
"""
import json
import os

TEXTS = ("title", "date", "commit", "machine", "method", "unit")
BETTER = ("lower", "higher", "equal")
ROW_KEYS = ("case", "mesh", "N", "ours", "p10", "p90", "theirs", "unit", "better", "peer")


class BadResults(ValueError):
    """A file that is not of this form; the text says where."""


def key(row):
    """What identifies a row in its file."""
    return (row["case"], row.get("mesh", ""), row.get("N", ""))


def name(row):
    """The same for people."""
    return " ".join(str(part) for part in key(row) if part != "")


def others(row):
    """The figures and texts of a row that have no place of their own."""
    return {field: value for field, value in row.items() if field not in ROW_KEYS}


def of(results, row, field, default=None):
    """A row's unit, better or peer: its own or the file's."""
    return row.get(field, results.get(field, default))


def ratio(results, row):
    """How many times better `ours` is than `theirs`; None without a peer or where nothing is better."""
    better = of(results, row, "better")
    if "theirs" not in row or better == "equal" or not row["ours"] or not row["theirs"]:
        return None
    return row["theirs"] / row["ours"] if better == "lower" else row["ours"] / row["theirs"]


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def check(results, where):
    """Raises BadResults with the place of the first fault."""
    for text in TEXTS:
        if not isinstance(results.get(text), str) or not results[text]:
            raise BadResults(f"{where}: no text {text}")
    if not isinstance(results.get("rows"), list) or not results["rows"]:
        raise BadResults(f"{where}: no rows")
    seen = set()
    for i, row in enumerate(results["rows"]):
        place = f"{where}: row {i + 1}"
        if not isinstance(row, dict) or not isinstance(row.get("case"), str):
            raise BadResults(f"{place}: no case")
        if not is_number(row.get("ours")):
            raise BadResults(f"{place}: ours is no number")
        for field in ("p10", "p90", "theirs"):
            if field in row and not is_number(row[field]):
                raise BadResults(f"{place}: {field} is no number")
        if of(results, row, "better") not in BETTER:
            raise BadResults(f"{place}: better is none of {', '.join(BETTER)}")
        if "theirs" in row and not of(results, row, "peer"):
            raise BadResults(f"{place}: theirs without a peer")
        if key(row) in seen:
            raise BadResults(f"{place}: {name(row)} is given twice")
        seen.add(key(row))
    return results


def read(path):
    """The results of a file. Raises BadResults, OSError."""
    with open(path, encoding="utf-8") as file:
        try:
            results = json.load(file)
        except ValueError as error:
            raise BadResults(f"{path}: {error}") from error
    if not isinstance(results, dict):
        raise BadResults(f"{path}: not an object")
    return check(results, path)


def to_text(results):
    """JSON with one row a line, so that a change of a figure is a change of a line."""
    head = [f"  {json.dumps(k)}: {json.dumps(v, ensure_ascii=False)}," for k, v in results.items() if k != "rows"]
    rows = ",\n".join("    " + json.dumps(row, ensure_ascii=False) for row in results["rows"])
    return "\n".join(["{", *head, '  "rows": [', rows, "  ]", "}"]) + "\n"


def write(path, results):
    """Writes checked results; makes the folder."""
    check(results, path)
    os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
    with open(path, "w", encoding="utf-8") as file:
        file.write(to_text(results))
