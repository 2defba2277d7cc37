"""The programs of the wheel as commands of its environment."""
import os
import pathlib
import sys
from typing import NoReturn


def _become(name: str) -> NoReturn:
    program = str(pathlib.Path(__file__).with_name("bin") / name)
    os.execv(program, [program, *sys.argv[1:]])


def voxelpipe() -> NoReturn:
    """The command line."""
    _become("voxelpipe")


def voxelpiped() -> NoReturn:
    """The server."""
    _become("voxelpiped")
