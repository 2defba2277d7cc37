"""Files of the package voxelpipe_core, where it is installed; without loading it."""
from __future__ import annotations

import importlib.util
import pathlib


def core_files(pattern: str) -> list[pathlib.Path]:
    """Those whose path below the package matches: programs in bin, libraries in libs. Only its wheel has any there."""
    found = importlib.util.find_spec("voxelpipe_core")
    folders = found.submodule_search_locations if found else None
    return [path for folder in folders or () for path in sorted(pathlib.Path(folder).glob(pattern))]
